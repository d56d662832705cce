"""What of a scene keeps a measured material from being right."""
