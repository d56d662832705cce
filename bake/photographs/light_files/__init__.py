"""Files that say where the light of each photograph was."""
