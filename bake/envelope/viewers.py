"""Nodes of viewers at which an envelope has weights: of one angle, or of two for anisotropic materials.

Both kinds answer the same questions: where their nodes are, how to interpolate between them, how a source looks from
there, which closures serve, and how thoroughly to search and to verify.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..errors import BakeError
from ..lobes.lobes import Lobe
from ..source import Array, BrdfSource, Facts
from ..tables.treated_source import TreatedSource
from .anisotropic_lobes import ANISOTROPIC_BASIS, AnisotropicLobe
from .closures import BASIS, Closure, neighbours
from .views import Sizes, Views, Widths, chord_of, gauss_chords, interpolated, sample_views, slope_views

MOST_NODES, MOST_EACH_WAY = 1024, 256
_AZIMUTHS = 6

Source = BrdfSource | TreatedSource


@dataclass(frozen=True)
class Search:
    """How closures are chosen.

    Parameters
    ----------
    gain : what the share carried must grow by for a change to be made
    ratios : steps of the widths, one after the other
    repeated : each step as long as it brings something, or once
    exchanged : also try every closure of the basis in place of one chosen earlier
    of_basis : enough is a share of what the whole basis carries, or of all light. The whole of an anisotropic basis
        takes longer than all the rest of the search
    """

    gain: float
    ratios: tuple[float, ...]
    repeated: bool
    exchanged: bool
    of_basis: bool


@dataclass(frozen=True)
class Effort:
    """Sizes of light directions, and numbers of viewers.

    Parameters
    ----------
    choice, preview, fit, dense, shares, independent : directions that closures are chosen on, that Preview is fitted
        to, that the programme is solved on, that verify it, that give the residual's share, and that measure what came
        out. Of fit, dense and independent no two share a direction
    parts : viewers verified from one node to the next
    measured : elevations of viewers that measure the result
    """

    choice: Sizes
    preview: Sizes
    fit: Sizes
    dense: Sizes
    shares: Sizes
    independent: Sizes
    parts: int
    measured: int


class Viewers(Protocol):
    """What both kinds have; arrays over the nodes have the axes of `shape`, lists of viewers one axis (V,).

    A viewer is given by the chord sqrt(1 - cos theta_o) and the azimuth phi.

    Attributes
    ----------
    effort, search : how thoroughly to look, and how closures are chosen
    basis : closures to choose from
    shape : nodes along each angle, elevation first
    periodic : axes of `shape` that go all around

    Methods
    -------
    nodes : chords and azimuths of all nodes, (V,), elevation before azimuth
    between : the same of nodes and `effort.parts` - 1 viewers between each two
    chosen_from : chords, azimuths and weights (V,) of the viewers that closures are chosen for
    azimuths : (A,), of no node, from which each elevation is measured
    angles : chords and azimuths (...) of unit vectors (..., 3)
    interpolated : values (*shape, ...) at the nodes, linearly at viewers (...)
    views : a source as viewers (V,) see it. Raises BakeError for values that are not finite
    treated : the source as it is fitted. Raises BakeError where it needs another kind of viewers
    neighbours : the same closure with other widths, by a ratio
    facts : JSON-ready
    """

    @property
    def effort(self) -> Effort: ...
    @property
    def search(self) -> Search: ...
    @property
    def basis(self) -> Sequence[Closure]: ...
    @property
    def periodic(self) -> tuple[int, ...]: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    def nodes(self) -> tuple[Array, Array]: ...
    def between(self) -> tuple[Array, Array]: ...
    def chosen_from(self) -> tuple[Array, Array, Array]: ...
    def azimuths(self) -> Array: ...
    def angles(self, wo: Array) -> tuple[Array, Array]: ...
    def interpolated(self, values: Array, chords: Array, phi: Array) -> Array: ...
    def views(self, source: Source, chords: Array, phi: Array, sizes: Sizes) -> Views: ...
    def treated(self, source: Source) -> Source: ...
    def neighbours(self, lobe: Any, ratio: float) -> Sequence[Closure]: ...
    def facts(self) -> Facts: ...


@dataclass(frozen=True)
class Elevations:
    """Viewers of an isotropic material: nodes even in the chord sqrt(1 - cos theta_o) from 0 to 1."""

    count: int = 64
    # The choice needs no more: trials at twice the size chose the same or changed the share by less than 0.01.
    effort = Effort((24, 12), (28, 14), (40, 20), (41, 25), (41, 25), (53, 33), parts=4, measured=40)
    search = Search(1.002, tuple(1.25**0.5**k for k in range(4)), repeated=True, exchanged=True, of_basis=True)
    basis = BASIS
    periodic = ()

    def __post_init__(self) -> None:
        whole = isinstance(self.count, (int, np.integer)) and not isinstance(self.count, bool)
        if not whole or not 4 <= self.count <= MOST_NODES:
            raise BakeError(
                "envelope nodes", f"cannot be {self.count!r}", f"give a whole number from 4 to {MOST_NODES}"
            )

    @property
    def shape(self) -> tuple[int]:
        """Nodes in theta_o."""
        return (self.count,)

    def nodes(self) -> tuple[Array, Array]:
        """Chords and azimuths 0."""
        return np.linspace(0, 1, self.count), np.zeros(self.count)

    def between(self) -> tuple[Array, Array]:
        """Of nodes and the viewers between them."""
        chords = np.arange((self.count - 1) * self.effort.parts + 1) / self.effort.parts / (self.count - 1)
        return chords, np.zeros(len(chords))

    def chosen_from(self) -> tuple[Array, Array, Array]:
        """Twelve elevations."""
        chords, weights = gauss_chords(12)
        return chords, np.zeros(len(chords)), weights

    def azimuths(self) -> Array:
        """One is as good as any."""
        return np.zeros(1)

    def angles(self, wo: Array) -> tuple[Array, Array]:
        """Chords, and no azimuth."""
        return chord_of(wo), np.zeros(1)

    def interpolated(self, values: Array, chords: Array, phi: Array) -> Array:
        """Linear in the chord."""
        return interpolated(values, chords)

    def views(self, source: Source, chords: Array, phi: Array, sizes: Sizes) -> Views:
        """Light on one side of the viewer."""
        return sample_views(source, chords, *sizes)

    def treated(self, source: Source) -> Source:
        """Negative values count as 0, and what is not symmetric in phi_delta is averaged with its mirror image."""
        treated = source if isinstance(source, TreatedSource) else TreatedSource(source)
        if not treated.source.isotropic:
            raise BakeError(treated.name, "is anisotropic, and this envelope is isotropic", "fit an isotropic material")
        return treated

    def neighbours(self, lobe: Lobe, ratio: float) -> list[Lobe]:
        """Of one width."""
        return neighbours(lobe, ratio)

    def facts(self) -> Facts:
        """JSON-ready."""
        return {"nodes": self.count}


@dataclass(frozen=True)
class ViewerGrid:
    """Viewers of an anisotropic material: `n_theta` nodes even in the chord, `n_phi` even over the azimuth.

    Parameters
    ----------
    folded : the azimuth covers half a turn
    widths : of the half vector's slopes, where the source's highlight is resolved; of the fit alone, not of what it
        gives
    """

    n_theta: int
    n_phi: int
    folded: bool
    widths: Widths = (0.3, 0.3)
    effort = Effort((22, 20), (40, 36), (40, 36), (49, 45), (40, 36), (57, 53), parts=2, measured=10)
    search = Search(1.003, (1.6, 1.3, 1.12), repeated=False, exchanged=False, of_basis=False)
    basis = ANISOTROPIC_BASIS
    periodic = (1,)

    @property
    def shape(self) -> tuple[int, int]:
        """Nodes in theta_o and phi_o."""
        return self.n_theta, self.n_phi

    @property
    def turn(self) -> float:
        """Radians that the azimuth covers."""
        return np.pi if self.folded else 2 * np.pi

    def nodes(self) -> tuple[Array, Array]:
        """Chords and azimuths."""
        return self._evenly(1)

    def between(self) -> tuple[Array, Array]:
        """Of nodes and the viewers between them, along both angles."""
        return self._evenly(self.effort.parts)

    def _evenly(self, parts: int) -> tuple[Array, Array]:
        chords = np.linspace(0, 1, (self.n_theta - 1) * parts + 1)
        phi = np.arange(self.n_phi * parts) * (self.turn / (self.n_phi * parts))
        return np.repeat(chords, len(phi)), np.tile(phi, len(chords))

    def chosen_from(self) -> tuple[Array, Array, Array]:
        """Five elevations from three sides."""
        chords, weights = gauss_chords(5)
        phi = np.array([0.2, 1.7, 3.0])
        return np.repeat(chords, len(phi)), np.tile(phi, len(chords)), np.repeat(weights, len(phi))

    def azimuths(self) -> Array:
        """Six, between nodes."""
        return (np.arange(_AZIMUTHS) + 0.37) * (self.turn / _AZIMUTHS)

    def angles(self, wo: Array) -> tuple[Array, Array]:
        """Chords and azimuths."""
        return chord_of(wo), np.arctan2(wo[..., 1], wo[..., 0])

    def interpolated(self, values: Array, chords: Array, phi: Array) -> Array:
        """Linear in the chord and in the azimuth."""
        flat = values.reshape(*self.shape, -1).astype(np.float64)
        t = np.clip(chords, 0, 1) * (self.n_theta - 1)
        p = np.remainder(phi, self.turn) * (self.n_phi / self.turn)
        i, j = np.minimum(t.astype(np.intp), self.n_theta - 2), np.floor(p).astype(np.intp)
        t, p = (t - i)[..., None], (p - j)[..., None]
        j, k = j % self.n_phi, (j + 1) % self.n_phi
        low = flat[i, j] * (1 - p) + flat[i, k] * p
        high = flat[i + 1, j] * (1 - p) + flat[i + 1, k] * p
        result: Array = low * (1 - t) + high * t
        return result.reshape(*result.shape[:-1], *values.shape[2:])

    def views(self, source: Source, chords: Array, phi: Array, sizes: Sizes) -> Views:
        """Light on all sides."""
        return slope_views(source, chords, phi, self.widths, sizes)

    def treated(self, source: Source) -> Source:
        """As it is, non-negative."""
        return source

    def neighbours(self, lobe: AnisotropicLobe, ratio: float) -> list[AnisotropicLobe]:
        """Of one width or both."""
        return lobe.neighbours(ratio)

    def facts(self) -> Facts:
        """JSON-ready."""
        return {"n_theta": self.n_theta, "n_phi": self.n_phi, "folded": self.folded}
