"""Drawing light directions: from a material's alias tables, towards lamps, and into the world's bright parts."""
