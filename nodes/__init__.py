"""Shader node groups and the material builder: the formulas of `bake`, written as Cycles nodes."""
