"""What a swatch is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import bpy


@dataclass(frozen=True)
class Swatch:
    """Procedural geometry that repeats with period 1 in u and v, its visible surface about height 0.

    Attributes
    ----------
    build : links the objects of one tile, with stock materials, into a scene and returns them; equal every time
    height : from the lowest to the highest point, about
    description : one line for artists
    lobe, lobe_parameters : f_r that suits a shading map of it
    """

    name: str
    build: Callable[[bpy.types.Scene], Sequence[bpy.types.Object]]
    height: float
    description: str
    lobe: str
    lobe_parameters: dict[str, float] = field(default_factory=dict)
