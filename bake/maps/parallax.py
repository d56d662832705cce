"""Parallax: which point of a swatch's relief a viewer sees, where flat photographs of it are looked up.

Photographs from straight above show every point of the relief where it lies. Seen obliquely, what is high appears
further from the viewer than where it lies, and hides what is behind it. So coordinates are moved to where the viewer's
ray meets the relief: through even layers of its height from the top down, then by one step of the secant (Policarpo,
Oliveira & Comba 2005; with the secant Tatarchuk 2006). Nothing is shaded or shadowed by the relief, which the
photographs show.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# Steps from the top of the relief to its bottom.
LAYERS = 8
# Of a viewer's angle to the normal: what is seen more obliquely is moved no further.
LEAST_COSINE = 0.2


def seen_at(
    xp: Any, height: Callable[[Any], Any], place: Any, step: Any, low: float, high: float, layers: int = LAYERS
) -> Any:
    """Where the viewer's ray meets the relief first, from above: coordinates (..., 3), linear in its height there.

    Relief that is narrower than the ray's way through one layer may be passed by.

    Parameters
    ----------
    xp : namespace, numpy or `nodes.expr`
    height : coordinates (..., 3) to the relief's height, from `low` to `high`, in any unit
    place : (..., 3), where the ray is at a height of 0
    step : (..., 3), by how much it moves towards the viewer with every unit of height
    """

    def at(level: Any) -> Any:
        return place + xp.scale(step, level)

    thickness = (high - low) / layers
    # The highest layer that the relief exceeds; if none, the lowest.
    risen: Any = 0.0
    for k in range(1, layers):
        level = (layers - k) * thickness
        risen = xp.maximum(risen, (height(at(low + level)) > low + level) * level)
    below = risen + low
    above = below + thickness
    inside = xp.maximum(height(at(below)) - below, 0.0)
    outside = xp.maximum(above - height(at(above)), 0.0)
    return at(below + xp.divide(inside, inside + outside) * thickness)
