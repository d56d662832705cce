"""Textures of a material: those that it keeps, and as files for scripts."""
