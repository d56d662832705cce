"""An envelope of anisotropic closures whose weights depend on the viewer's elevation and azimuth (DESIGN.md section 5).

As `bake.envelope`, on a grid of viewers (theta_o, phi_o): each solves its linear programme, then E is verified between
the viewers and lowered where it is too high. Closures lie along the tangent, as brushing does; a material whose axes
are turned from it is carried less well, and its residual takes the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..envelope.closures import closure_sum, closure_values
from ..envelope.fit import node_weights
from ..envelope.linear_program import solve
from ..envelope.preview import albedo_weights, normal_equations
from ..envelope.verification import within_budget
from ..envelope.views import Views, chord_of, gauss_chords
from ..errors import BakeError
from ..source import Array, BrdfSource
from .lobes import AnisotropicLobe
from .views import ViewerGrid, slope_views

Widths = tuple[float, float]

BUDGET, PRICE = 1e-3, 10.0  # see bake.envelope.EnvelopeSettings
_PLANNED = 0.8
_MOST = 3
_ENOUGH = 0.97
_GAIN = 1.003
# Sizes that share no direction with each other.
_CHOICE, _FIT, _DENSE, _INDEPENDENT = (22, 20), (40, 36), (49, 45), (57, 53)
_RATIOS = (1.3, 1.12)
_REPORTED = (0, 15, 30, 45, 60, 70, 75, 80, 85, 88)
_AZIMUTHS = 6
_CHUNK = 64  # viewers at once


@dataclass(frozen=True, eq=False)
class AnisotropicFit:
    """Weights (n_theta, n_phi, K, 3) float32 >= 0 of K closures, and the residual's share of light (n_theta, n_phi)."""

    closures: tuple[AnisotropicLobe, ...]
    grid: ViewerGrid
    weights: NDArray[np.float32]
    share: NDArray[np.float32]
    measured: dict[str, Any]

    def weights_at(self, wo: Array) -> Array:
        """(..., K, 3) for viewers (..., 3)."""
        flat = self.weights.reshape(*self.weights.shape[:2], -1).astype(np.float64)
        found = self.grid.interpolated(flat, chord_of(wo), np.arctan2(wo[..., 1], wo[..., 0]))
        return found.reshape(*found.shape[:-1], len(self.closures), 3)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """E / cos(theta_i) in 1/sr, (..., 3), of unit directions that broadcast; 0 on and below the horizon."""
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        return closure_sum(self.closures, self.weights_at(wo), wi, wo)

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "closures": [lobe.facts() for lobe in self.closures],
            "n_theta": self.grid.n_theta,
            "n_phi": self.grid.n_phi,
            "folded": self.grid.folded,
            **self.measured,
        }


