"""Bidirectional texture functions (Dana et al. 1999), for what a shading map is compared with."""
