"""Measured BRDFs to small textures: readers, tables, samplers and bundles in pure numpy (never bpy)."""

VERSION = "0.1.0"
