"""What of a bake depends on whether light and viewer have one angle to each other's plane or two each.

Grids and tables do not (`bake.tables.grid`); samplers, closures and albedos of a turning viewer still do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from ..albedo import albedo_facts, directional_albedo, white_sky_albedo
from ..alias_sampler import SamplerLayout, build_sampler
from ..anisotropic import envelope as anisotropic_envelope
from ..anisotropic import envelope_texture
from ..anisotropic.sampler import SlopeLayout, build_slope_sampler
from ..anisotropic.views import ViewerGrid
from ..envelope import EnvelopeFit, fit_envelope, fit_preview, lamp_shares, pack_weights, residual_source
from ..source import Array, BrdfSource
from ..tables.anisotropic_grids import AnisotropicHalfGrid
from ..tables.bspline_fit import sample_spline
from ..tables.grid import Grid
from ..tables.grid_search import GridChoice
from ..tables.isotropic_search import refit_grid
from ..tables.table import Filter, Table
from ..tables.treated_source import TreatedSource
from .settings import BakeSettings

Viewers = tuple[int, int]
Share = Callable[[float], None]

_DEGREES = (0, 10, 20, 30, 40, 50, 60, 70, 75, 80, 85, 88)
_AZIMUTHS = 8
# Cells follow the lobe more closely than samples, which have to serve its tail too.
_CELL_WIDTH = 0.5
# The normal basis knows no slopes.
_USUAL_WIDTHS = 0.3, 0.3


class Reflection(Protocol):
    """A treated source as seen by viewers of one angle or two.

    Attributes
    ----------
    layout : sizes of the sampler of the table and of the residual
    """

    layout: Any

    def settings(self) -> dict[str, Any]:
        """Settings that others of its kind need not know, JSON-ready."""
        ...

    def cells(self, table: Table, progress: Share) -> Array:
        """Texels of alias tables that follow a table."""
        ...

    def albedo(self, source: BrdfSource) -> dict[str, Any]:
        """As `bake.albedo.albedo_facts`."""
        ...

    def table_albedo(self, table: Table) -> dict[str, Any]:
        """The same of a table, by fewer directions."""
        ...

    def preview(self) -> tuple[dict[str, Any], Array]:
        """Facts and weights of the closures of mode Preview."""
        ...

    def fit_envelope(self, progress: Share) -> Any:
        """Native closures under the source: `evaluate` and `facts`."""
        ...

    def residual(self, fit: Any) -> BrdfSource:
        """What is left of the source above an envelope."""
        ...

    def residual_grid(self, source: BrdfSource, grid: Grid) -> Grid:
        """Of the residual's table, given that of the whole."""
        ...

    def packed(self, fit: Any) -> Array:
        """The envelope's weights as an image."""
        ...

    def shares(self, fit: Any, residual: Table) -> dict[str, Array]:
        """Images of the mirror's probability beside that of the weights."""
        ...


class IsotropicReflection:
    """Seen from the plane of the normal and the viewer, whatever its azimuth."""

    def __init__(self, treated: TreatedSource, settings: BakeSettings) -> None:
        self._treated, self._settings, self.layout = treated, settings, settings.sampler

    def settings(self) -> dict[str, Any]:
        """None."""
        return {}

    def cells(self, table: Table, progress: Share) -> Array:
        """Of half vectors about the viewer's plane."""
        return build_sampler(table, self.layout).texels

    def albedo(self, source: BrdfSource) -> dict[str, Any]:
        """By elevation."""
        return albedo_facts(source)

    def table_albedo(self, table: Table) -> dict[str, Any]:
        """By elevation."""
        return albedo_facts(table, 48)

    def preview(self) -> tuple[dict[str, Any], Array]:
        """Closures of their own, fitted to the source."""
        fit = fit_preview(self._treated)
        return fit.facts(), fit.packed()

    def fit_envelope(self, progress: Share) -> EnvelopeFit:
        """Weights over the elevation."""
        return fit_envelope(self._treated, progress=progress)

    def residual(self, fit: EnvelopeFit) -> BrdfSource:
        """See `bake.envelope.residual`."""
        return residual_source(self._treated, fit)

    def residual_grid(self, source: BrdfSource, grid: Grid) -> Grid:
        """What the envelope leaves of a highlight has another width, and no reciprocity."""
        if self._settings.bases == ("normal",) and self._settings.spacing != "auto":
            return grid
        return refit_grid(source, grid, self._settings.resolution)

    def packed(self, fit: EnvelopeFit) -> Array:
        """Rows over the closures."""
        return pack_weights(fit)

    def shares(self, fit: EnvelopeFit, residual: Table) -> dict[str, Array]:
        """Following the direction of a lamp."""
        return {"residual_share": lamp_shares(fit, residual)}


