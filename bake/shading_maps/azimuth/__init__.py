"""Shading maps over azimuth: light from every side of the swatch, where Kautz et al. 2004 follow one arc."""
