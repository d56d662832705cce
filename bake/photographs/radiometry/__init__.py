"""What pixel values mean: curves, primaries, marks in files."""