class AnisotropicReflection:
    """Seen from all around: cells and weights follow the viewer's azimuth, or half a turn of it."""

    def __init__(
        self, treated: TreatedSource, grid: Grid, choice: GridChoice, settings: BakeSettings, viewers: Viewers
    ) -> None:
        self._treated, self._viewers = treated, viewers
        widths = (grid.width_x, grid.width_y) if isinstance(grid, AnisotropicHalfGrid) else _USUAL_WIDTHS
        self.layout = slope_layout(settings.sampler, widths, choice.half_turn)
        self._widths = self.layout.width_x, self.layout.width_y
        self._fit: anisotropic_envelope.AnisotropicFit | None = None

    def settings(self) -> dict[str, Any]:
        """The nodes of the weights."""
        return {"viewers": list(self._viewers)}

    def cells(self, table: Table, progress: Share) -> Array:
        """Of the half vector's slopes."""
        return build_slope_sampler(table, self.layout, progress).texels

    def albedo(self, source: BrdfSource) -> dict[str, Any]:
        """By elevation the mean over the viewer's azimuth; "largest" and "above_one_deg" are those of any."""
        return self._albedo(source, 48)

    def table_albedo(self, table: Table) -> dict[str, Any]:
        """As `albedo`. Of a spline, whose 256 taps would take minutes, that of its values at the nodes."""
        values = sample_spline(table.grid, table.values) if table.filter == "bspline" else table.values
        filter: Filter = "trilinear" if table.filter == "bspline" else table.filter
        return self._albedo(replace(table, values=values, filter=filter), 24)

    def _albedo(self, source: BrdfSource, n: int) -> dict[str, Any]:
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

    def fit_envelope(self, progress: Share) -> anisotropic_envelope.AnisotropicFit:
        """Weights over the elevation and the azimuth."""
        fit = anisotropic_envelope.fit_anisotropic_envelope
        self._fit = fit(self._treated, self._nodes(), self._widths, progress)
        return self._fit

    def preview(self) -> tuple[dict[str, Any], Array]:
        """The envelope's closures, with weights of their own."""
        fit = self._fit or self._unfitted()
        weights = anisotropic_envelope.fit_anisotropic_preview(self._treated, fit, self._widths)
        error = anisotropic_envelope.preview_error(self._treated, replace(fit, weights=weights), self._widths)
        plain = {key: fit.facts()[key] for key in ("closures", "n_theta", "n_phi", "folded")}
        return {**plain, "error": round(error, 6)}, envelope_texture.pack_weights(weights)

    def _unfitted(self) -> anisotropic_envelope.AnisotropicFit:
        """The closures that an envelope would have, of no weight yet."""
        trial = anisotropic_envelope._Trial(self._treated, self._widths)
        closures, _ = anisotropic_envelope._chosen(trial, self._widths)
        nodes = self._nodes()
        weights = np.zeros((nodes.n_theta, nodes.n_phi, len(closures), 3), np.float32)
        return anisotropic_envelope.AnisotropicFit(closures, nodes, weights, weights[..., 0, 0], {})

    def _nodes(self) -> ViewerGrid:
        folded = self.layout.folded
        return ViewerGrid(self._viewers[0], self._viewers[1] * (1 if folded else 2), folded)

    def residual(self, fit: anisotropic_envelope.AnisotropicFit) -> BrdfSource:
        """See `bake.anisotropic.envelope`."""
        return anisotropic_envelope.AnisotropicResidual(self._treated, fit)

    def residual_grid(self, source: BrdfSource, grid: Grid) -> Grid:
        """That of the whole."""
        return grid

    def packed(self, fit: anisotropic_envelope.AnisotropicFit) -> Array:
        """Blocks of rows over the closures."""
        return envelope_texture.pack_weights(fit.weights, envelope_texture.guarded_share(fit))

    def shares(self, fit: anisotropic_envelope.AnisotropicFit, residual: Table) -> dict[str, Array]:
        """None: the weights' share serves every lamp."""
        return {}


def reflection_of(
    treated: TreatedSource, grid: Grid, choice: GridChoice, settings: BakeSettings, viewers: Viewers
) -> Reflection:
    """Of a source that is isotropic, or is not."""
    if treated.isotropic:
        return IsotropicReflection(treated, settings)
    return AnisotropicReflection(treated, grid, choice, settings, viewers)


def slope_layout(wanted: SamplerLayout, widths: tuple[float, float], half_turn: bool) -> SlopeLayout:
    """Bins and cells of the sizes that the settings have for isotropic materials, shared between two axes each."""
    bins, cells = max(4, wanted.n_o // 4), max(8, round((wanted.n_h * wanted.n_phi) ** 0.5) * 2 // 3)
    return SlopeLayout(bins, bins, cells, cells, _CELL_WIDTH * widths[0], _CELL_WIDTH * widths[1], half_turn)
