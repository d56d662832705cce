"""Bakes of the window that run beside it: their queue, and what becomes of their bundles."""
