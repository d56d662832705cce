"""The linear programme of an envelope, for many problems at once, by a primal-dual interior point method.

For each problem (one theta_o and one channel) the weights w >= 0 of K closures c_k are sought that

    maximise    gain . w - price sum_j a_j s_j
    subject to  sum_k values_jk w_k - s_j <= bound_j,   sum_j a_j s_j <= budget,   s >= 0,

where j are directions, a_j their solid angles, bound_j the measured f cos and s_j what the envelope is too high by.

There are few weights and hundreds of directions, so each step comes down to K + 1 unknowns (the weights and the
multiplier of the budget), and all problems take their steps together. Rows and columns are scaled so that every number
lies in [0, 1]; then a strictly feasible start is known, the iterates stay feasible, and the difference of the primal
and dual objectives bounds the error (Mehrotra 1992, On the Implementation of a Primal-Dual Interior Point Method).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..source import Array

_MOST_STEPS = 100
# Longer steps leave some products far below the others, and then stall (tried: 0.9995 takes twice as many).
_TO_BOUNDARY = 0.9
# Added to Newton's matrix in parts of its diagonal. Closures that are sums of others leave it singular, and the next
# ridge is for them; problems that the first one solves would end at a gap of 1e-6 with the last.
_RIDGES = 1e-13, 1e-9, 1e-8
_TINY = 1e-300
_CHUNK = 1 << 15  # directions of all problems solved together; their arrays stay in the cache


@dataclass(frozen=True)
class Solution:
    """`weights` (N, K) >= 0, the `objective` (N,), and the `gap` (N,): relative, the optimum exceeds it by no more."""

    weights: Array
    objective: Array
    gap: Array


def solve(
    values: Array, bounds: Array, areas: Array, gains: Array, budget: float, price: float = 0.0, tolerance: float = 1e-8
) -> Solution:
    """Solve N programmes of K weights and M directions.

    Parameters
    ----------
    values : (N, M, K) >= 0, the closures
    bounds : (N, M) >= 0, what their sum must stay under; a closure that is positive where the bound is 0 gets weight 0
        if the budget is 0
    areas : (N, M) >= 0; a direction of area 0 binds nothing
    gains : (N, K), what a unit of each weight is worth
    budget : the most that sum_j a_j s_j may be, >= 0
    price : of each unit of it
    tolerance : relative, of the objective
    """
    n, m, k = values.shape
    columns = np.ascontiguousarray(np.moveaxis(values, -1, 1))
    weights, gap = np.zeros((n, k)), np.zeros(n)
    together = max(1, _CHUNK // max(m, 1))
    for start in range(0, n, together):
        part = slice(start, start + together)
        inputs = columns[part], bounds[part], areas[part], gains[part]
        weights[part], gap[part] = _solve_together(*inputs, budget, price, tolerance)
    spent = np.maximum(_times(weights, columns) - bounds, 0)
    objective = (gains * weights).sum(-1) - price * (areas * spent).sum(-1)
    return Solution(weights, objective, gap)


def _solve_together(
    columns: Array, bounds: Array, areas: Array, gains: Array, budget: float, price: float, tolerance: float
) -> tuple[Array, Array]:
    """Weights (N, K) and relative gaps (N,); `columns` are the closures' values, (N, K, M)."""
    problem, scale, worth = _scaled(columns, bounds, areas, gains, budget, price)
    weights, gap = np.zeros(gains.shape), np.where(worth > 0, np.inf, 0.0)
    for ridge in _RIDGES:
        unsolved = np.flatnonzero(gap > tolerance)
        if not len(unsolved):
            break
        found, difference = _descend(problem.take(unsolved), ridge, tolerance)
        better = difference < gap[unsolved]
        weights[unsolved[better]], gap[unsolved[better]] = found[better], difference[better]
    return weights / scale, gap


def _descend(problem: _Scaled, ridge: float, tolerance: float) -> tuple[Array, Array]:
    """The best weights (N, K) met on the way to the optimum, and their relative gaps (N,)."""
    weights, gap = np.zeros(problem.c.shape), np.full(len(problem.c), np.inf)
    running, state = np.arange(len(gap)), problem.start()
    for _ in range(_MOST_STEPS):
        difference = problem.gap(state)
        better = difference < gap[running]
        weights[running[better]], gap[running[better]] = state.w[better], difference[better]
        keep = np.flatnonzero(difference > tolerance)
        if not len(keep):
            break
        if len(keep) < len(running):
            running, problem, state = running[keep], problem.take(keep), state.take(keep)
        state = problem.step(state, ridge)
    return weights, gap


