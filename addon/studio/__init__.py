"""A small scene to look at a material in."""
