"""Registration with Blender, operators, panels and the command line."""