@dataclass(frozen=True)
class _State:
    """Iterates: weights w, overshoots o in parts of the budget, slacks x of the rows and z of the budget, and the
    multipliers v, u, y, t of the four, in this order."""

    w: Array
    o: Array
    x: Array
    z: Array
    v: Array
    u: Array
    y: Array
    t: Array

    def take(self, index: Array) -> _State:
        """State of some of the problems."""
        return replace(self, **{name: value[index] for name, value in vars(self).items()})

    def moved(self, step: _State, primal: Array, dual: Array) -> _State:
        """State after a step of the given lengths, primal and dual, kept positive."""
        new = {}
        for name, value in vars(self).items():
            length = primal if name in "woxz" else dual
            new[name] = np.maximum(value + length.reshape(-1, *[1] * (value.ndim - 1)) * getattr(step, name), _TINY)
        return _State(**new)

    def pairs(self) -> list[tuple[Array, Array]]:
        """Variables with the multipliers that belong to them."""
        return [(self.w, self.v), (self.o, self.u), (self.x, self.y), (self.z, self.t)]

    def complementarity(self) -> Array:
        """Mean product of variables and multipliers, (N,)."""
        return sum((p * d).sum(-1) for p, d in self.pairs()) / sum(p.shape[-1] for p, _ in self.pairs())


@dataclass(frozen=True)
class _Scaled:
    """maximise c w - d sum o  subject to  w A - p o + x = q,  sum o + z = 1,  with A (N, K, M), p, q in [0, 1]."""

    a: Array
    p: Array
    q: Array
    c: Array
    d: Array

    def take(self, index: Array) -> _Scaled:
        """Some of the problems."""
        return replace(self, **{name: value[index] for name, value in vars(self).items()})

    def start(self) -> _State:
        """Strictly feasible: p + q = 1, and each row of A has the maximum 1 (or c < 0)."""
        n, _, m = self.a.shape
        o = np.full((n, m), 0.5 / m)
        room = self.q + self.p * o
        load = self.a.sum(1)
        share = 0.5 * np.min(np.divide(room, load, out=np.ones_like(room), where=load > _TINY**0.5), -1, keepdims=True)
        w = np.broadcast_to(share, self.c.shape)
        y = np.full((n, m), 2.0)
        t = np.full((n, 1), 4.0)
        v = _sums(self.a, y) - self.c
        return _State(w, o, room - load * share, np.full((n, 1), 0.5), v, t + self.d - self.p * y, y, t)

    def gap(self, s: _State) -> Array:
        """(N,) relative difference of the dual and the primal objective."""
        primal = (self.c * s.w).sum(-1) - self.d[:, 0] * s.o.sum(-1)
        dual = (self.q * s.y).sum(-1) + s.t[:, 0]
        return (dual - primal) / np.maximum(np.abs(dual), _TINY)

    def step(self, s: _State, ridge: float) -> _State:
        """Predictor, then corrector with Mehrotra's centring."""
        system = _System(self, s, ridge)
        before = s.complementarity()
        aim = system.solve([-p * d for p, d in s.pairs()])
        reached = s.moved(aim, *_lengths(s, aim, 1.0)).complementarity()
        centre = (before * (reached / before) ** 3)[:, None]
        step = system.solve([centre - p * d - dp * dd for (p, d), (dp, dd) in zip(s.pairs(), aim.pairs())])
        return s.moved(step, *_lengths(s, step, _TO_BOUNDARY))


