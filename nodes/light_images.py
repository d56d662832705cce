"""Images by which mirrors aim: tables of numbers that live in the .blend."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.sampling.world import COLUMNS, ROWS
from . import expr

WORLD = "MM World"
WORLD_LIGHT_TEXELS = 3


def new_table(name: str, columns: int, rows: int) -> bpy.types.Image:
    """An image of zeros whose numbers reach the shader as they are, RGBA in float32."""
    image = bpy.data.images.new(name, columns, rows, float_buffer=True, is_data=True, alpha=True)
    image.name = name
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = False
    return image


def texel(table: bpy.types.Image, row: Any, column: int) -> tuple[Any, Any]:
    """Colour and alpha of a texel of a table, in nodes; rows are counted from the top."""
    columns, rows = table.size
    return expr.image_tap(table, (column + 0.5) / columns, 1 - (row + 0.5) * (1 / rows), "Closest")


def world_tables() -> list[bpy.types.Image]:
    """The file's table of the world, and those that came along with linked and appended materials."""
    return [i for i in bpy.data.images if i.name.startswith(WORLD) and tuple(i.size) == (COLUMNS, ROWS)]


def world_table() -> bpy.types.Image:
    """The file's own; made, of zeros, where there is none."""
    image = bpy.data.images.get((WORLD, None))
    return image if image in world_tables() else new_table(WORLD, COLUMNS, ROWS)
