"""What of a bake depends on whether the viewer has one angle or two: nodes of weights, cells of samplers, albedos."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..envelope import (
    Elevations,
    EnvelopeFit,
    EnvelopeSettings,
    PreviewFit,
    ResidualSource,
    SlopeShareLayout,
    ViewerGrid,
    fit_envelope,
    fit_preview,
    lamp_shares,
)
from ..envelope.anisotropic_lobes import AnisotropicLobe
from ..envelope.closures import Closure
from ..lobes.lobes import Lobe
from ..sampling.half_vector_warp import HalfVectorWarp
from ..sampling.slope_cells import SlopeLayout
from ..sampling.slope_warp import SlopeWarp
from ..sampling.warp_choice import fitted_warp
from ..source import Array, BrdfSource, Facts
from ..tables.albedo import albedo_facts, directional_albedo, white_sky_albedo
from ..tables.bspline_fit import sample_spline
from ..tables.grids.anisotropic_grids import AnisotropicHalfGrid
from ..tables.grids.grid import Grid
from ..tables.grids.patch_grid import PatchGrid
from ..tables.search import anisotropic_search, isotropic_search
from ..tables.search.grid_search import GridChoice
from ..tables.table import Table
from ..tables.treated_source import TreatedSource
from .samplers import IsotropicLayout, Layout, sampler_texels
from .settings import BakeSettings

Share = Callable[[float], None]

_DEGREES = (0, 10, 20, 30, 40, 50, 60, 70, 75, 80, 85, 88)
_AZIMUTHS = 8
# Cells follow the lobe more closely than samples, which have to serve its tail too.
_CELL_WIDTH = 0.5
# The normal basis knows no slopes.
_USUAL_WIDTHS = 0.3, 0.3


class Reflection(ABC):
    """A treated source as seen by viewers of one angle or two.

    Attributes
    ----------
    layout : kind and sizes of the samplers
    black : it reflects nothing, and so need its closures
    basis : closures to choose from; None for all
    """

    layout: Layout
    basis: tuple[Closure, ...] | None = None
    black = False

    def __init__(self, treated: TreatedSource) -> None:
        self._treated = treated

    def sampler(self, table: Table, progress: Share) -> tuple[Array, Layout]:
        """Texels of a sampler that follows a table, and its layout: a warp's rows follow the width of the highlight."""
        layout = fitted_warp(table, self.layout) if isinstance(self.layout, HalfVectorWarp) else self.layout
        return sampler_texels(table, layout, progress), layout

    def fit_envelope(self, progress: Share) -> EnvelopeFit:
        """Native closures under the source."""
        if self.black:
            return EnvelopeFit.of_nothing(self.nodes(), self.nodes().basis[0])
        return fit_envelope(self._treated, EnvelopeSettings(viewers=self.nodes(), basis=self.basis), progress)

    def residual(self, fit: EnvelopeFit) -> BrdfSource:
        """What is left of the source above an envelope."""
        return ResidualSource(self._treated, fit)

    @abstractmethod
    def nodes(self) -> Elevations | ViewerGrid:
        """Of the envelope's weights."""

    def fit_preview(self, envelope: EnvelopeFit | None) -> PreviewFit:
        """The closures of mode Preview, given the envelope where there is one."""
        return PreviewFit.of_nothing(self.nodes(), self.nodes().basis[0]) if self.black else self.preview(envelope)

    @abstractmethod
    def preview(self, envelope: EnvelopeFit | None) -> PreviewFit:
        """The same of a source that is not black."""

    @abstractmethod
    def albedo(self, source: BrdfSource) -> Facts:
        """As `bake.tables.albedo.albedo_facts`."""

    @abstractmethod
    def table_albedo(self, table: Table) -> Facts:
        """The same of a table, by fewer directions."""

    @abstractmethod
    def residual_grid(self, source: BrdfSource, grid: Grid, progress: Share) -> Grid:
        """Grid of the residual's table, given that of the whole."""

    @abstractmethod
    def shares(self, fit: EnvelopeFit, residual: Table) -> dict[str, Array]:
        """Images of the mirror's probability beside that of the weights, by name."""


class IsotropicReflection(Reflection):
    """Seen from the plane of the normal and the viewer, whatever its azimuth."""

    def __init__(self, treated: TreatedSource, settings: BakeSettings) -> None:
        super().__init__(treated)
        self._settings, self.layout = settings, settings.sampler

    def nodes(self) -> Elevations:
        """Elevations."""
        return Elevations()

    def preview(self, envelope: EnvelopeFit | None) -> PreviewFit:
        """Closures of their own, fitted to the source."""
        return fit_preview(self._treated, closures=self.basis)

    def albedo(self, source: BrdfSource) -> Facts:
        """By elevation."""
        return albedo_facts(source)

    def table_albedo(self, table: Table) -> Facts:
        """By elevation."""
        return albedo_facts(table, n=48)

    def residual_grid(self, source: BrdfSource, grid: Grid, progress: Share) -> Grid:
        """What the envelope leaves of a highlight has another width, and no reciprocity."""
        if self._settings.bases == ("normal",) and self._settings.spacing != "auto":
            return grid
        return isotropic_search.refit_grid(source, grid, self._settings.resolution)

    def shares(self, fit: EnvelopeFit, residual: Table) -> dict[str, Array]:
        """Following the direction of a lamp."""
        return {"residual_share": lamp_shares(fit, residual)}


