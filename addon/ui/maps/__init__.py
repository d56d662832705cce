"""Maps in the window: materials of folders that hold some."""
