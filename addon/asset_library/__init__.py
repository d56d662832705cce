"""Folders of bundles as asset libraries of Blender: a .blend for each material, with catalogue, picture and words."""
