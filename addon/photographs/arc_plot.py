"""Report plot of a shading map: averages before and after linearisation (Kautz et al. 2004), and the envelope."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...bake.bundle.bundle import read_bundle
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.record_parts import PhotographsRecord
from ...bake.source import Array
from ..plots.figure import need_matplotlib, new_figure, save_png

_INK, _SECOND = "#20324f", "#c2622d"


def draw_arc(bundle: Path, path: Path, about: str = "") -> None:
    """Write a PNG of a baked swatch, whole or not at all. Raises BakeError."""
    need_matplotlib(str(path))
    from matplotlib.ticker import MaxNLocator

    record = ShadingMapRecord.read(read_bundle(bundle))
    figure = new_figure(11, 4.2)
    before, after, shares = figure.subplots(1, 3)
    _draw_before(before, record.photographs)
    _draw_after(after, record.photographs)
    _draw_shares(shares, record)
    for axes in (before, after):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in (before, after, shares):
        axes.set_ylim(bottom=0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{record.name}: from photographs to a shading map")
    save_png(figure, path, 110, about)


def _draw_before(axes: Any, photographs: PhotographsRecord) -> None:
    """The photographs, sorted by average radiance, over the elevation where it is known."""
    values = np.array(photographs.averages) / max(photographs.averages)
    axes.plot(np.arange(len(values)), values, "o-", color=_INK, markersize=4, linewidth=1)
    elevations = photographs.elevations_deg
    axes.set(title="photographs", xlabel="photograph, sorted", ylabel="average radiance / brightest")
    if elevations:
        second = axes.twinx()
        second.plot(np.arange(len(values)), elevations, ".", color=_SECOND, markersize=4)
        second.set_ylabel("elevation of the light (degrees)", color=_SECOND)
        second.set_ylim(0, 90)
        second.spines["top"].set_visible(False)


def _draw_after(axes: Any, photographs: PhotographsRecord) -> None:
    after = photographs.after
    axes.plot([0, len(after) - 1], [0, 1], "-", color="#bbbbbb", linewidth=1, label="linear in r")
    axes.plot(np.arange(len(after)), after, "o", color=_INK, markersize=5, label="slices")
    axes.set(title="slices", xlabel="slice", ylabel="average radiance / brightest")
    axes.legend(frameon=False, loc="upper left")


def _draw_shares(axes: Any, record: ShadingMapRecord) -> None:
    levels, mean, low, high = envelope_shares(record)
    axes.fill_between(levels, low, high, color=_INK, alpha=0.15, linewidth=0, label="four of five texels")
    axes.plot(levels, mean, "o-", color=_INK, markersize=4, linewidth=1, label="all light")
    share = record.map.envelope_energy
    axes.set(title=f"envelope, {share:.0%} of the light", xlabel="level r / a_max", ylabel="share of reflected light")
    axes.set_ylim(0, 1.02)
    axes.legend(frameon=False, loc="lower right")


def envelope_shares(record: ShadingMapRecord) -> tuple[Array, Array, Array, Array]:
    """Levels of the slices that are not black, the share of light that the envelope carries there, and the first and
    the ninth decile of the texels' shares. Raises BakeError.
    """
    shading_map = record.load_map()
    lit = shading_map.slices[1:]
    carried = shading_map.levels[1:, None, None, None] * _envelope(record)
    mean = carried.sum(axis=(1, 2, 3), dtype=np.float64) / np.maximum(lit.sum(axis=(1, 2, 3), dtype=np.float64), 1e-30)
    texels = np.divide(carried.sum(-1), lit.sum(-1), out=np.zeros(lit.shape[:-1]), where=lit.sum(-1) > 0)
    low, high = np.quantile(np.minimum(texels, 1), (0.1, 0.9), axis=(1, 2))
    return shading_map.levels[1:], mean, low, high


def _envelope(record: ShadingMapRecord) -> Array:
    """m (H, W, 3) as the material uses it within the levels of the photographs."""
    bundle, stored = record.files(), record.map
    if stored.model == "power":
        k, exponent = record.load_tiles()
        return np.where(exponent <= 1, k, 0)
    return bundle.load("envelope")[..., :3] / stored.envelope_scale
