"""Node group: a thin sheet, reflection and transmission of the side that is seen (addon/docs/method.md, section 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy

from . import expr
from .adjustments import GLOSS, LIMITS, NEUTRAL, Adjustments
from .brdf_group import BrdfParts, after_diffuse, brdf_inputs
from .drawn_direction import DrawnDirection
from .gloss_group import held_gloss
from .group import call, node_group
from .lamp_light_groups import LightTables
from .native_closure import add_closures, choose_closure
from .sampled_sheet import sampled_sheet
from .surface_marker import mean_roughness, with_marker
from .weighted_closures import WeightedClosures

# Of two mirrors that exclude each other neither is drawn more rarely than this part of what it would be alone.
_LEAST = 0.1


@dataclass(frozen=True)
class SheetSide:
    """Parts of what a viewer of one side sees; None for what is black.

    Parameters
    ----------
    reflected, through : reflection and transmission
    share : of the light under a white sky that is reflected, by which one of two mirrors is chosen
    """

    reflected: BrdfParts | None
    through: BrdfParts | None
    share: float

    @property
    def parts(self) -> list[tuple[BrdfParts, float]]:
        """What there is, and how the mirrors' probability is divided between them."""
        alone = sum(part.table is not None for part, _ in self.shared) < 2
        return [(part, 1.0 if alone else share) for part, share in self.shared]

    @property
    def shared(self) -> list[tuple[BrdfParts, float]]:
        """What there is, each with about its share of the light under a white sky."""
        share = min(max(self.share, _LEAST), 1 - _LEAST)
        return [(p, s) for p, s in ((self.reflected, share), (self.through, 1 - share)) if p is not None]

    def placed(self, gloss: Any, tangent: Any) -> SheetSide:
        """The same under a gloss, and in the frame of a tangent."""
        reflected, through = (None if p is None else p.placed(gloss, tangent) for p in (self.reflected, self.through))
        return SheetSide(reflected, through, self.share)

    def preview(self, normal: Any, adjustments: Adjustments) -> Any:
        """Native closures alone."""
        return add_closures([p.preview.alone(normal, adjustments) for p, _ in self.parts if p.preview is not None])

    def traced(self, normal: Any, adjustments: Adjustments, lights: LightTables | None = None) -> Any:
        """Closure that is as good as the tables; where there are `lights`, the shader samples them.

        Mirrors and native closures exclude each other, as in `exact_closure`, and so do the two mirrors: each is drawn
        with its share of its part's light times its part's share, what is left draws the closures of both.
        """
        if lights is not None and any(part.table is not None for part, _ in self.parts):
            return sampled_sheet(self.shared, normal, adjustments, lights)
        drawn: list[tuple[DrawnDirection, Any, Any]] = []
        native: list[Callable[[Any], Any]] = []
        for part, share in self.parts:
            if part.table is None:
                assert part.envelope is not None
                native.append(_closures(part.envelope, normal, adjustments))
                continue
            one = part.table.draw(normal, part.lamps)
            chance: Any = share
            if part.envelope is not None:
                weights = part.envelope.weights(one.wo)
                chance = weights[0][1] * share
                native.append(_closures(part.envelope, normal, adjustments, weights))
            value = call(part.table.lookup, one.wi, one.wo, one.random[0])
            weight = expr.scale(value, expr.divide(one.cosine, one.pdf * chance))
            drawn.append((one, chance, one.mirror(adjustments.apply(weight))))
        return _one_of(drawn, native)


def _closures(
    envelope: WeightedClosures, normal: Any, adjustments: Adjustments, weights: Any = None
) -> Callable[[Any], Any]:
    """Closures by the factor of their weights."""
    if weights is None:
        return lambda factor: envelope.alone(normal, adjustments, factor)
    return lambda factor: envelope.closure(weights, normal, adjustments, factor)


def _one_of(drawn: list[tuple[DrawnDirection, Any, Any]], native: list[Callable[[Any], Any]]) -> Any:
    """One of the mirrors, each with its probability, or else all native closures."""
    if not drawn:
        return add_closures([closure(1.0) for closure in native])
    random, upto = drawn[0][0].random[1], [drawn[0][1]]
    for _, chance, _ in drawn[1:]:
        upto.append(upto[-1] + chance)
    if native:
        left = expr.divide(1.0, 1 - upto[-1])
        chosen = add_closures([closure(left) for closure in native])
    else:
        chosen, drawn, upto = drawn[-1][2], drawn[:-1], upto[:-1]
    for (_, _, mirror), limit in reversed(list(zip(drawn, upto, strict=True))):
        chosen = choose_closure(random < limit, chosen, mirror)
    return chosen


def sheet_group(
    name: str,
    mode: str,
    front: SheetSide,
    back: SheetSide | None,
    *,
    anisotropic: bool,
    normals: bool,
    lights: LightTables | None = None,
) -> bpy.types.ShaderNodeTree:
    """The inputs of `brdf_inputs` to a shader, and to one for EEVEE; without a back, the front is both.

    With `lights` the shader samples what they hold, in modes "exact" and "balanced".
    """
    inputs = brdf_inputs(anisotropic)

    def build(*values: Any) -> Any:
        named = dict(zip(inputs, values, strict=True))
        normal, adjustments = named["Normal"], Adjustments.among(named)
        sides = [side.placed(held_gloss(named[GLOSS]), named.get("Tangent")) for side in (front, back) if side]
        preview = _seen([side.preview(normal, adjustments) for side in sides])
        if mode == "preview":
            return preview, preview
        sampled = None if mode == "reference" else lights
        traced = _seen([side.traced(normal, adjustments, sampled) for side in sides])
        if mode == "balanced":
            traced = choose_closure(after_diffuse(), traced, preview)
        shown = sides[0].reflected
        roughness = mean_roughness(shown.preview if shown is not None else None)
        return with_marker(traced, normal, roughness, always=normals), preview

    return node_group(name, inputs, {"BSDF": "shader", "EEVEE": "shader"}, build, NEUTRAL, limits=LIMITS)


def _seen(sides: list[Any]) -> Any:
    """The closure of the side that is seen."""
    if len(sides) < 2:
        return sides[0]
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    return choose_closure(expr.Scalar(geometry.outputs["Backfacing"]), *sides)
