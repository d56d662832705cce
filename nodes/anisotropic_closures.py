"""Anisotropic native closures whose weights depend on the viewer's elevation and azimuth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.envelope import ViewerGrid, texture_coordinate
from ..bake.envelope.anisotropic_lobes import AnisotropicLobe
from ..bake.envelope.texture import row_coordinate
from . import expr
from .group import call
from .native_closure import add_closures
from .tangent_frame_group import tangent_frame_group


def anisotropic_native_closure(lobe: AnisotropicLobe, weight: Any, normal: Any, tangent: Any) -> Any:
    """Cycles' own closure of a lobe times a colour; `tangent` in world space."""
    if lobe.name == "lambert":
        made = expr.node("ShaderNodeBsdfDiffuse", {}, {"Color": weight, "Roughness": 0.0, "Normal": normal})
        return expr.Scalar(made.outputs[0])
    inputs = {
        "Color": weight,
        "Roughness": lobe.roughness,
        "Anisotropy": lobe.anisotropy,
        "Rotation": 0.0,
        "Normal": normal,
        "Tangent": tangent,
    }
    return expr.Scalar(expr.node("ShaderNodeBsdfAnisotropic", {"distribution": "GGX"}, inputs).outputs[0])


@dataclass(frozen=True)
class AnisotropicClosures:
    """Closures, and their weights as a texture of `bake.envelope.texture`; as `WeightedClosures`.

    `tangent` is the surface's, in world space.
    """

    closures: tuple[AnisotropicLobe, ...]
    image: bpy.types.Image
    grid: ViewerGrid
    tangent: Any = None

    def weights(self, wo: Any) -> list[tuple[Any, Any]]:
        """Colour and alpha of each closure, seen from local wo."""
        u, count = texture_coordinate(expr, wo, self.grid.n_theta), len(self.closures)
        return [
            expr.image_tap(self.image, u, row_coordinate(expr, self.grid, wo, k, count), "Linear") for k in range(count)
        ]

    def closure(self, weights: list[tuple[Any, Any]], normal: Any, factor: Any) -> Any:
        """Their sum, times a colour."""
        parts = [
            anisotropic_native_closure(lobe, colour * factor, normal, self.tangent)
            for lobe, (colour, _) in zip(self.closures, weights)
        ]
        return add_closures(parts)

    def alone(self, normal: Any, tint: Any) -> Any:
        """The closures by themselves."""
        incoming = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Incoming"])
        wo, _, _ = call(tangent_frame_group(), normal, incoming, self.tangent)
        return self.closure(self.weights(wo), normal, tint)
