"""Node group: texture coordinates of a swatch whose repetition is hidden at random, before a shading map's UV."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.tiling.hexagons import hexagon_tiling
from . import expr
from .group import HASH_KEY, node_group
from .stochastic_mirror_group import ray_hash

RANDOM_TILING = "MM Random Tiling"
# Any number that no other group salts its hash with: those of Mix Shaders count from 1.
_SALT = -1.0


def random_tiling_group() -> bpy.types.ShaderNodeTree:
    """(UV, Patch Size, Seed) to UV, moved by whole patches that blend at their borders; nothing is turned."""

    def moved(uv: Any, size: Any, seed: Any) -> Any:
        u, v, w = expr.components(uv)

        def offsets(column: Any, row: Any) -> tuple[Any, Any]:
            return expr.white_noise(expr.vec(column, row, seed), 0.0)[:2]

        position, (first, _, _) = ray_hash(_SALT)
        number, _, _ = expr.white_noise(position, first)
        return expr.vec(*hexagon_tiling(expr, offsets, u, v, expr.maximum(size, 1e-3), number), w)

    inputs = {"UV": "vector", "Patch Size": "float", "Seed": "float"}
    limits = {"Patch Size": (0.1, 10.0)}
    return node_group(RANDOM_TILING, inputs, {"UV": "vector"}, moved, {"Patch Size": 0.7}, limits=limits)


def is_random_tiling(node: bpy.types.Node) -> bool:
    """Whether a node is this group."""
    tree = getattr(node, "node_tree", None)
    return tree is not None and HASH_KEY in tree and tree.name.startswith(RANDOM_TILING)
