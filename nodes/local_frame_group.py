"""Node groups: into the frame of the shading normal and the viewer, and back."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import node_group

# A smooth normal can turn away from the viewer at a silhouette; the material is then seen at this cosine.
MIN_COSINE = 1e-3


def viewer_frame(normal: Any, incoming: Any) -> tuple[Any, Any, Any]:
    """Local viewer direction (sin, 0, cos) and the two tangents; the first lies in the viewer's plane."""
    across = expr.cross(normal, incoming)
    sine = expr.length(across)
    cosine = expr.maximum(expr.dot(normal, incoming), MIN_COSINE)
    # Close to the normal the cross product is rounding noise, and no azimuth matters: any tangent serves.
    x, _, _ = expr.components(normal)
    axis = expr.where(x * x > 0.5, expr.vec(0.0, 1.0, 0.0), expr.vec(1.0, 0.0, 0.0))
    bitangent = expr.normalize(expr.where(sine > 1e-4, across, expr.cross(normal, axis)))
    return expr.normalize(expr.vec(sine, 0.0, cosine)), expr.cross(bitangent, normal), bitangent


def viewer_frame_group() -> bpy.types.ShaderNodeTree:
    """(Normal, Incoming) to (wo, Tangent, Bitangent)."""
    return node_group(
        "MM Viewer Frame",
        {"Normal": "vector", "Incoming": "vector"},
        {"wo": "vector", "Tangent": "vector", "Bitangent": "vector"},
        viewer_frame,
    )


def to_world(local: Any, tangent: Any, bitangent: Any, normal: Any) -> Any:
    """World direction of a local one."""
    x, y, z = expr.components(local)
    return expr.scale(tangent, x) + expr.scale(bitangent, y) + expr.scale(normal, z)
