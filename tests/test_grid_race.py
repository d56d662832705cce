"""The race of candidate grids: short where one is clearly best, long where two are close, and right."""

from __future__ import annotations

import numpy as np
from measured_materials.bake.source import Array
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.accuracy import direction_pairs, linear_estimate
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.search.grid_race import Candidate, race
from measured_materials.bake.tables.search.grid_search import choose_grid


class Counted:
    """A source that counts the directions it was asked for."""

    def __init__(self, source: analytic.Analytic) -> None:
        self.source, self.name, self.isotropic, self.bilateral = source, source.name, True, True
        self.facts: dict[str, object] = {}
        self.asked = 0

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """Of the source."""
        values = self.source.evaluate(wi, wo)
        self.asked += values.size // 3
        return values


def winner(candidates: tuple[Candidate, ...]) -> Grid:
    return min(candidates, key=lambda c: c.rms).grid


def test_a_clear_race_is_short_and_a_close_one_is_long() -> None:
    """A tie never ends before the directions do; a factor of ten ends with the first set, an eighth of all."""
    near, far = NormalVectorGrid(16, "bezier", 0.25, 0.5), NormalVectorGrid(16, "identity")
    twin = NormalVectorGrid(16, "bezier", 0.2500001, 0.5)
    clear, close = Counted(analytic.Ggx(alpha=0.1)), Counted(analytic.Ggx(alpha=0.1))
    assert winner(race(clear, [far, near])) == near
    race(close, [near, twin])
    assert clear.asked < close.asked / 6


def test_close_candidates_are_told_apart() -> None:
    """Within 1 % of the best at 131072 other directions, where one set of 8192 leaves 5 % of doubt."""
    source = analytic.OrenNayar((0.5, 0.4, 0.3), 0.5)
    grids: list[Grid] = [
        NormalVectorGrid(16, "bezier", theta, phi) for theta in (0.4, 0.5, 0.6) for phi in (0.4, 0.5, 0.6)
    ]
    pairs = direction_pairs(1 << 17, offset=0.3)
    truth = source.evaluate(pairs.wi, pairs.wo)
    rms = {grid: pairs.rms(linear_estimate(source, grid, pairs) - truth) for grid in grids}
    found = race(source, grids)
    assert [c.grid for c in found] == grids
    assert rms[winner(found)] <= 1.01 * min(rms.values())
    # What dropped out is reported by how far it was behind: never less than the winner's.
    assert all(np.isfinite(c.rms) and c.rms >= min(x.rms for x in found) for c in found)


def test_a_hopeless_bezier_is_not_fitted() -> None:
    """In the half-vector basis: it is a candidate of matte materials, of a mirror it would take time only."""
    kinds = []
    for source in (analytic.ModifiedPhong(exponent=5), analytic.Ggx(alpha=0.03)):
        kinds.append({c.grid.parameterization for c in choose_grid(source, 32, ("half",)).candidates})
    assert kinds[0] - kinds[1] == {"bezier"}
