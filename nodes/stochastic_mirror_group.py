"""Node groups: an arbitrary BRDF as a perfect mirror whose facet the shader itself draws (DESIGN.md section 5)."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import call, node_group
from .local_frame_group import to_world, viewer_frame_group


def random_numbers() -> tuple[Any, ...]:
    """Six independent numbers in [0, 1], fresh for every sample.

    Sub-pixel jitter moves position and incoming direction, and with them every bit of the hash; the two nodes
    differ in the direction that the incoming vector is projected on.
    """
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    position = expr.Vector(geometry.outputs["Position"])
    incoming = expr.Vector(geometry.outputs["Incoming"])
    first = expr.white_noise(position, expr.dot(incoming, expr.vec(3.17, 7.31, 1.93)))
    second = expr.white_noise(position, expr.dot(incoming, expr.vec(1.17, 9.31, 2.93)) + 17.0)
    return first + second


def random_numbers_group() -> bpy.types.ShaderNodeTree:
    """Six random numbers per shading point."""
    names = {f"Random {k}": "float" for k in range(1, 7)}
    return node_group("MM Random Numbers", {}, names, random_numbers)


def mirror_closure(wi_world: Any, incoming: Any, weight: Any) -> Any:
    """Glossy closure of roughness 0 that sends the path along wi with this weight (f cos / pdf)."""
    half = expr.normalize(wi_world + incoming)
    made = expr.node(
        "ShaderNodeBsdfAnisotropic",
        {"distribution": "GGX"},
        {"Color": weight, "Roughness": 0.0, "Normal": half},
    )
    return expr.Scalar(made.outputs[0])


def reference_group(
    name: str, lookup: bpy.types.ShaderNodeTree, sampler: bpy.types.ShaderNodeTree
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint) to a shader: the tabulated BRDF, mirror only."""

    def build(normal: Any, tint: Any) -> Any:
        geometry = expr.node("ShaderNodeNewGeometry", {}, {})
        incoming = expr.Vector(geometry.outputs["Incoming"])
        u = call(random_numbers_group())
        wo, tangent, bitangent = call(viewer_frame_group(), normal, incoming)
        wi, pdf = call(sampler, wo, *u[:4])
        cosine = expr.components(wi)[2]
        # Below the horizon nothing is reflected: the closure vanishes and Cycles drops it.
        gain = expr.divide(expr.maximum(cosine, 0.0), pdf)
        weight = expr.scale(call(lookup, wi, wo, u[4]), gain) * tint
        return mirror_closure(to_world(wi, tangent, bitangent, normal), incoming, weight)

    return node_group(name, {"Normal": "vector", "Tint": "vector"}, {"BSDF": "shader"}, build)
