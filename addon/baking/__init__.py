"""Bakes in a process of their own, beside a Blender that goes on working."""
