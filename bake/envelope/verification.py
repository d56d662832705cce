"""Is the envelope under f cos between its nodes and between the directions of its programme? And how good is it?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..shading.lobes import Lobe
from ..source import Array
from ..tables.treated_source import TreatedSource
from .closures import closure_values
from .linear_program import feasible_share
from .views import Views, gauss_chords, interpolated, sample_views

# Sizes that share no direction with each other nor with those the programme is solved on.
_DENSE = 41, 25
_INDEPENDENT = 53, 33
_PARTS = 4  # viewers verified per interval between nodes
_MEASURED_VIEWS = 40
_REPORTED = (0, 15, 30, 45, 60, 70, 75, 80, 85, 88)
_LOW = 0.05
_DARK = 1e-6  # of the largest albedo: below it a share of the energy says nothing


def lowered(source: TreatedSource, closures: Sequence[Lobe], weights: Array, budget: float) -> tuple[Array, Array]:
    """Weights (n, K, 3) that keep the budget on a dense set of viewers and lights, and what they were multiplied by.

    At each viewer the largest factor within the budget is found; a node takes the least factor of the viewers between
    its neighbours and itself. One pass is enough: the overshoot grows with the weights, and the interpolated weights
    are then nowhere above the factor times what they were.
    """
    count = len(weights)
    factors = np.ones((count, 3))
    for start in range(0, count - 1, 8):
        last = min(start + 8, count - 1)
        chords = np.linspace(start, last, (last - start) * _PARTS + 1) / (count - 1)
        views = sample_views(source, chords, *_DENSE)
        found = within_budget(views, envelope_values(views, closures, weights), budget)
        position = chords * (count - 1)
        for node in range(start, last + 1):
            near = np.abs(position - node) < 1 - 1e-9
            factors[node] = np.minimum(factors[node], found[near].min(0))
    return weights * factors[:, None], factors


def within_budget(views: Views, envelope: Array, budget: float) -> Array:
    """Largest factor (V, 3) in [0, 1] under which the envelope (V, P, 3) keeps the budget."""
    allowed = budget * views.energy

    def excess(factor: Array) -> Array:
        return np.einsum("vp,vpc->vc", views.areas, np.maximum(envelope * factor[:, None] - views.values, 0))

    return feasible_share(excess, allowed)


def envelope_values(views: Views, closures: Sequence[Lobe], weights: Array) -> Array:
    """E (V, P, 3) with its cosine, at views of any chords."""
    values = closure_values(closures, views.wi, views.wo)
    return values @ interpolated(np.asarray(weights, np.float64), views.chords)


def residual_shares(source: TreatedSource, closures: Sequence[Lobe], weights: Array) -> Array:
    """Part (n,) of the light at each node that the residual max(f cos - E, 0) carries, channels summed; 0 if dark."""
    views = sample_views(source, np.linspace(0, 1, len(weights)), *_DENSE)
    envelope = envelope_values(views, closures, weights)
    rest = np.einsum("vp,vpc->v", views.areas, np.maximum(views.values - envelope, 0))
    total = rest + np.einsum("vp,vpc->v", views.areas, envelope)
    return np.divide(rest, total, out=np.zeros_like(rest), where=total > 0)


def measured(source: TreatedSource, closures: Sequence[Lobe], weights: Array) -> dict[str, Any]:
    """How much of the energy E carries and by how much it is too high, on directions used nowhere else; JSON-ready.

    Returns
    -------
    share, share_rgb : integral of min(E, f cos) over that of f cos, cosine-weighted over theta_o
    overshoot : integral of max(E - f cos, 0) over that of f cos: the bias of E + R
    overshoot_largest : the same at the worst theta_o and channel
    overshoot_local : the largest E - f cos in one direction, in parts of f cos or of what a Lambertian surface of the
        same albedo would reflect there, whichever is more; viewer and light at least 3 degrees above the horizon
    by_theta_o_deg : [[theta_o, share], ...]
    """
    chords, cosine_weights = gauss_chords(_MEASURED_VIEWS)
    reported = np.sqrt(2) * np.sin(np.radians(_REPORTED) / 2)
    views = sample_views(source, np.concatenate([chords, reported]), *_INDEPENDENT)
    envelope = envelope_values(views, closures, weights)
    energy = views.energy
    over = np.einsum("vp,vpc->vc", views.areas, np.maximum(envelope - views.values, 0))
    carried = np.einsum("vp,vpc->vc", views.areas, np.minimum(envelope, views.values))
    lit = energy > _DARK * energy.max()
    worst = np.divide(over, energy, out=np.zeros_like(over), where=lit).max()
    matte = (energy / np.pi)[:, None] * views.wi[..., 2:]
    seen = (views.wo[..., 2] > _LOW) & (views.wi[..., 2] > _LOW)
    local = (
        seen[..., None] * (envelope - views.values) / np.maximum(np.maximum(views.values, matte), _DARK * energy.max())
    )
    w, n = cosine_weights[:, None], _MEASURED_VIEWS
    total = (w * energy[:n]).sum(0)
    shown = np.divide(carried[n:].sum(-1), energy[n:].sum(-1), out=np.zeros(len(reported)), where=lit[n:].any(-1))
    return {
        "share": round(float((w * carried[:n]).sum() / total.sum()), 6),
        "share_rgb": [round(float(x), 6) for x in (w * carried[:n]).sum(0) / np.maximum(total, 1e-300)],
        "overshoot": float((w * over[:n]).sum() / total.sum()),
        "overshoot_largest": float(worst),
        "overshoot_local": float(max(local.max(), 0.0)),
        "by_theta_o_deg": [[angle, round(float(x), 6)] for angle, x in zip(_REPORTED, shown)],
    }
