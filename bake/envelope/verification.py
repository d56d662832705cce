"""Is the envelope under f cos between its nodes and between the directions of its programme? And how good is it?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..source import Array, Facts
from .closures import Closure, closure_values
from .linear_program import feasible_share
from .viewers import Source, Viewers
from .views import Views, gauss_chords

_REPORTED = (0, 15, 30, 45, 60, 70, 75, 80, 85, 88)
_LOW = 0.05
_DARK = 1e-6  # of the largest albedo: below it a share of the energy says nothing
_TOGETHER = 64  # viewers at once


def parts_of(count: int) -> list[slice]:
    """Slices of a list of viewers that memory holds the light directions of."""
    return [slice(start, start + _TOGETHER) for start in range(0, count, _TOGETHER)]


def lowered(
    source: Source, closures: Sequence[Closure], viewers: Viewers, weights: Array, budget: float
) -> tuple[Array, Array]:
    """Weights (*shape, K, 3) that keep the budget on a dense set of viewers and lights, and what each was times.

    At each viewer the largest factor within the budget is found; a node takes the least factor of the viewers between
    its neighbours and itself. One pass is enough: the overshoot grows with the weights, and the interpolated weights
    are then nowhere above the factor times what they were.
    """
    chords, phi = viewers.between()
    found = np.empty((len(chords), 3))
    for part in parts_of(len(chords)):
        views = viewers.views(source, chords[part], phi[part], viewers.effort.dense)
        found[part] = within_budget(views, envelope_values(views, closures, viewers, weights), budget)
    factors = _least_beside(found, viewers)
    return weights * factors[..., None, :], factors


def _least_beside(values: Array, viewers: Viewers) -> Array:
    """Least of values (V, 3) nearer to each node than its neighbours are, along every angle; (*shape, 3)."""
    parts = viewers.effort.parts
    fine = tuple(n * parts if axis in viewers.periodic else (n - 1) * parts + 1 for axis, n in enumerate(viewers.shape))
    values = values.reshape(*fine, 3)
    for axis, n in enumerate(viewers.shape):
        near = np.arange(n) * parts + np.arange(1 - parts, parts)[:, None]
        near = near % fine[axis] if axis in viewers.periodic else np.clip(near, 0, fine[axis] - 1)
        values = np.take(values, near, axis).min(axis)
    return values


def within_budget(views: Views, envelope: Array, budget: float) -> Array:
    """Largest factor (V, 3) in [0, 1] under which the envelope (V, P, 3) keeps the budget."""
    allowed = budget * views.energy

    def excess(factor: Array) -> Array:
        return np.einsum("vp,vpc->vc", views.areas, np.maximum(envelope * factor[:, None] - views.values, 0))

    return feasible_share(excess, allowed)


def envelope_values(views: Views, closures: Sequence[Closure], viewers: Viewers, weights: Array) -> Array:
    """E (V, P, 3) with its cosine, at views by any viewers."""
    values = closure_values(closures, views.wi, views.wo)
    return values @ viewers.interpolated(np.asarray(weights, np.float64), views.chords, views.phi)


def residual_shares(source: Source, closures: Sequence[Closure], viewers: Viewers, weights: Array) -> Array:
    """Part (*shape) of each node's light that the residual max(f cos - E, 0) carries, channels summed; 0 if dark."""
    chords, phi = viewers.nodes()
    share = np.empty(len(chords))
    for part in parts_of(len(chords)):
        views = viewers.views(source, chords[part], phi[part], viewers.effort.shares)
        envelope = envelope_values(views, closures, viewers, weights)
        rest = np.einsum("vp,vpc->v", views.areas, np.maximum(views.values - envelope, 0))
        total = rest + np.einsum("vp,vpc->v", views.areas, envelope)
        share[part] = np.divide(rest, total, out=np.zeros_like(rest), where=total > 0)
    return share.reshape(viewers.shape)


def measured(source: Source, closures: Sequence[Closure], viewers: Viewers, weights: Array) -> Facts:
    """Share of the energy that E carries, and its overshoot, on directions used nowhere else; JSON-ready.

    Energies of an elevation are means over the viewer's azimuth.

    Returns
    -------
    share, share_rgb : integral of min(E, f cos) over that of f cos, cosine-weighted over theta_o
    overshoot : integral of max(E - f cos, 0) over that of f cos: the bias of E + R
    overshoot_largest : the same at the worst theta_o and channel
    overshoot_local : the largest E - f cos in one direction, in parts of f cos or of what a Lambertian surface of the
        same albedo would reflect there, whichever is more; viewer and light at least 3 degrees above the horizon
    by_theta_o_deg : [[theta_o, share], ...]
    """
    chords, cosine_weights = gauss_chords(viewers.effort.measured)
    elevations = np.concatenate([chords, np.sqrt(2) * np.sin(np.radians(_REPORTED) / 2)])
    azimuths = viewers.azimuths()
    seen_from = np.repeat(elevations, len(azimuths)), np.tile(azimuths, len(elevations))
    # Energy, overshoot and what is carried of each viewer and channel.
    sums, local = np.empty((3, len(seen_from[0]), 3)), 0.0
    for part in parts_of(len(seen_from[0])):
        views = viewers.views(source, seen_from[0][part], seen_from[1][part], viewers.effort.independent)
        envelope = envelope_values(views, closures, viewers, weights)
        kinds = views.values, np.maximum(envelope - views.values, 0), np.minimum(envelope, views.values)
        for k, kind in enumerate(kinds):
            sums[k, part] = np.einsum("vp,vpc->vc", views.areas, kind)
        local = max(_largest_local(views, envelope), local)
    energy, over, carried = sums.reshape(3, len(elevations), len(azimuths), 3).mean(2)
    lit = energy > _DARK * energy.max()
    worst = np.divide(over, energy, out=np.zeros_like(over), where=lit).max()
    w, n = cosine_weights[:, None], len(chords)
    total = (w * energy[:n]).sum(0)
    shown = np.divide(carried[n:].sum(-1), energy[n:].sum(-1), out=np.zeros(len(_REPORTED)), where=lit[n:].any(-1))
    return {
        "share": round(float((w * carried[:n]).sum() / total.sum()), 6),
        "share_rgb": [round(float(x), 6) for x in (w * carried[:n]).sum(0) / np.maximum(total, 1e-300)],
        "overshoot": float((w * over[:n]).sum() / total.sum()),
        "overshoot_largest": float(worst),
        "overshoot_local": float(local),
        "by_theta_o_deg": [[angle, round(float(x), 6)] for angle, x in zip(_REPORTED, shown)],
    }


def _largest_local(views: Views, envelope: Array) -> float:
    """Largest overshoot in one direction, in parts of what is measured there or a matte surface would reflect."""
    energy = views.energy
    matte = (energy / np.pi)[:, None] * views.wi[..., 2:]
    seen = (views.wo[..., 2] > _LOW) & (views.wi[..., 2] > _LOW) & (views.areas > 0)
    least = np.maximum(np.maximum(views.values, matte), _DARK * energy.max())
    return float((seen[..., None] * (envelope - views.values) / least).max())
