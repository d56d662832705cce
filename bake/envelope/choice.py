"""Which few closures an envelope needs: chosen greedily from a basis, then their widths are refined."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..shading.lobes import Lobe
from ..source import Array, BrdfSource
from ..tables.treated_source import TreatedSource
from .closures import closure_values, neighbours
from .linear_program import solve
from .views import gauss_chords, sample_views

# The choice needs no more: trials at twice the size chose the same or changed the share carried by less than 0.01.
_VIEWS, _N_H, _N_PHI = 12, 24, 12
_TOLERANCE = 1e-3
_GAIN = 1.002  # what a change must bring to be made
_FIRST_RATIO, _LAST_RATIO = 1.25, 1.02


@dataclass(frozen=True)
class Choice:
    """Closures, the share of all energy they carry, and what the whole basis would; both estimates, a little high."""

    closures: tuple[Lobe, ...]
    share: float
    reach: float


class Trial:
    """A source seen from a few elevations, its channels summed, against any set of closures.

    What one envelope of the sum carries is at least what one per channel carry together, and usually about the same.
    """

    def __init__(self, source: BrdfSource | TreatedSource, budget: float, price: float) -> None:
        chords, weights = gauss_chords(_VIEWS)
        self.views = sample_views(source, chords, _N_H, _N_PHI)
        values = self.views.values.sum(-1)
        energy = (self.views.areas * values).sum(-1)
        self.importance = weights * energy / max(float((weights * energy).sum()), 1e-300)
        self.energy = np.where(energy > 0, energy, 1.0)[:, None]
        self.bounds = values / self.energy
        self.budget, self.price = budget, price
        self._columns: dict[Lobe, Array] = {}

    def column(self, lobe: Lobe) -> Array:
        """A closure in parts of the energy, (V, P)."""
        if lobe not in self._columns:
            self._columns[lobe] = closure_values([lobe], self.views.wi, self.views.wo)[..., 0] / self.energy
        return self._columns[lobe]

    def shares(self, sets: Sequence[Sequence[Lobe]]) -> Array:
        """What each of several equally large sets carries, less the price of its overshoot."""
        values = np.concatenate([np.stack([self.column(lobe) for lobe in members], -1) for members in sets])
        areas, bounds = (np.tile(a, (len(sets), 1)) for a in (self.views.areas, self.bounds))
        gains = np.einsum("nm,nmk->nk", areas, values)
        found = solve(values, bounds, areas, gains, self.budget, self.price, _TOLERANCE).objective
        return found.reshape(len(sets), -1) @ self.importance


def choose(
    source: BrdfSource | TreatedSource,
    basis: Sequence[Lobe],
    most: int,
    enough: float,
    budget: float,
    price: float,
    progress: Callable[[float], None] | None = None,
) -> Choice:
    """The fewest closures, at most `most`, that carry the share `enough` of what the whole basis does.

    Each step adds the closure that brings most, lets every earlier one be exchanged for a better, and moves the widths
    of all between those of the basis.
    """
    trial = Trial(source, budget, price)
    reach = float(trial.shares([basis])[0])
    chosen: tuple[Lobe, ...] = ()
    share = 0.0
    for k in range(min(most, len(basis))):
        longer, gained = _best(trial, [(*chosen, lobe) for lobe in basis if lobe not in chosen])
        if chosen and gained < share * _GAIN:
            break
        longer, gained = _exchanged(trial, longer, gained, basis)
        chosen, share = _refined(trial, longer, gained)
        if progress:
            progress((k + 1) / most)
        if share >= enough * reach:
            break
    return Choice(tuple(sorted(chosen, key=lambda lobe: (lobe.name != "lambert", lobe.name, lobe.p1))), share, reach)


def _best(trial: Trial, sets: list[tuple[Lobe, ...]]) -> tuple[tuple[Lobe, ...], float]:
    shares = trial.shares(sets)
    best = int(np.argmax(shares))
    return sets[best], float(shares[best])


def _exchanged(
    trial: Trial, chosen: tuple[Lobe, ...], share: float, basis: Sequence[Lobe]
) -> tuple[tuple[Lobe, ...], float]:
    """Exchange each closure but the last, which has just been chosen, once for whatever serves better."""
    for k in range(len(chosen) - 1):
        others = [(*chosen[:k], lobe, *chosen[k + 1 :]) for lobe in basis if lobe not in chosen]
        if others:
            changed, found = _best(trial, others)
            if found > share * _GAIN:
                chosen, share = changed, found
    return chosen, share


def _refined(trial: Trial, chosen: tuple[Lobe, ...], share: float) -> tuple[tuple[Lobe, ...], float]:
    """Pattern search over the widths, in steps of a ratio that is halved where nothing improves."""
    ratio = _FIRST_RATIO
    while ratio > _LAST_RATIO:
        moves = [
            (*chosen[:k], lobe, *chosen[k + 1 :])
            for k, member in enumerate(chosen)
            for lobe in neighbours(member, ratio)
            if lobe not in chosen
        ]
        changed, found = _best(trial, moves) if moves else (chosen, 0.0)
        if found > share * _GAIN:
            chosen, share = changed, found
        else:
            ratio = ratio**0.5
    return chosen, share
