"""What the surface is, for Cycles' Normal pass and bakes of normal and roughness (method.md, section 15).

Cycles sums a sample's closures for these by their weights. Where that sample is a stochastic mirror it finds the normal
of the mirror's facet, and roughness 0. The marker is a closure that reflects nothing and outweighs them all: the coat
of a Principled BSDF whose index of refraction is 1. Its weight counts there; the choice of a closure to follow, and
light, go by what it reflects, which is nothing to float32's last digits.

A bake of Cycles starts every ray at distance 1 of the surface. That is how the shader knows it, and makes a marker
nowhere else. A picture that meets it by chance, of a camera at distance 1, is the same picture.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.envelope.anisotropic_lobes import AnisotropicLobe
from ..bake.lobes.lobes import PHONG, Lobe
from . import expr
from .gloss_group import glossy_roughness
from .native_closure import add_closures, highlight_roughness
from .weighted_closures import WeightedClosures

# Against the weights of mirrors, which are of the order of 1, and up to tens.
WEIGHT = 1e3
# Cosine at which the viewer grazes: below it float32 makes a reflectance of nothing, 2e-6 at twice this.
_GRAZING = 0.02
# Of what has no highlight: Cycles' own value.
MATTE = 1.0


def surface_marker(normal: Any, roughness: Any, *, always: bool = False) -> Any:
    """Closure that tells Cycles the shading normal and, in a bake, the roughness.

    Parameters
    ----------
    normal : world space
    roughness : as in the Roughness of a closure's node, the root of alpha
    always : for the camera's rays too, for the Normal pass of a view layer
    """
    path = expr.node("ShaderNodeLightPath", {}, {})
    seen = expr.Scalar(path.outputs["Is Camera Ray"])
    baked = expr.math_node("COMPARE", expr.Scalar(path.outputs["Ray Length"]), 1.0, 0.0)
    incoming = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Incoming"])
    faces = expr.dot(normal, incoming) > _GRAZING
    made = expr.node(
        "ShaderNodeBsdfPrincipled",
        {"distribution": "GGX"},
        {
            "Base Color": expr.vec(0.0, 0.0, 0.0),
            "IOR": 1.0,
            "Coat Weight": seen * faces * WEIGHT,
            # A perfect mirror where nobody asks: Cycles then samples no lamp for it.
            "Coat Roughness": roughness * baked if always else roughness,
            "Coat IOR": 1.0,
            "Coat Normal": normal,
            "Normal": normal,
        },
    )
    shown = {0: seen if always else baked, 2: expr.Scalar(made.outputs[0])}
    return expr.Scalar(expr.node("ShaderNodeMixShader", {}, shown).outputs[0])


def with_marker(closure: Any, normal: Any, roughness: Any, *, always: bool) -> Any:
    """A closure and the marker of its surface."""
    return add_closures([closure, surface_marker(normal, roughness, always=always)])


def shows_normals(scene: bpy.types.Scene) -> bool:
    """Whether a view layer holds Cycles' Normal pass."""
    return any(layer.use_pass_normal for layer in scene.view_layers)


def is_marked_for_passes(group: bpy.types.NodeTree) -> bool:
    """Whether a group marks its surface for the camera's rays, not for bakes alone."""
    mixes = (node for node in group.nodes if node.bl_idname == "ShaderNodeMixShader" and node.inputs[0].is_linked)
    return any(node.inputs[0].links[0].from_socket.name == "Is Camera Ray" for node in mixes)


def mean_roughness(closures: WeightedClosures | None) -> Any:
    """Roughness of native closures as Cycles bakes it, seen along the normal: by their weights, matte ones left out."""
    if closures is None:
        return MATTE
    rough: list[Any] = [roughness_of(lobe) for lobe in closures.closures]
    if closures.gloss is not None:
        rough = [
            glossy_roughness(value, closures.gloss) if lobe.name == "ggx" else value
            for lobe, value in zip(closures.closures, rough, strict=True)
        ]
    if len({expr.key_of(value) for value in rough if value is not None}) < 2:
        return next((value for value in rough if value is not None), MATTE)
    third = expr.vec(*[1 / 3] * 3)
    total: Any = 0.0
    weight: Any = 0.0
    for value, (colour, _) in zip(rough, closures.weights(expr.vec(0.0, 0.0, 1.0)), strict=True):
        if value is not None:
            part = expr.dot(colour, third)
            total, weight = part * value + total, part + weight
    return expr.divide(total, weight)


def roughness_of(lobe: Lobe | AnisotropicLobe) -> float | None:
    """Roughness of the native closure like a lobe, None where Cycles leaves it out as matte."""
    if isinstance(lobe, AnisotropicLobe):
        return None if lobe.name == "lambert" else lobe.roughness
    if lobe.name in PHONG:
        return highlight_roughness(lobe)
    return {"ggx": float(lobe.p1) ** 0.5, "sheen": MATTE}.get(lobe.name)
