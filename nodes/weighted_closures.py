"""Native closures with weights that depend on the viewer: an envelope, or those of mode Preview (method.md, section 9).

Weights of an isotropic material depend on theta_o alone, those of an anisotropic one on the azimuth too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.envelope import texture_coordinate
from ..bake.envelope.anisotropic_lobes import AnisotropicLobe
from ..bake.envelope.texture import row_coordinate
from ..bake.envelope.viewers import ViewerGrid, Viewers
from ..bake.lobes.lobes import Lobe
from . import expr
from .adjustments import Adjustments
from .drawn_direction import frame_of
from .native_closure import add_closures, native_closure, translucent_closure


@dataclass(frozen=True)
class WeightedClosures:
    """Closures, and their weights as a texture of `bake.envelope.texture`.

    Parameters
    ----------
    viewers : at which weights are known: elevations, or a grid of two angles
    tangent : of the surface, in world space, along which the first of a closure's widths lies; None where there is one
    gloss : divides the widths of GGX closures; None leaves them as fitted
    through : of a sheet's transmission: what is Lambertian is Translucent BSDF
    """

    closures: Sequence[Lobe | AnisotropicLobe]
    image: bpy.types.Image
    viewers: Viewers
    tangent: Any = None
    gloss: Any = None
    through: bool = False

    def weights(self, wo: Any) -> list[tuple[Any, Any]]:
        """Colour and alpha of each closure, seen from local wo."""
        count = len(self.closures)
        u = texture_coordinate(expr, wo, self.viewers.shape[0])
        if isinstance(self.viewers, ViewerGrid):
            rows = [row_coordinate(expr, self.viewers, wo, k, count) for k in range(count)]
        else:
            rows = [1 - (k + 0.5) / count for k in range(count)]
        return [expr.image_tap(self.image, u, row, "Linear") for row in rows]

    def closure(self, weights: list[tuple[Any, Any]], normal: Any, adjustments: Adjustments, factor: Any = 1.0) -> Any:
        """Sum of the closures, adjusted, times a scalar."""
        colours = [adjustments.apply(colour, factor) for colour, _ in weights]
        if self.through:
            return add_closures([translucent_closure(colour, normal) for colour in colours])
        parts = [
            native_closure(lobe, colour, normal, self.tangent, self.gloss)
            for lobe, colour in zip(self.closures, colours, strict=True)
        ]
        return add_closures(parts)

    def alone(self, normal: Any, adjustments: Adjustments, factor: Any = 1.0) -> Any:
        """The closures by themselves."""
        incoming = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Incoming"])
        wo, _, _ = frame_of(normal, incoming, self.tangent)
        return self.closure(self.weights(wo), normal, adjustments, factor)
