"""A path sent through a sheet, in a direction that the shader has drawn."""

from __future__ import annotations

from typing import Any

from . import expr
from .native_closure import choose_closure
from .stochastic_mirror_group import kept_where_wanted

# A perfect refraction leads anywhere below but within asin(1 / IOR) of the plane at right angles to the viewer, and
# its normal still tells float32 one direction from another.
IOR = 50.0
PORTAL = "ShaderNodeBsdfRayPortal"


def seen_from_behind() -> Any:
    """1 where the surface is seen from its back, else 0."""
    return expr.Scalar(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Backfacing"])


def is_bent(wi_world: Any, incoming: Any) -> Any:
    """1 where a perfect Refraction BSDF leads along wi, as a ray of its own kind; else a Ray Portal has to."""
    return expr.dot(incoming, wi_world) < -1 / IOR - 1e-4


def through_closure(wi_world: Any, incoming: Any, weight: Any, random: Any = None, wanted: Any = 1.0) -> Any:
    """Closure that sends the path along wi, on the far side of the surface, with this weight (f cos / pdf).

    A perfect Refraction BSDF by Snell's law about the normal -(wo + n wi), which keeps Cycles' ray types and passes,
    where there is one, n wo . wi < -1; elsewhere a Ray Portal, to the place where it is.

    Parameters
    ----------
    random, wanted : as of `mirror_closure`, where weights may be as small as lamps are
    """
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    if random is not None:
        weight = expr.scale(weight, kept_where_wanted(weight, random, wanted))
    normal = expr.normalize(expr.scale(incoming + expr.scale(wi_world, IOR), -1.0))
    # Seen from behind, Cycles takes the reciprocal.
    index = expr.where(seen_from_behind(), 1 / IOR, IOR)
    refraction = expr.node(
        "ShaderNodeBsdfRefraction",
        {"distribution": "GGX"},
        {"Color": weight, "Roughness": 0.0, "IOR": index, "Normal": normal},
    )
    place = {"Position": expr.Vector(geometry.outputs["Position"]), "Direction": wi_world}
    portal = expr.node(PORTAL, {}, {"Color": weight, **place})
    bent = is_bent(wi_world, incoming)
    return choose_closure(bent, expr.Scalar(portal.outputs[0]), expr.Scalar(refraction.outputs[0]))
