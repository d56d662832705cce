"""Shading maps: mesostructure that answers to light (Kautz et al. 2004)."""
