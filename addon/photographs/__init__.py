"""Photographs as Blender decodes them."""
