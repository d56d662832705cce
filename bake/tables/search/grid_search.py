"""Choosing a table's basis, parameterisation and shape by the error measured at directions that no table holds.

Candidates have equal bytes. Only the samples round the test directions are evaluated, so that a choice costs seconds
whatever the resolution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from ...errors import BakeError
from ...patches import patches_of
from ...source import Array, BrdfSource, Facts
from ..accuracy import DirectionPairs
from ..grids.anisotropic_grids import AnisotropicHalfGrid, AnisotropicNormalGrid
from ..grids.grid import HORIZON_SHARES, Grid
from ..grids.normal_vector_grid import NormalVectorGrid
from ..grids.parameterization import Parameterization
from ..grids.patch_grid import PatchGrid
from .alpha_search import AlphaSearch
from .anisotropic_search import SYMMETRIC, AnisotropicCandidates, best_half_shape
from .grid_fit import GridErrors
from .grid_race import Candidate, race
from .isotropic_search import IsotropicCandidates, with_cosine_powers

Basis = Literal["normal", "half"]
BASES: tuple[str, ...] = get_args(Basis)


@dataclass(frozen=True)
class GridChoice:
    """Every candidate, the Bezier trials where there were any, and how far the source is from its symmetries.

    asymmetries : "reciprocity_error", and of an anisotropic source "half_turn_error"; of an isotropic source the RMS
        of half the difference between f(wi, wo) and f(wo, wi), as a share of the signal's
    """

    candidates: tuple[Candidate, ...]
    search: AlphaSearch | None
    asymmetries: dict[str, float]

    @classmethod
    def of_black(cls, isotropic: bool) -> GridChoice:
        """The smallest grid, for a source of which nothing is to be held."""
        smallest = NormalVectorGrid(4, "uniform") if isotropic else AnisotropicNormalGrid((4, 4, 4, 8), folded=True)
        same = {"reciprocity_error": 0.0} if isotropic else {"reciprocity_error": 0.0, "half_turn_error": 0.0}
        return cls((Candidate(smallest, 0.0),), None, same)

    @property
    def grid(self) -> Grid:
        """The candidate of least error."""
        return min(self.candidates, key=lambda c: c.rms).grid

    @property
    def reciprocity_error(self) -> float:
        """How far exchanging light and viewer changes the source."""
        return self.asymmetries["reciprocity_error"]

    @property
    def half_turn(self) -> bool:
        """Whether half a turn of the surface changes nothing."""
        return self.asymmetries.get("half_turn_error", 0.0) <= SYMMETRIC

    def facts(self) -> Facts:
        """JSON-ready account of all candidates, best first."""
        ranked = sorted(self.candidates, key=lambda c: c.rms)
        return {
            **self.asymmetries,
            "candidates": [
                {"shape": list(c.grid.shape), "rms": c.rms, **c.grid.facts(), "entries": int(np.prod(c.grid.shape))}
                for c in ranked
            ],
        }


def choose_grid(
    source: BrdfSource,
    n: int,
    bases: Sequence[str] = BASES,
    parameterization: Parameterization | Literal["auto"] = "auto",
    alpha: Literal["error", "intensity"] | tuple[float, float] = "error",
    progress: Callable[[float], None] | None = None,
) -> GridChoice:
    """Measure the candidates for a table as large as N x N x 2N, or as `anisotropic_search.half_shape` of N.

    Parameters
    ----------
    bases : to choose from
    parameterization : of the table; "auto" to choose by error, and then over all bases the patches of a source that
        is constant within them (`bake.patches`), whatever N. The half basis of an anisotropic table has slope widths
        of its own, which are fitted: it is left out where another parameterisation is named
    alpha : for "bezier" in the normal-vector basis: the metric that chooses it, or (alpha_theta, alpha_phi)
    progress : called with the share done

    Raises
    ------
    BakeError : an anisotropic table has no such parameterisation
    """
    kind = IsotropicCandidates if source.isotropic else AnisotropicCandidates
    wanted = [(basis, k) for basis in bases for k in _spacings(kind, basis, parameterization)]
    if not wanted:
        cause = f"cannot be {parameterization!r} of an anisotropic table in basis {' or '.join(bases)}"
        raise BakeError("parameterization", cause, "choose auto, or the normal basis and one that is not squared")
    made: IsotropicCandidates | AnisotropicCandidates = kind(source, n, alpha)
    patches = "" if source.isotropic else patches_of(source)
    if patches and parameterization == "auto" and set(bases) == {*BASES}:
        # Nothing else comes near, of any size.
        return GridChoice(race(source, (PatchGrid(patches),)), None, made.asymmetries())
    for done, (basis, spacing) in enumerate(wanted):
        if progress:
            progress(done / len(wanted))
        made.add(basis, spacing, parameterization == "auto")
    return GridChoice(race(source, made.found), made.search, made.asymmetries())


def _spacings(kind: type[Any], basis: str, parameterization: str) -> tuple[str, ...]:
    if parameterization == "auto":
        return tuple(kind.kinds[basis])
    return tuple(kind.named(basis, parameterization))


def best_horizon(source: BrdfSource, grid: Grid, pairs: DirectionPairs, truth: Array) -> Grid:
    """The grid whose samples at the horizon are taken where, and continued as, it serves this material best; of half
    vectors also what cosines its values are stored times.

    By the RMS at the pairs; of half vectors about a turning viewer, which have two ways beyond the horizon that the RMS
    hardly tells apart, by the light seen at grazing, and so their shape (`best_half_shape`).
    """
    errors = GridErrors(source, pairs, truth)
    if isinstance(grid, PatchGrid):
        return grid
    if isinstance(grid, AnisotropicHalfGrid):
        return best_half_shape(source, grid, errors)
    ends = [replace(grid, horizon_share=share) for share in HORIZON_SHARES]
    return min((one for end in ends for one in with_cosine_powers(end)), key=errors)
