"""What the command line writes: progress and streams."""
