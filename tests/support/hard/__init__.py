"""Numerically hard cases: one registry that the tests and the table in the documentation both read."""
