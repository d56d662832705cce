"""Anisotropic BRDFs: four-dimensional tables, their samplers and envelopes (DESIGN.md sections 4 and 5)."""
