"""Property groups of the panel."""
