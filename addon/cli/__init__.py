"""The command line: `measured_materials ...`, one file per command."""
