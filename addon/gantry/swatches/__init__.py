"""Procedural swatches for the gantry: geometry in place of photographed samples."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from .cloth import cloth
from .jeans import jeans
from .plastic import plastic
from .stone import stone
from .suede import suede
from .swatch import Swatch
from .wool import wool

SWATCHES: dict[str, Callable[[int], Swatch]] = {
    "plastic_5": partial(plastic, exponent=5.0),
    "plastic_60": partial(plastic, exponent=60.0),
    "suede": suede,
    "cloth": cloth,
    "jeans": jeans,
    "wool": wool,
    "stone": stone,
}

__all__ = ["SWATCHES", "Swatch"]
