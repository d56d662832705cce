"""Tables over the unit square: bilinear values, and the inverse of the warp to a bilinear density.

Both come as stacks of slices, one for each measured incident direction, that are blended with weights.
Positions are (n,) arrays; u runs along a table's last axis, v along the one before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..source import Array

# Slices to blend: pairs of slice index (n,) and weight (n,).
Slices = list[tuple[Array, Array]]


class Bracket(NamedTuple):
    """Lower node (n,), step to the upper one (0 on a grid of one), and the upper one's weight (n,)."""

    node: Array
    step: int
    weight: Array

    def ends(self) -> Slices:
        """The nodes on either side with their weights; a grid of one has a single node."""
        if self.step == 0:
            return [(self.node, np.ones(self.weight.shape))]
        return [(self.node, 1 - self.weight), (self.node + 1, self.weight)]


def _bracket_uniform(position: Array, size: int) -> Bracket:
    """Bracket of positions in [0, 1] on `size` evenly spaced nodes, the first at 0 and the last at 1."""
    scaled = np.clip(position, 0, 1) * (size - 1)
    index = np.minimum(scaled.astype(np.intp), size - 2)
    return Bracket(index, 1, scaled - index)


def bracket(nodes: Array, value: Array) -> Bracket:
    """Bracket among ascending nodes; values outside take the end node's."""
    if nodes.size == 1:
        return Bracket(np.zeros(value.shape, np.intp), 0, np.zeros(value.shape))
    index = np.clip(np.searchsorted(nodes, value, side="right") - 1, 0, nodes.size - 2)
    weight = (value - nodes[index]) / (nodes[index + 1] - nodes[index])
    return Bracket(index, 1, np.clip(weight, 0, 1))


def _lerp(a: Array, b: Array, t: Array) -> Array:
    return a + t * (b - a)


def _bilinear(table: Array, x: Bracket, y: Bracket, offset: Array | int = 0) -> Array:
    """Bilinear values (n, ...) of a table flattened to nodes (n_nodes, ...), rows along y.

    `offset` is the first node of the table's slice; the row length is y's step.
    """
    corner = offset + y.node * y.step + x.node
    extra = (slice(None),) + (None,) * (table.ndim - 1)
    fx, fy = x.weight[extra], y.weight[extra]
    low = _lerp(table.take(corner, 0), table.take(corner + x.step, 0), fx)
    high = _lerp(table.take(corner + y.step, 0), table.take(corner + y.step + x.step, 0), fx)
    return _lerp(low, high, fy)


class Grid:
    """Table (n_slices, height, width, ...) over the unit square, bilinear, one slice per `wi`."""

    def __init__(self, table: Array) -> None:
        self.height, self.width = table.shape[1:3]
        self.nodes = np.ascontiguousarray(table, dtype=np.float64).reshape(-1, *table.shape[3:])

    def bracket(self, u: Array, v: Array) -> tuple[Bracket, Bracket]:
        """Places (x, y) between the nodes around positions (u, v) in the unit square."""
        y = _bracket_uniform(v, self.height)
        return _bracket_uniform(u, self.width), y._replace(step=self.width)

    def evaluate(self, u: Array, v: Array, slices: Slices | None = None) -> Array:
        """Values (n, ...) at (u, v), summed over `slices`, pairs of slice index (n,) and weight (n,)."""
        x, y = self.bracket(u, v)
        if slices is None:
            return _bilinear(self.nodes, x, y)
        total: Array = np.zeros((u.size, *self.nodes.shape[1:]))
        extra = (slice(None),) + (None,) * (self.nodes.ndim - 1)
        for index, weight in slices:
            total += weight[extra] * _bilinear(self.nodes, x, y, index * (self.height * self.width))
        return total


class WarpInverse:
    """Inverse of the warp that turns uniform points of the unit square into a bilinear density.

    The warp picks v by the marginal density of the rows, then u by the density along the interpolated row;
    its inverse is therefore the marginal CDF of v and the conditional CDF of u given v. Both are integrals of
    (bi)linear functions, hence quadratic within a cell. Everything is linear in the density, so slices mix.
    """

    def __init__(self, density: Array) -> None:
        rows = np.zeros(density.shape)
        np.cumsum((density[..., 1:] + density[..., :-1]) / 2, axis=-1, out=rows[..., 1:])
        totals = rows[..., -1]
        marginal = np.zeros(totals.shape)
        np.cumsum((totals[..., 1:] + totals[..., :-1]) / 2, axis=-1, out=marginal[..., 1:])
        scale = 1 / marginal[..., -1]
        self.density = Grid(density * scale[:, None, None])
        self.rows = (rows * scale[:, None, None]).ravel()
        self.totals = (totals * scale[:, None]).ravel()
        self.marginal = (marginal * scale[:, None]).ravel()

    def __call__(self, u: Array, v: Array, slices: Slices) -> tuple[Array, Array]:
        """The points (n,), (n,) of the unit square that the warp of the weighted slices sends to (u, v)."""
        x, y = self.density.bracket(u, v)
        width, height = self.density.width, self.density.height
        # density at the cell's left and right edge, integral up to the left edge: all at height v
        left, right, before = np.zeros((3, u.size))
        below, above, rows_before = np.zeros((3, u.size))
        nodes = self.density.nodes
        for index, weight in slices:
            row = index * height + y.node
            corner = row * width + x.node
            left += weight * _lerp(nodes.take(corner), nodes.take(corner + width), y.weight)
            right += weight * _lerp(nodes.take(corner + 1), nodes.take(corner + width + 1), y.weight)
            before += weight * _lerp(self.rows.take(corner), self.rows.take(corner + width), y.weight)
            below += weight * self.totals.take(row)
            above += weight * self.totals.take(row + 1)
            rows_before += weight * self.marginal.take(row)
        conditional = before + x.weight * _lerp(left, right, x.weight / 2)
        row_total = _lerp(below, above, y.weight)
        # a row without density is reached by no sample; any point of it will do
        s = np.where(row_total > 0, conditional / np.where(row_total > 0, row_total, 1), u)
        t = rows_before + y.weight * _lerp(below, above, y.weight / 2)
        return np.clip(s, 0, 1), np.clip(t, 0, 1)
