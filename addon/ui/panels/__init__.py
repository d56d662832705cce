"""Panels of measured materials, and the scene check that they show."""
