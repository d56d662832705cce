"""Textures of a material: those that it keeps, their repair, and as files for scripts."""
