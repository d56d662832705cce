"""The bake of a BRDF: from a source to a bundle."""
