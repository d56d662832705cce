"""Measured materials as assets of Blender's asset browser: catalogue, words, picture."""