class _System:
    """Newton's equations at a state, reduced to the weights and the budget's multiplier."""

    def __init__(self, problem: _Scaled, s: _State, ridge: float) -> None:
        self.problem, self.s = problem, s
        a, p = problem.a, problem.p
        h = s.y / s.x
        scale = s.u + s.o * p * p * h
        self.h, self.scale = h, scale
        self.e = s.o * p * h / scale
        self.g = h * s.u / scale
        n, k, _ = a.shape
        matrix = np.zeros((n, k + 1, k + 1))
        matrix[:, :k, :k] = (a * self.g[:, None]) @ np.swapaxes(a, 1, 2)
        matrix[:, range(k), range(k)] = matrix[:, range(k), range(k)] * (1 + ridge) + s.v / s.w
        column = _sums(a, self.e)
        matrix[:, :k, k], matrix[:, k, :k] = column, -column
        matrix[:, k, k] = (s.z / s.t)[:, 0] + (s.o / scale).sum(-1)
        self.inverse = np.linalg.inv(matrix)
        # What rounding has left of feasibility is restored along the way.
        self.rest_x: Array = problem.q - _times(s.w, a) + p * s.o - s.x
        self.rest_z = 1 - s.o.sum(-1, keepdims=True) - s.z
        self.rest_v = problem.c - _sums(a, s.y) + s.v
        self.rest_u = s.t + problem.d - p * s.y - s.u

    def solve(self, targets: list[Array]) -> _State:
        """The step whose four products change by `targets`, to first order."""
        s, a, p = self.s, self.problem.a, self.problem.p
        r_w, r_o, r_x, r_z = targets
        y_0 = (r_x - s.y * self.rest_x) / s.x
        o_0 = (r_o - s.o * self.rest_u + s.o * p * y_0) / self.scale
        y_1 = y_0 - self.h * p * o_0
        right_w = r_w / s.w + self.rest_v - _sums(a, y_1)
        right_t = r_z / s.t - self.rest_z + o_0.sum(-1, keepdims=True)
        both = np.einsum("nij,nj->ni", self.inverse, np.concatenate([right_w, right_t], -1))
        w, t = both[:, :-1], both[:, -1:]
        carried = _times(w, a)
        y = y_1 + self.g * carried + self.e * t
        o = o_0 + self.e * carried - s.o / self.scale * t
        x = self.rest_x - carried + p * o
        z = self.rest_z - o.sum(-1, keepdims=True)
        v: Array = _sums(a, y) - self.rest_v
        return _State(w, o, x, z, v, self.rest_u + t - p * y, y, t)


def _lengths(s: _State, step: _State, share: float) -> tuple[Array, Array]:
    """Largest steps (N,), primal and dual, that keep everything positive."""
    primal, dual = np.ones(len(s.w)), np.ones(len(s.w))
    for (p, d), (dp, dd) in zip(s.pairs(), step.pairs()):
        for value, change, length in ((p, dp, primal), (d, dd, dual)):
            room = np.divide(-value, change, out=np.full_like(value, np.inf), where=change < -(_TINY**0.5))
            np.minimum(length, share * room.min(-1), out=length)
    return primal, dual


def _times(w: Array, a: Array) -> Array:
    """(N, K) weights times (N, K, M) values, (N, M)."""
    return (w[:, None] @ a)[:, 0]


def _sums(a: Array, y: Array) -> Array:
    """(N, K, M) values summed under multipliers (N, M), (N, K)."""
    return (a @ y[..., None])[..., 0]


def _scaled(
    columns: Array, bounds: Array, areas: Array, gains: Array, budget: float, price: float
) -> tuple[_Scaled, Array, Array]:
    """The scaled problems, what the weights were multiplied by (N, K), and what the best weight is worth (N,)."""
    binds = areas > 0
    largest = bounds + np.divide(budget, areas, out=np.zeros(areas.shape), where=binds)
    closed = binds & (largest <= 0)
    open_rows = binds & ~closed
    inverse = np.divide(1.0, largest, out=np.zeros(areas.shape), where=open_rows)
    blocked = (columns * closed[:, None]).max(-1) > 0
    a = columns * inverse[:, None]
    scale = a.max(-1)
    useful = ~blocked & (scale > 0) & (gains > 0)
    scale = np.where(useful, scale, 1.0)
    a = a * (useful / scale)[..., None]
    c = np.where(useful, gains / scale, 0.0)
    worth = c.max(-1)
    unit = np.where(worth > 0, worth, 1.0)[:, None]
    q = np.where(open_rows, bounds * inverse, 1.0)
    problem = _Scaled(a, 1 - q, q, np.where(useful, c / unit, -1.0), price * budget / unit)
    return problem, np.where(useful, scale, np.inf), worth


def feasible_share(excess: Any, allowed: Array, halvings: int = 40) -> Array:
    """Largest share t in [0, 1] with excess(t) <= allowed, for increasing functions of t evaluated together."""
    low, high = np.zeros(allowed.shape), np.ones(allowed.shape)
    low = np.where(excess(high) <= allowed, high, low)
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        fits = excess(middle) <= allowed
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return low
