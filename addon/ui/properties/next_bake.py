"""What the panel offers for the next bake of a material whose bundle was there already."""

from __future__ import annotations

import contextlib

import bpy

from ....bake.errors import BakeError
from ...material.facts import record_of
from ...material.kinds import BRDF, kind_of
from .bake import show_settings
from .photographs import show_arc_settings

# In the place of the second folder, where a bundle's settings are of another version.
_LOST = "photographs against the light"


def show_next_bake(material: bpy.types.Material, pack: bool) -> None:
    """Have the panel offer for the next bake what this one was made with, where the bundle says it."""
    brdf = kind_of(material) is BRDF
    properties = material.measured_materials if brdf else material.measured_arc
    properties.pack = pack
    with contextlib.suppress(BakeError, TypeError, ValueError):
        record = record_of(material)
        settings = record.settings
        if brdf:
            show_settings(properties, settings)
        elif settings is not None:
            show_arc_settings(properties, settings, pack=pack)
        elif record.through is not None:
            properties.through = _LOST  # which the next bake asks for, where it would else leave the second map out