class AnisotropicResidual:
    """max(f - E / cos(theta_i), 0) as a source."""

    isotropic = bilateral = False

    def __init__(self, source: BrdfSource, fit: AnisotropicFit) -> None:
        self.source, self.fit, self.name = source, fit, f"{source.name} residual"
        self.facts: dict[str, Any] = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) >= 0 in 1/sr."""
        rest: Array = np.maximum(self.source.evaluate(wi, wo) - self.fit.evaluate(wi, wo), 0)
        return rest


def fit_anisotropic_envelope(
    source: BrdfSource, grid: ViewerGrid, widths: Widths, progress: Callable[[float], None] | None = None
) -> AnisotropicFit:
    """Choose at most three closures and fit their weights.

    Parameters
    ----------
    source : non-negative
    widths : of the half vector's slopes, where the source's highlight is resolved

    Raises
    ------
    BakeError : the source is black or not finite
    """
    say = progress or (lambda share: None)
    closures, reach = _chosen(_Trial(source, widths), widths)
    say(0.3)
    chords, phi = grid.nodes()
    weights = np.concatenate(
        [
            node_weights(slope_views(source, chords[p], phi[p], widths, _FIT), closures, _PLANNED * BUDGET, PRICE)  # type: ignore[arg-type]
            for p in _parts(len(chords))
        ]
    ).reshape(grid.n_theta, grid.n_phi, len(closures), 3)
    say(0.6)
    weights, factor = _lowered(source, closures, weights, grid, widths)
    stored = weights.astype(np.float32)
    stored = np.where(stored > weights, np.nextafter(stored, np.float32(0)), stored)
    say(0.8)
    fit = AnisotropicFit(closures, grid, stored, np.zeros(stored.shape[:2], np.float32), {})
    share, measures = _measured(source, fit, widths)
    say(1.0)
    facts = {
        "budget": BUDGET,
        "price": PRICE,
        "reach": round(reach, 6),
        "lowered_to": {"mean": round(float(factor.mean()), 6), "least": round(float(factor.min()), 6)},
        **measures,
    }
    return AnisotropicFit(closures, grid, stored, share.astype(np.float32), facts)


def fit_anisotropic_preview(source: BrdfSource, fit: AnisotropicFit, widths: Widths) -> NDArray[np.float32]:
    """Weights (n_theta, n_phi, K, 3) of the same closures that are close to the source and reflect its albedo."""
    chords, phi = fit.grid.nodes()
    found = [
        albedo_weights(slope_views(source, chords[p], phi[p], widths, _FIT), fit.closures)  # type: ignore[arg-type]
        for p in _parts(len(chords))
    ]
    return np.concatenate(found).reshape(fit.weights.shape).astype(np.float32)


def preview_error(source: BrdfSource, preview: AnisotropicFit, widths: Widths) -> float:
    """Relative error of preview weights, as that of `bake.envelope.PreviewFit`, at viewers and directions of no fit."""
    chords, importance = gauss_chords(10)
    phi = (np.arange(_AZIMUTHS) + 0.37) * (preview.grid.turn / _AZIMUTHS)
    viewers = np.repeat(chords, _AZIMUTHS), np.tile(phi, len(chords))
    views = slope_views(source, *viewers, widths, _INDEPENDENT)
    matrices, sides, squares = normal_equations(views, preview.closures, views.values.sum(-1, keepdims=True))  # type: ignore[arg-type]
    weights = preview.weights_at(views.wo[:, 0]).sum(-1)
    left = squares[:, 0] - 2 * (weights * sides[..., 0]).sum(-1) + np.einsum("vk,vkl,vl->v", weights, matrices, weights)
    shares = np.divide(left, squares[:, 0], out=np.zeros(len(left)), where=squares[:, 0] > 0)
    return float(np.sqrt(max(np.repeat(importance, _AZIMUTHS) @ shares, 0) / (_AZIMUTHS * importance.sum())))


class _Trial:
    """A source seen by a few viewers, its channels summed, against any set of closures."""

    def __init__(self, source: BrdfSource, widths: Widths) -> None:
        chords, weights = gauss_chords(5)
        phi = np.array([0.2, 1.7, 3.0])
        self.views = slope_views(source, np.repeat(chords, len(phi)), np.tile(phi, len(chords)), widths, _CHOICE)
        values = self.views.values.sum(-1)
        energy = (self.views.areas * values).sum(-1)
        if not energy.any():
            raise BakeError(source.name, "reflects nothing", "check the file")
        self.importance = np.repeat(weights, len(phi)) * energy
        self.importance /= self.importance.sum()
        self.energy = np.where(energy > 0, energy, 1.0)[:, None]
        self.bounds = values / self.energy
        self._columns: dict[AnisotropicLobe, Array] = {}

    @cached_property
    def basis(self) -> tuple[AnisotropicLobe, ...]:
        """Lambert, and GGX of widths in steps of 2.5."""
        alphas = (0.01, 0.025, 0.06, 0.15, 0.4, 1.0)
        return (AnisotropicLobe("lambert"), *(AnisotropicLobe("ggx", x, y) for x in alphas for y in alphas))

    def shares(self, sets: Sequence[Sequence[AnisotropicLobe]]) -> Array:
        """What each of several equally large sets carries, less the price of its overshoot."""
        values = np.concatenate([np.stack([self._column(lobe) for lobe in members], -1) for members in sets])
        areas, bounds = (np.tile(a, (len(sets), 1)) for a in (self.views.areas, self.bounds))
        gains = np.einsum("nm,nmk->nk", areas, values)
        found = solve(values, bounds, areas, gains, _PLANNED * BUDGET, PRICE, 1e-3).objective
        return found.reshape(len(sets), -1) @ self.importance

    def _column(self, lobe: AnisotropicLobe) -> Array:
        if lobe not in self._columns:
            values = closure_values([lobe], self.views.wi, self.views.wo)[..., 0]  # type: ignore[list-item]
            self._columns[lobe] = values / self.energy
        return self._columns[lobe]


def _chosen(trial: _Trial, widths: Widths) -> tuple[tuple[AnisotropicLobe, ...], float]:
    """Greedily the closure that brings most, its widths and the others' then refined; and the share carried."""
    chosen: tuple[AnisotropicLobe, ...] = ()
    share = 0.0
    for _ in range(_MOST):
        longer, gained = _best(trial, [(*chosen, lobe) for lobe in trial.basis if lobe not in chosen])
        if chosen and gained < share * _GAIN:
            break
        chosen, share = longer, gained
        for ratio in (1.6, *_RATIOS):
            moved, found = _best(
                trial,
                [
                    (*chosen[:k], lobe, *chosen[k + 1 :])
                    for k, member in enumerate(chosen)
                    for lobe in member.neighbours(ratio)
                    if lobe not in chosen
                ],
            )
            if found > share * _GAIN:
                chosen, share = moved, found
        if share >= _ENOUGH:
            break
    return tuple(sorted(chosen, key=lambda lobe: (lobe.name != "lambert", lobe))), share


