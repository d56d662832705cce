"""Closed-form lobes."""
