"""Native closures with weights that depend on theta_o: an envelope, or those of mode Preview (DESIGN.md section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.envelope import texture_coordinate
from ..bake.shading.lobes import Lobe
from . import expr
from .group import call
from .local_frame_group import viewer_frame_group
from .native_closure import add_closures, native_closure


@dataclass(frozen=True)
class WeightedClosures:
    """Closures, and their weights as a texture over theta_o: one row for each, `nodes` texels wide."""

    closures: tuple[Lobe, ...]
    image: bpy.types.Image
    nodes: int

    def weights(self, wo: Any) -> list[tuple[Any, Any]]:
        """Colour and alpha of each row, seen from local wo."""
        u = texture_coordinate(expr, wo, self.nodes)
        rows = len(self.closures)
        return [expr.image_tap(self.image, u, 1 - (k + 0.5) / rows, "Linear") for k in range(rows)]

    def closure(self, weights: list[tuple[Any, Any]], normal: Any, factor: Any) -> Any:
        """Their sum, times a colour."""
        parts = [native_closure(lobe, colour * factor, normal) for lobe, (colour, _) in zip(self.closures, weights)]
        return add_closures(parts)


def preview_closure(preview: WeightedClosures, normal: Any, tint: Any) -> Any:
    """The closures alone."""
    incoming = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Incoming"])
    wo, _, _ = call(viewer_frame_group(), normal, incoming)
    return preview.closure(preview.weights(wo), normal, tint)
