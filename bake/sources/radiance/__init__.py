"""Readers of the XML that WINDOW and Radiance share: matrices over Klems' directions, and tensor trees."""
