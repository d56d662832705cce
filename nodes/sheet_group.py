"""Node group: a thin sheet, reflection and transmission of the side that is seen (addon/docs/method.md, section 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import bpy

from . import expr
from .adjustments import GLOSS, LIMITS, NEUTRAL, Adjustments
from .brdf_group import BrdfParts, after_diffuse, brdf_inputs
from .drawn_direction import DrawnDirection
from .exclusive_closures import all_of, one_of
from .gloss_group import held_gloss
from .group import call, node_group
from .lamp_light_groups import LightTables
from .lamp_share_group import lamp_share_group, lamp_side_group
from .native_closure import add_closures, choose_closure
from .sampled_sheet import sampled_sheet
from .surface_marker import mean_roughness, with_marker
from .through_closure import seen_from_behind
from .weighted_closures import WeightedClosures

# Of two mirrors that exclude each other neither is drawn more rarely than this part of what it would be alone.
_LEAST = 0.1


def held_share(share: float) -> float:
    """The share of what is reflected, so that neither of two mirrors is all but forgotten."""
    return min(max(share, _LEAST), 1 - _LEAST)


@dataclass(frozen=True)
class SheetSide:
    """Parts of what a viewer of one side sees; None for what is black.

    Parameters
    ----------
    reflected, through : reflection and transmission
    share : of the light under a white sky that is reflected, by which one of two mirrors is chosen
    lamps : table of lamps where hardly any other light arrives, whose side then decides; else None
    """

    reflected: BrdfParts | None
    through: BrdfParts | None
    share: float
    lamps: bpy.types.Image | None = None

    @property
    def parts(self) -> list[BrdfParts]:
        """What there is."""
        return [part for part in (self.reflected, self.through) if part is not None]

    @property
    def reflected_share(self) -> float:
        """`share`, held."""
        return held_share(self.share)

    def shares(self, normal: Any) -> list[Any]:
        """How the mirrors' probability is divided between the parts: all of it is that of a single mirror."""
        if sum(part.table is not None for part in self.parts) < 2:
            return [1.0 for _ in self.parts]
        share: Any = self.reflected_share
        if self.lamps is not None:
            share = call(lamp_side_group(self.lamps, _LEAST), normal, share)
        return [share, 1 - share]

    def placed(self, gloss: Any, tangent: Any) -> SheetSide:
        """The same under a gloss, and in the frame of a tangent."""
        reflected, through = (None if p is None else p.placed(gloss, tangent) for p in (self.reflected, self.through))
        return replace(self, reflected=reflected, through=through)

    def preview(self, normal: Any, adjustments: Adjustments) -> Any:
        """Native closures alone."""
        return add_closures([p.preview.alone(normal, adjustments) for p in self.parts if p.preview is not None])

    def traced(self, normal: Any, adjustments: Adjustments, lights: LightTables | None = None) -> Any:
        """Closure that is as good as the tables; where there are `lights`, the shader samples them.

        Mirrors and native closures exclude each other, as in `exact_closure`, and so do the two mirrors: each is drawn
        with its share of its part's light times its part's share, what is left draws the closures of both. Where
        nothing is aimed at, all are added and Cycles chooses.
        """
        if lights is not None and any(part.table is not None for part in self.parts):
            return sampled_sheet(self.reflected, self.through, self.reflected_share, normal, adjustments, lights)
        drawn: list[tuple[DrawnDirection, Any, Any]] = []
        native: list[Callable[[Any], Any]] = []
        added = len(self.parts) > 1 and all(part.lamps is None for part in self.parts)
        shares = [1.0 for _ in self.parts] if added else self.shares(normal)
        for part, share in zip(self.parts, shares, strict=True):
            if part.table is None:
                assert part.envelope is not None
                native.append(_closures(part.envelope, normal, adjustments))
                continue
            one = part.table.draw(normal, part.lamps)
            chance: Any = share
            if part.envelope is not None:
                weights = part.envelope.weights(one.wo)
                if not added:
                    chance = _mirror_chance(part, one, weights[0][1], normal) * share
                native.append(_closures(part.envelope, normal, adjustments, weights))
            value = call(part.table.lookup, one.wi, one.wo, one.random[0])
            weight = expr.scale(value, expr.divide(one.cosine, one.pdf * chance))
            drawn.append((one, chance, one.mirror(adjustments.apply(weight))))
        return (all_of if added else one_of)(drawn, native)


def _mirror_chance(part: BrdfParts, drawn: DrawnDirection, usual: Any, normal: Any) -> Any:
    """Of a part's mirror beside its native closures, as in `exact_closure`."""
    if part.shares is None or part.lamps is None or part.table is None:
        return usual
    tangent = () if part.table.tangent is None else (part.table.tangent,)
    return call(lamp_share_group(part.shares, part.lamps), drawn.wo, normal, usual, part.table.gloss, *tangent)


def _closures(
    envelope: WeightedClosures, normal: Any, adjustments: Adjustments, weights: Any = None
) -> Callable[[Any], Any]:
    """Closures by the factor of their weights."""
    if weights is None:
        return lambda factor: envelope.alone(normal, adjustments, factor)
    return lambda factor: envelope.closure(weights, normal, adjustments, factor)


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
    return choose_closure(seen_from_behind(), *sides)
