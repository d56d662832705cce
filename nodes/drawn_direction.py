"""One light direction for this sample, drawn from the material or towards a lamp, with its whole density."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy

from . import expr
from .aimed_light_group import MAX_SLOTS, aimed_light_group
from .gloss_group import seen_above, seen_from_table, seen_in_table
from .group import call
from .lens_group import lens_group
from .local_frame_group import to_world, viewer_frame_group
from .stochastic_mirror_group import mirror_closure, more_random_numbers_group, random_numbers_group
from .tangent_frame_group import tangent_frame_group
from .through_closure import through_closure


@dataclass(frozen=True)
class DrawnDirection:
    """`wi` and `wo` local, `wi_world` and `incoming` not; `pdf` of wi; `random` two numbers that nothing has used.

    `roulette` is a third one where directions are aimed, and their weights may be as small as lamps are; else None.
    Under a gloss wi and its density are of the table, `wi_world` is where it is seen, and `above` whether that is above
    the horizon. Of light that comes through a sheet wi is mirrored in it: above the horizon as the viewer is, while
    `wi_world` lies on the far side.
    """

    wi: Any
    wo: Any
    wi_world: Any
    incoming: Any
    pdf: Any
    random: tuple[Any, Any]
    roulette: Any = None
    above: Any = 1.0
    through: bool = False

    def mirror(self, weight: Any) -> Any:
        """Closure that sends the path along wi with this weight."""
        if self.through:
            return through_closure(self.wi_world, self.incoming, weight, self.roulette)
        return mirror_closure(self.wi_world, self.incoming, weight, self.roulette)

    @property
    def cosine(self) -> Any:
        """cos(theta_i), 0 below the horizon: nothing is reflected there, and Cycles drops a closure of weight 0."""
        return expr.maximum(expr.components(self.wi)[2], 0.0) * self.above


def drawn_direction(
    normal: Any,
    sample: Callable[..., tuple[Any, Any]],
    density: Callable[[Any, Any], Any],
    lamps: bpy.types.Image | None = None,
    tangent: Any = None,
    gloss: Any = None,
    through: bool = False,
    concentration: float = 0.0,
    most_lamps: int = MAX_SLOTS,
) -> DrawnDirection:
    """Draw a direction.

    Parameters
    ----------
    normal : shading normal, world
    sample : (wo, four random numbers) to local (wi, pdf)
    density : (wi, wo) to that pdf for any wi; used with `lamps` only
    lamps : table of lamps to aim at by one-sample MIS with the balance heuristic over all of them
    tangent : of the surface, world, in whose frame wi and wo are local; by default in the viewer's own
    gloss : factor of the half vector's slopes, see `bake.sampling.gloss`; by default none
    through : of light from the far side of a sheet
    concentration : of the sampler, by which lamps that are wider than its lobes are aimed at less often
    most_lamps : that there is room to aim at, see `aimed_light_group`
    """
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    incoming = expr.Vector(geometry.outputs["Incoming"])
    u = call(random_numbers_group())
    u = (*call(lens_group(), *u[:2]), *u[2:])
    wo, along, across = frame_of(normal, incoming, tangent)
    wi, pdf = sample(wo, *u[:4])
    seen = wi if gloss is None else seen_from_table(wi, wo, gloss)[0]
    up = expr.scale(normal, -1.0) if through else normal
    world = to_world(seen, along, across, up)
    roulette = None
    if lamps is not None:
        position = expr.Vector(geometry.outputs["Position"])
        more = call(more_random_numbers_group())
        # A draw takes either the material's direction or the lamp's: the same two numbers may place both.
        world, aimed, rest = call(
            aimed_light_group(lamps, most=most_lamps), position, up, world, *more[:2], u[0], u[1], concentration
        )
        roulette = more[2]
        wi = seen = expr.vec(*(expr.dot(world, axis) for axis in (along, across, up)))
        if gloss is not None:
            wi, spread = seen_in_table(seen, wo, gloss)
            aimed = expr.divide(aimed, spread)
        pdf = aimed + rest * density(wi, wo)
    above = 1.0 if gloss is None else seen_above(seen, gloss)
    return DrawnDirection(wi, wo, world, incoming, pdf, u[4:6], roulette, above, through)


def frame_of(normal: Any, incoming: Any, tangent: Any = None) -> tuple[Any, Any, Any]:
    """Local wo, and the two tangents in world space: of the surface's tangent or, without one, of the viewer."""
    if tangent is None:
        wo, along, across = call(viewer_frame_group(), normal, incoming)
    else:
        wo, along, across = call(tangent_frame_group(), normal, incoming, tangent)
    return wo, along, across
