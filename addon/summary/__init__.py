"""Rows and words that the panel and the command line share."""
