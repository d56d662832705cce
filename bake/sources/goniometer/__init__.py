"""Readers of what goniometers and optical design programs write as text."""
