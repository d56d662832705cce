"""Figures of measurements and bundles, drawn with matplotlib where it is installed; Blender does not ship it."""
