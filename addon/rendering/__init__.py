"""Cycles to pixels."""
