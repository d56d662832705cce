"""The node groups of a tabulated BRDF, and a direction drawn by them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from .drawn_direction import DrawnDirection, drawn_direction
from .group import call


@dataclass(frozen=True)
class TableGroups:
    """Of a tabulated BRDF: (wi, wo, random) to it, (wo, random numbers) to (wi, pdf), and (wi, wo) to that pdf.

    The last is None where nothing is aimed.
    """

    lookup: bpy.types.ShaderNodeTree
    sampler: bpy.types.ShaderNodeTree
    density: bpy.types.ShaderNodeTree | None = None

    def draw(self, normal: Any, lamps: bpy.types.Image | None) -> DrawnDirection:
        """A direction from the sampler or, with `density`, towards the lamps of a table."""
        return drawn_direction(
            normal, lambda wo, *u: call(self.sampler, wo, *u), lambda wi, wo: call(self.density, wi, wo), lamps
        )
