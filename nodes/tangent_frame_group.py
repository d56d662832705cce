"""Node groups: the frame of an anisotropic surface, and a tangent that keeps to the surface under any transform."""

from __future__ import annotations

import math
from typing import Any

import bpy

from . import expr
from .group import node_group
from .local_frame_group import MIN_COSINE


def tangent_frame(normal: Any, incoming: Any, tangent: Any) -> tuple[Any, Any, Any]:
    """Local viewer direction, the unit tangent at right angles to the normal, and the bitangent n x t."""
    across = expr.cross(normal, tangent)
    x, _, _ = expr.components(normal)
    axis = expr.where(x * x > 0.5, expr.vec(0.0, 1.0, 0.0), expr.vec(1.0, 0.0, 0.0))
    # Where there is no tangent, as on a mesh without UVs, any will do.
    bitangent = expr.normalize(expr.where(expr.length(across) > 1e-6, across, expr.cross(normal, axis)))
    along = expr.cross(bitangent, normal)
    cosine = expr.maximum(expr.dot(normal, incoming), MIN_COSINE)
    wo = expr.normalize(expr.vec(expr.dot(incoming, along), expr.dot(incoming, bitangent), cosine))
    return wo, along, bitangent


def tangent_frame_group() -> bpy.types.ShaderNodeTree:
    """(Normal, Incoming, Tangent) to (wo, Tangent, Bitangent)."""
    return node_group(
        "MM Tangent Frame",
        {"Normal": "vector", "Incoming": "vector", "Tangent": "vector"},
        {"wo": "vector", "Tangent": "vector", "Bitangent": "vector"},
        tangent_frame,
    )


def surface_tangent_group() -> bpy.types.ShaderNodeTree:
    """(Normal, Tangent, Rotation) of Cycles' Tangent node to the direction in which the coordinate runs on the surface.

    Rotation turns it about the normal, in whole turns as Cycles' own anisotropic closures take it. Cycles takes its
    tangents to the world by the transform of normals: under shear and unequal scale they leave the direction that a
    texture runs in. Here they are taken back by it, and to the world as the directions they are.
    """

    def build(normal: Any, tangent: Any, rotation: Any) -> Any:
        own_normal = _transformed(normal, "NORMAL", "WORLD", "OBJECT")
        own = _transformed(tangent, "NORMAL", "WORLD", "OBJECT")
        # What Cycles has taken off along the world's normal comes back along the object's.
        own = own - expr.scale(own_normal, expr.dot(own, own_normal))
        along = expr.normalize(_transformed(own, "VECTOR", "OBJECT", "WORLD"))
        turn = {"Vector": along, "Axis": normal, "Angle": rotation * (2 * math.pi)}
        return expr.Vector(expr.node("ShaderNodeVectorRotate", {"rotation_type": "AXIS_ANGLE"}, turn).outputs[0])

    inputs = {"Normal": "vector", "Tangent": "vector", "Rotation": "float"}
    return node_group("MM Surface Tangent", inputs, {"Tangent": "vector"}, build)


def _transformed(value: Any, kind: str, source: str, target: str) -> Any:
    settings = {"vector_type": kind, "convert_from": source, "convert_to": target}
    return expr.Vector(expr.node("ShaderNodeVectorTransform", settings, {0: value}).outputs[0])
