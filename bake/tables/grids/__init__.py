"""Where the samples of a table lie."""