class AnisotropicReflection(Reflection):
    """Seen from all around: cells and weights follow the viewer's azimuth, or half a turn of it."""

    layout: SlopeLayout

    def __init__(self, treated: TreatedSource, grid: Grid, choice: GridChoice, settings: BakeSettings) -> None:
        super().__init__(treated)
        self._counts = settings.viewers
        widths = (grid.width_x, grid.width_y) if isinstance(grid, AnisotropicHalfGrid) else _USUAL_WIDTHS
        self.layout = slope_layout(settings.sampler, widths, choice.half_turn)

    def nodes(self) -> ViewerGrid:
        """Elevations and azimuths."""
        layout, (n_theta, n_phi) = self.layout, self._counts
        return ViewerGrid(n_theta, n_phi * (1 if layout.folded else 2), layout.folded, (layout.width_x, layout.width_y))

    def preview(self, envelope: EnvelopeFit | None) -> PreviewFit:
        """The envelope's closures, with weights of their own."""
        return fit_preview(self._treated, self.nodes(), envelope.closures if envelope else self.basis)

    def albedo(self, source: BrdfSource) -> Facts:
        """By elevation the mean over the viewer's azimuth; "largest" and "above_one_deg" are those of any."""
        return self._albedo(source, 48)

    def table_albedo(self, table: Table) -> Facts:
        """As `albedo`. Of a spline, whose 256 taps would take minutes, that of its values at the nodes."""
        if table.filter == "bspline":
            table = replace(table, values=sample_spline(table.grid, table.values), filter="trilinear")
        return self._albedo(table, 24)

    def _albedo(self, source: BrdfSource, n: int) -> Facts:
        azimuths = np.arange(_AZIMUTHS) * (2 * np.pi / _AZIMUTHS) + 0.1
        rows = np.array([directional_albedo(source, np.radians(_DEGREES), n, float(phi)) for phi in azimuths])
        degrees = np.array(_DEGREES)
        return {
            "theta_o_deg": degrees.tolist(),
            "directional": rows.mean(0).round(6).tolist(),
            "white_sky": white_sky_albedo(source, n).round(6).tolist(),
            "largest": round(float(rows.max()), 6),
            "above_one_deg": degrees[rows.max((0, 2)) > 1.001].tolist(),
        }

    def residual_grid(self, source: BrdfSource, grid: Grid, progress: Share) -> Grid:
        """What the envelope leaves has no reciprocity."""
        return anisotropic_search.refit_grid(source, grid, self._treated, progress)

    def shares(self, fit: EnvelopeFit, residual: Table) -> dict[str, Array]:
        """Following the direction of a lamp, in nodes that are even where the highlights are."""
        return {"residual_share": lamp_shares(fit, residual, SlopeShareLayout.of(self.layout))}


def reflection_of(treated: TreatedSource, grid: Grid, choice: GridChoice, settings: BakeSettings) -> Reflection:
    """Reflection of an isotropic or an anisotropic source."""
    if treated.isotropic:
        return IsotropicReflection(treated, settings)
    made = AnisotropicReflection(treated, grid, choice, settings)
    if isinstance(grid, PatchGrid):
        # Of all closures it alone is constant within a patch, as what it leaves has to be.
        made.basis = (AnisotropicLobe("lambert"),)
    return made


def transmission_of(treated: TreatedSource, grid: Grid, choice: GridChoice, settings: BakeSettings) -> Reflection:
    """The same of a transmission, mirrored: of native closures only Translucent BSDF lets light through a sheet."""
    made = reflection_of(treated, grid, choice, settings)
    made.basis = (Lobe("lambert"),) if treated.isotropic else (AnisotropicLobe("lambert"),)
    return made


def slope_layout(wanted: IsotropicLayout, widths: tuple[float, float], half_turn: bool) -> SlopeLayout:
    """Bins and cells of the sizes that the settings have for isotropic materials, shared between two axes each."""
    width_x, width_y = (_CELL_WIDTH * width for width in widths)
    if isinstance(wanted, HalfVectorWarp):
        bins, cells = max(4, wanted.n_o * 3 // 8), max(8, round((wanted.n_h * wanted.n_phi) ** 0.5) * 6 // 7)
        return SlopeWarp(bins, bins, cells, cells, width_x, width_y, half_turn)
    bins, cells = max(4, wanted.n_o // 4), max(8, round((wanted.n_h * wanted.n_phi) ** 0.5) * 2 // 3)
    return SlopeLayout(bins, bins, cells, cells, width_x, width_y, half_turn)
