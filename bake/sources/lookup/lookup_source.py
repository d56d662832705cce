"""A measurement that is looked up: the part of a source that formats share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...source import Array, Facts

CHUNK = 1 << 15
# cos(pi / 2) is not 0 in floating point, yet such a direction lies on the horizon.
HORIZON_COS = 1e-7


@dataclass(frozen=True)
class LookupSource:
    """A `BrdfSource` whose values come from one function of direction pairs above the horizon.

    Parameters
    ----------
    lookup : (n, 3) wi, (n, 3) wo, float64, to (n, 3) BRDF values in 1/sr, linear Rec.709
    patches : of the light and of the viewer, within which all values are constant; see `bake.patches.patches_of`
    """

    name: str
    lookup: Callable[[Array, Array], Array]
    facts: Facts
    isotropic: bool
    bilateral: bool
    patches: str = field(default="", kw_only=True)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr without the cosine, 0 on and below the horizon; see `BrdfSource.evaluate`."""
        return above_horizon(self.lookup, wi, wo, CHUNK)


def above_horizon(lookup: Callable[[Array, Array], Array], wi: Array, wo: Array, chunk: int) -> Array:
    """Values (..., 3) of direction pairs, 0 on and below the horizon; `lookup` gets the others, float64, in chunks."""
    wi, wo = np.broadcast_arrays(wi, wo)
    shape = wi.shape[:-1]
    count = math.prod(shape)
    result = np.zeros((count, 3))
    for start in range(0, count, chunk):
        # indexing keeps broadcast arguments from being copied as a whole
        pick = np.unravel_index(np.arange(start, min(start + chunk, count)), shape) if shape else ()
        block_i, block_o = (np.asarray(w[pick], np.float64).reshape(-1, 3) for w in (wi, wo))
        above = (block_i[:, 2] > HORIZON_COS) & (block_o[:, 2] > HORIZON_COS)
        if above.any():
            result[start : start + chunk][above] = lookup(block_i[above], block_o[above])
    return result.reshape(*shape, 3)


@dataclass(frozen=True)
class Axis:
    """Nodes of a grid along one coordinate: ascending, and around a circle where there is a `period`."""

    nodes: Array
    period: float = 0.0

    def cell(self, x: Array) -> tuple[Array, Array, Array]:
        """Indices of the nodes below and above, and how far x lies between them; the ends hold beyond them."""
        n = self.nodes.size
        if n == 1:
            zero = np.zeros(x.shape, np.intp)
            return zero, zero, np.zeros(x.shape)
        nodes = self.nodes
        if self.period:
            x = nodes[0] + np.remainder(x - nodes[0], self.period)
            nodes = np.append(nodes, nodes[0] + self.period)
        lower = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
        share = np.clip((x - nodes[lower]) / (nodes[lower + 1] - nodes[lower]), 0.0, 1.0)
        return lower, (lower + 1) % n, share


def interpolate(axes: tuple[Axis, ...], table: Array, *coordinates: Array) -> Array:
    """Multilinear interpolation.

    Parameters
    ----------
    axes : one for each coordinate
    table : (len of each axis' nodes..., C)
    coordinates : (n,) each

    Returns
    -------
    (n, C)
    """
    cells = [axis.cell(x) for axis, x in zip(axes, coordinates, strict=True)]
    strides = np.cumprod([1, *table.shape[-2:0:-1]])[::-1]
    rows = table.reshape(-1, table.shape[-1])
    # Corners share what the axes before have made of them; the first axis is the fastest.
    corners: list[tuple[Any, Any]] = [(0, 1.0)]
    for stride, (lower, upper, share) in zip(strides, cells, strict=True):
        ends = (lower * stride, 1 - share), (upper * stride, share)
        corners = [(index + place, weight * part) for place, part in ends for index, weight in corners]
    total = np.zeros((len(coordinates[0]), table.shape[-1]))
    for index, weight in corners:
        if weight.any():
            # Fancy indexing takes several times as long as `take`.
            total += weight[:, None] * rows.take(index, 0)
    return total


def azimuth_between(wi: Array, wo: Array) -> Array:
    """Angle between the azimuths of directions (n, 3), in [0, pi]; where one is the normal, 0."""
    cross = wi[:, 0] * wo[:, 1] - wi[:, 1] * wo[:, 0]
    return np.abs(np.arctan2(cross, wi[:, 0] * wo[:, 0] + wi[:, 1] * wo[:, 1]))


def azimuth_of(direction: Array) -> Array:
    """Azimuth of directions (n, 3) in (-pi, pi]; of the normal itself 0."""
    return np.arctan2(direction[:, 1], direction[:, 0])


def grey(values: Array) -> Array:
    """One channel (...) as three (..., 3)."""
    return np.repeat(values[..., None], 3, -1)


def negative_facts(values: Array) -> dict[str, float]:
    """What a source tells of negative entries, which a bake counts and treats."""
    return {"negative_share": float((values < 0).mean()), "most_negative": float(min(values.min(initial=0.0), 0.0))}
