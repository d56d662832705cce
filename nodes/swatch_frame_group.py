"""Node group: how a swatch lies on the surface, found by how its texture coordinates change from point to point.

A light's azimuth is counted in the swatch, which a Mapping node turns, scales or mirrors and the UV map may shear: no
tangent of the mesh knows of that. Blender's Bump node compares points next to each other, whatever gives their
coordinates, and bends the normal n against the gradient of a height h (Mikkelsen 2010, "Bump Mapping Unparametrized
Surfaces on the GPU"): what is left of the bent normal along the surface has the direction of -grad h. With h = v that
is at right angles to the lines along which u runs.
"""

from __future__ import annotations

from typing import Any

import bpy

from . import compat, expr
from .group import HASH_KEY, call, node_group
from .tangent_frame_group import tangent_frame_group

NAME = "MM Swatch Frame"
ALONG_U, ALONG_V = "Along U", "Along V"


def swatch_frame_group() -> bpy.types.ShaderNodeTree:
    """(UV) to (Along U, Along V): unit vectors in world space, at right angles to each other and to the normal.

    Along U is the direction in which u grows while v stays; Along V that in which v grows across it. They make a
    left-handed frame with the normal where the swatch is mirrored. Where the coordinates do not change at all, as on a
    mesh without UVs, they are some tangents.
    """

    def build(uv: Any) -> tuple[Any, Any]:
        normal = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Normal"])
        u, v, _ = expr.components(uv)
        steepest = _against_gradient(v, normal)
        handed = expr.dot(expr.cross(_against_gradient(u, normal), steepest), normal)
        _, along, across = call(tangent_frame_group(), normal, normal, expr.scale(steepest, -1.0))
        return expr.scale(across, expr.where(handed < 0, 1.0, -1.0)), along

    return node_group(NAME, {"UV": "vector"}, dict.fromkeys((ALONG_U, ALONG_V), "vector"), build)


def is_swatch_frame(node: bpy.types.Node) -> bool:
    """Whether a node is this group."""
    tree = getattr(node, "node_tree", None)
    return tree is not None and HASH_KEY in tree and tree.name.startswith(NAME)


def _against_gradient(height: Any, normal: Any) -> Any:
    """The bent normal's part along the surface, of any length."""
    # A distance of 1 bends far, and the widest filter steps far: what float32 leaves of a difference counts less.
    inputs = {"Strength": 1.0, "Distance": 1.0, "Height": height, **compat.widest_bump_filter()}
    bent = expr.Vector(expr.node("ShaderNodeBump", {}, inputs).outputs[0])
    return bent - expr.scale(normal, expr.dot(bent, normal))