def _best(trial: _Trial, sets: list[tuple[AnisotropicLobe, ...]]) -> tuple[tuple[AnisotropicLobe, ...], float]:
    if not sets:
        return (), 0.0
    shares = trial.shares(sets)
    best = int(np.argmax(shares))
    return sets[best], float(shares[best])


def _parts(count: int) -> list[slice]:
    return [slice(start, start + _CHUNK) for start in range(0, count, _CHUNK)]


def _envelope(views: Views, closures: Sequence[AnisotropicLobe], weights: Array) -> Array:
    """E (V, P, 3) with its cosine, of weights (V, K, 3)."""
    return closure_values(closures, views.wi, views.wo) @ weights  # type: ignore[arg-type]


def _lowered(
    source: BrdfSource, closures: Sequence[AnisotropicLobe], weights: Array, grid: ViewerGrid, widths: Widths
) -> tuple[Array, Array]:
    """Weights that keep the budget between the nodes too, and the factors (n_theta, n_phi, 3); see `bake.envelope`."""
    chords, phi = grid.nodes(2)
    flat = weights.reshape(grid.n_theta, grid.n_phi, -1)
    found = np.empty((len(chords), 3))
    for part in _parts(len(chords)):
        views = slope_views(source, chords[part], phi[part], widths, _DENSE)
        there = grid.interpolated(flat, chords[part], phi[part]).reshape(-1, len(closures), 3)
        found[part] = within_budget(views, _envelope(views, closures, there), _PLANNED * BUDGET)
    fine = found.reshape(2 * grid.n_theta - 1, 2 * grid.n_phi, 3)
    # A node takes the least factor of the viewers between its neighbours and itself.
    rows = np.pad(fine, ((1, 1), (0, 0), (0, 0)), mode="edge")
    rows = np.minimum(np.minimum(rows[:-2:2], rows[1:-1:2]), rows[2::2])
    beside = np.minimum(np.roll(rows, 1, 1), np.minimum(rows, np.roll(rows, -1, 1)))
    factors = beside[:, ::2]
    return weights * factors[:, :, None], factors


def _measured(source: BrdfSource, fit: AnisotropicFit, widths: Widths) -> tuple[Array, dict[str, Any]]:
    """The residual's share of light at the nodes, and facts as of `bake.envelope.verification.measured`.

    What is told by elevation is the mean over the viewer's azimuth; "overshoot_largest" is that of the worst elevation.
    """
    grid = fit.grid
    balance = _balance(source, fit, *grid.nodes(), widths, _FIT)
    total = balance.rest + balance.envelope
    share = np.divide(balance.rest, total, out=np.zeros_like(total), where=total > 0)[..., 0]
    gauss, weights = gauss_chords(10)
    reported = np.sqrt(2) * np.sin(np.radians(_REPORTED) / 2)
    seen, n = np.concatenate([gauss, reported]), len(gauss)
    phi = (np.arange(_AZIMUTHS) + 0.37) * (grid.turn / _AZIMUTHS)
    found = _balance(source, fit, np.repeat(seen, _AZIMUTHS), np.tile(phi, len(seen)), widths, _INDEPENDENT)
    energy, carried, over = (
        a[:, 0].reshape(-1, _AZIMUTHS).mean(1) for a in (found.energy, found.energy - found.rest, found.over)
    )
    lit = energy > 1e-6 * energy.max()
    parts, largest = (np.divide(a, energy, out=np.zeros_like(energy), where=lit) for a in (carried, over))
    return share.reshape(grid.n_theta, grid.n_phi), {
        "share": round(float(weights @ carried[:n] / (weights @ energy[:n])), 6),
        "overshoot": float(weights @ over[:n] / (weights @ energy[:n])),
        "overshoot_largest": float(largest.max()),
        "by_theta_o_deg": [[angle, round(float(x), 6)] for angle, x in zip(_REPORTED, parts[n:])],
    }


@dataclass(frozen=True)
class _Balance:
    """Of each viewer, channels summed, (V, 1): light in all, above the envelope, of the envelope, and its excess."""

    energy: Array
    rest: Array
    envelope: Array
    over: Array


def _balance(
    source: BrdfSource, fit: AnisotropicFit, chords: Array, phi: Array, widths: Widths, sizes: tuple[int, int]
) -> _Balance:
    flat = fit.weights.reshape(*fit.weights.shape[:2], -1).astype(np.float64)
    found = np.empty((len(chords), 4))
    for part in _parts(len(chords)):
        views = slope_views(source, chords[part], phi[part], widths, sizes)
        weights = fit.grid.interpolated(flat, chords[part], phi[part]).reshape(-1, len(fit.closures), 3)
        envelope = _envelope(views, fit.closures, weights)
        kinds = (views.values, np.maximum(views.values - envelope, 0), envelope, np.maximum(envelope - views.values, 0))
        found[part] = np.stack([np.einsum("vp,vpc->v", views.areas, kind) for kind in kinds], -1)
    return _Balance(*(found[:, k : k + 1] for k in range(4)))
