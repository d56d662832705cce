"""All that touches a measured material in the .blend, without a window."""
