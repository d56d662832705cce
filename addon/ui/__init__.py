"""Operators and panels: the top floor."""
