"""Which few closures an envelope needs: chosen greedily from a basis, then their widths are refined."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import BakeError
from ..source import Array
from .closures import Closure, closure_values
from .linear_program import solve
from .viewers import Source, Viewers

_TOLERANCE = 1e-3

Set = tuple[Closure, ...]


@dataclass(frozen=True)
class Choice:
    """Closures, the share of all energy they carry, and what the whole basis would; both estimates, a little high.

    Where the search does not ask what the whole basis carries, the last is the share itself.
    """

    closures: Set
    share: float
    reach: float


class Trial:
    """A source seen by a few viewers, its channels summed, against any set of closures.

    What one envelope of the sum carries is at least what one per channel carry together, and usually about the same.
    """

    def __init__(self, source: Source, viewers: Viewers, budget: float, price: float) -> None:
        chords, phi, weights = viewers.chosen_from()
        self.views = viewers.views(source, chords, phi, viewers.effort.choice)
        values = self.views.values.sum(-1)
        energy = (self.views.areas * values).sum(-1)
        if not energy.any():
            raise BakeError(source.name, "reflects nothing", "check the file")
        self.importance = weights * energy / max(float((weights * energy).sum()), 1e-300)
        self.energy = np.where(energy > 0, energy, 1.0)[:, None]
        self.bounds = values / self.energy
        self.budget, self.price = budget, price
        self._columns: dict[Closure, Array] = {}

    def column(self, lobe: Closure) -> Array:
        """A closure in parts of the energy, (V, P)."""
        if lobe not in self._columns:
            self._columns[lobe] = closure_values([lobe], self.views.wi, self.views.wo)[..., 0] / self.energy
        return self._columns[lobe]

    def shares(self, sets: Sequence[Sequence[Closure]]) -> Array:
        """Share that each of several equally large sets carries, less the price of its overshoot."""
        values = np.concatenate([np.stack([self.column(lobe) for lobe in members], -1) for members in sets])
        areas, bounds = (np.tile(a, (len(sets), 1)) for a in (self.views.areas, self.bounds))
        gains = np.einsum("nm,nmk->nk", areas, values)
        found = solve(values, bounds, areas, gains, self.budget, self.price, _TOLERANCE).objective
        return found.reshape(len(sets), -1) @ self.importance


def choose(
    source: Source,
    viewers: Viewers,
    basis: Sequence[Closure],
    most: int,
    enough: float,
    budget: float,
    price: float,
    progress: Callable[[float], None] | None = None,
) -> Choice:
    """The fewest closures, at most `most`, that carry the share `enough` of what the whole basis does, or of all.

    Each step adds the closure that brings most, may let every earlier one be exchanged for a better, and moves the
    widths of all between those of the basis.

    Raises
    ------
    BakeError : the source is black or not finite
    """
    trial, search = Trial(source, viewers, budget, price), viewers.search
    reach = float(trial.shares([basis])[0]) if search.of_basis else 1.0
    chosen: Set = ()
    share = 0.0
    for k in range(min(most, len(basis))):
        longer, gained = _best(trial, [(*chosen, lobe) for lobe in basis if lobe not in chosen])
        if chosen and gained < share * search.gain:
            break
        if search.exchanged:
            longer, gained = _exchanged(trial, longer, gained, basis, search.gain)
        chosen, share = _refined(trial, longer, gained, viewers)
        if progress:
            progress((k + 1) / most)
        if share >= enough * reach:
            break
    return Choice(tuple(sorted(chosen, key=_order)), share, reach if search.of_basis else share)


def _order(lobe: Closure) -> tuple[object, ...]:
    """Lambert first, then by name and parameters."""
    return lobe.name != "lambert", *lobe.facts().values()


def _best(trial: Trial, sets: list[Set]) -> tuple[Set, float]:
    if not sets:
        return (), -math.inf  # a set may be worth less than nothing, and is more than none
    shares = trial.shares(sets)
    best = int(np.argmax(shares))
    return sets[best], float(shares[best])


def _exchanged(trial: Trial, chosen: Set, share: float, basis: Sequence[Closure], gain: float) -> tuple[Set, float]:
    """Exchange each closure but the last, which has just been chosen, once for whatever serves better."""
    for k in range(len(chosen) - 1):
        others = [(*chosen[:k], lobe, *chosen[k + 1 :]) for lobe in basis if lobe not in chosen]
        changed, found = _best(trial, others)
        if found > share * gain:
            chosen, share = changed, found
    return chosen, share


def _refined(trial: Trial, chosen: Set, share: float, viewers: Viewers) -> tuple[Set, float]:
    """Pattern search over the widths, in smaller and smaller steps."""
    for ratio in viewers.search.ratios:
        improves = True
        while improves:
            moves = [
                (*chosen[:k], lobe, *chosen[k + 1 :])
                for k, member in enumerate(chosen)
                for lobe in viewers.neighbours(member, ratio)
                if lobe not in chosen
            ]
            changed, found = _best(trial, moves)
            better = found > share * viewers.search.gain
            if better:
                chosen, share = changed, found
            improves = better and viewers.search.repeated
    return chosen, share
