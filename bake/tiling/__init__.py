"""Swatches that repeat without seams."""
