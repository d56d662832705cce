"""Node group: texture coordinates of what a viewer sees of a swatch's relief, before a shading map's UV."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.maps.parallax import LEAST_COSINE, seen_at
from . import expr
from .group import HASH_KEY, RECIPE_KEY, SHAPE_KEY, content_hash, node_group
from .swatch_frame_group import ALONG_U, ALONG_V

PARALLAX = "MM Parallax"


@dataclass(frozen=True)
class Relief:
    """Heights of a swatch.

    Parameters
    ----------
    image : of them; its red counts
    low, high : least and greatest value in it
    zero : value at the height that UV coordinates are of
    scale : height in widths of the picture by which values differ by 1
    """

    image: bpy.types.Image
    low: float
    high: float
    zero: float
    scale: float


def parallax_group(relief: Relief, tiling: str = "repeat") -> bpy.types.ShaderNodeTree:
    """(UV, Along U, Along V, Depth) to UV; Depth is a factor of the heights, 0 for none.

    Parameters
    ----------
    tiling : of the swatch, "repeat" or "extend": what relief there is beyond its border
    """
    aspect = relief.image.size[0] / relief.image.size[1]

    def moved(uv: Any, along_u: Any, along_v: Any, depth: Any) -> Any:
        geometry = expr.node("ShaderNodeNewGeometry", {}, {}).outputs
        viewer, normal = expr.Vector(geometry["Incoming"]), expr.Vector(geometry["Normal"])
        reach = expr.divide(depth * relief.scale, expr.maximum(expr.dot(viewer, normal), LEAST_COSINE))
        across, up = expr.dot(viewer, along_u) * reach, expr.dot(viewer, along_v) * (reach * aspect)
        step = expr.vec(across, up, 0.0)

        def height(place: Any) -> Any:
            u, v, _ = expr.components(place)
            colour, _ = expr.image_tap(relief.image, u, v, "Linear", tiling.upper())
            return expr.components(colour)[0]

        return seen_at(expr, height, uv + expr.scale(step, -relief.zero), step, relief.low, relief.high)

    inputs = {"UV": "vector", ALONG_U: "vector", ALONG_V: "vector", "Depth": "float"}
    return node_group(PARALLAX, inputs, {"UV": "vector"}, moved, {"Depth": 1.0}, limits={"Depth": (0.0, 2.0)})


def follow_tiling(node: bpy.types.Node, tiling: str) -> None:
    """Have the relief go on beyond its border as the swatch now does, whatever has become of the file of its heights.

    The group is copied and not built again: that takes no numbers of the relief, and cannot fail where the rest of the
    material has been exchanged already.
    """
    before = node.node_tree
    if all(tap.extension == tiling.upper() for tap in _taps(before)):
        return
    changed = before.copy()
    changed.use_fake_user = False
    for tap in _taps(changed):
        tap.extension = tiling.upper()
    for key in {RECIPE_KEY, SHAPE_KEY} & set(changed.keys()):
        del changed[key]
    # That an artist has worked in it stays to be seen.
    if before[HASH_KEY] == content_hash(before):
        changed[HASH_KEY] = content_hash(changed)
    node.node_tree = changed
    if not before.users:
        bpy.data.node_groups.remove(before)


def _taps(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    return [node for node in tree.nodes if node.bl_idname == "ShaderNodeTexImage"]


def is_parallax(node: bpy.types.Node) -> bool:
    """Whether a node is this group."""
    tree = getattr(node, "node_tree", None)
    return tree is not None and HASH_KEY in tree and tree.name.startswith(PARALLAX)
