"""Figures of a BRDF: slices, polar plots, albedo, reciprocity, and a picture by half and difference angle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...bake.brdf.preview_sphere import Reflects, to_srgb
from ...bake.inspection.curves import Slices, albedo_curves, angles_picture, reciprocity_map, slices
from ...bake.source import BrdfSource
from ...bake.sources.lookup.text_file import file_name_of
from .figure import BLUE, COLOURS, GREEN, RED, need_matplotlib, new_figure, save_png, styled

FIGURES = ("slices", "polar", "albedo", "reciprocity", "angles")
_LINES = ("-", "--", ":")
# Of the largest value: below it a logarithmic axis would show noise alone.
_LOWEST = 1e-6
# The lobes of grazing light would leave no room for the others in a polar plot.
_WIDEST_POLAR = 60.0
_TICK_GAP = 0.18
_TICK_DEGREES = (-90, -60, -30, 0, 30, 60, 90)


def figure_files(name: str, folder: Path) -> list[Path]:
    """The files that `draw_brdf` writes."""
    return [folder / f"{file_name_of(name) or 'brdf'}_{what}.png" for what in FIGURES]


def draw_brdf(
    source: BrdfSource, shown: Mapping[str, Reflects], name: str, folder: Path, about: str = ""
) -> list[Path]:
    """Write NAME_FIGURE.png for each of `FIGURES`; the files' paths. Raises BakeError.

    Parameters
    ----------
    source : of albedo, reciprocity and the picture by angles
    shown : by name, what slices and polar plots compare; at most three
    name : what the figures are called, and the files but for letters that make a path
    about : kept in the files
    """
    need_matplotlib(str(folder))
    cuts = {label: slices(one) for label, one in shown.items()}
    made = []
    with styled():
        for what, file in zip(FIGURES, figure_files(name, folder), strict=True):
            figure = _FIGURES[what](source, cuts)
            figure.suptitle(f"{name}: {_TITLES[what]}", fontsize=10)
            made.append(save_png(figure, file, about=about))
    return made


_TITLES = {
    "slices": "BRDF in the plane of incidence",
    "polar": "reflected radiance in the plane of incidence",
    "albedo": "directional albedo",
    "reciprocity": "exchange of light and viewer",
    "angles": "BRDF by half and difference angle",
}


def _slices(source: BrdfSource, cuts: Mapping[str, Slices]) -> Any:
    """Logarithmic, a colour for each incidence; a small mark where the mirror direction is."""
    figure = new_figure(6.3, 3.7)
    axes = figure.add_subplot()
    peak = max(float(np.max(cut.values)) for cut in cuts.values())
    lowest = np.inf
    for line, cut in zip(_LINES, cuts.values()):
        for colour, angle, values in zip(COLOURS, cut.incidence_deg, cut.values):
            seen = np.where(values > _LOWEST * peak, values, np.nan)
            lowest = min(lowest, float(np.nanmin(seen, initial=np.inf)))
            axes.semilogy(cut.viewer_deg, seen, line, color=colour)
            if line == _LINES[0]:
                axes.plot([-angle], [0.015], "|", color=colour, markersize=8, transform=axes.get_xaxis_transform())
    axes.set_ylim(*((lowest / 1.6, peak * 1.8) if peak > 0 else (_LOWEST, 1)))
    axes.set_xlim(-90, 90)
    axes.set_xticks(_TICK_DEGREES)
    axes.set_xlabel("viewer's polar angle in degrees, the light's side on the right; strokes: mirror directions")
    axes.set_ylabel("luminance of the BRDF, 1/sr")
    _legend(axes, cuts, ("upper right", "best"))
    return figure


def _polar(source: BrdfSource, cuts: Mapping[str, Slices]) -> Any:
    """Cube roots of f cos theta_o, close to what an eye makes of it, so that lobe and base are both to be seen."""
    figure = new_figure(6.3, 3.4)
    axes = figure.add_subplot(projection="polar")
    cuts = {name: cut.up_to(_WIDEST_POLAR) for name, cut in cuts.items()}
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_thetamin(-90)
    axes.set_thetamax(90)
    most = 0.0
    for line, cut in zip(_LINES, cuts.values()):
        viewer = np.radians(cut.viewer_deg)
        for colour, values in zip(COLOURS, cut.values):
            radius = np.cbrt(np.maximum(values * np.cos(viewer), 0))
            most = max(most, float(radius.max()))
            axes.plot(viewer, radius, line, color=colour)
    most = most if most > 0 else 1.0
    for colour, angle in zip(COLOURS, next(iter(cuts.values())).incidence_deg):
        axes.plot(np.radians([angle, angle]), [0.93 * most, 1.06 * most], color=colour, linewidth=2.2)
    axes.set_rlim(0, 1.06 * most)
    ticks = _round_ticks(most**3)
    axes.set_rticks(np.cbrt(ticks), [f"{tick:g}" for tick in ticks])
    axes.set_thetagrids(_TICK_DEGREES, [f"{abs(degrees)}°" for degrees in _TICK_DEGREES])
    axes.set_xlabel("f cos θ, 1/sr, on the scale of its cube root; strokes at the rim: the light", labelpad=-14)
    corners = figure.add_axes((0.0, 0.3, 1.0, 0.6), frameon=False, xticks=[], yticks=[])
    _legend(corners, cuts, ("upper left", "upper right"))
    return figure


def _round_ticks(most: float) -> list[float]:
    """Values that are 1 or 3 times a power of ten up to `most`, whose cube roots are far enough apart to be read."""
    steps = [scale * 10.0**power for power in range(8, -10, -1) for scale in (3, 1)]
    found: list[float] = []
    for step in steps:
        last = found[-1] if found else np.inf
        if step <= most and np.cbrt(last) - np.cbrt(step) > _TICK_GAP * np.cbrt(most) < np.cbrt(step):
            found.append(step)
    return found[::-1] or [1.0]


def _legend(axes: Any, cuts: Mapping[str, Slices], corners: tuple[str, str]) -> None:
    """Incidences in one corner of the figure or the axes, and in the other what the kinds of line are."""
    from matplotlib.lines import Line2D

    look: dict[str, Any] = {"frameon": True, "framealpha": 0.85, "edgecolor": "none"}
    angles = next(iter(cuts.values())).incidence_deg
    marks = [Line2D([], [], color=c, label=f"{angle:g}°") for c, angle in zip(COLOURS, angles)]
    first = axes.legend(handles=marks, title="light at", loc=corners[0], **look)
    if len(cuts) > 1:
        axes.add_artist(first)
        lines = [Line2D([], [], color="#555555", linestyle=style, label=name) for style, name in zip(_LINES, cuts)]
        axes.legend(handles=lines, loc=corners[1], **look)


def _albedo(source: BrdfSource, cuts: Mapping[str, Slices]) -> Any:
    """Seen under an even sky, and of a beam, which is the same where the material is reciprocal."""
    from matplotlib.lines import Line2D

    curves = albedo_curves(source)
    figure = new_figure(4.6, 3.4)
    axes = figure.add_subplot()
    for channel, colour in enumerate((RED, GREEN, BLUE)):
        axes.plot(curves.degrees, curves.towards[:, channel], color=colour)
        axes.plot(curves.degrees, curves.of_beam[:, channel], "--", color=colour)
    most = float(max(curves.towards.max(), curves.of_beam.max()))
    if most > 0.8:
        axes.axhline(1, color="#000000", linewidth=0.8, linestyle=":")
        axes.text(1, 1, "all light", va="bottom", fontsize=8)
    axes.set_xlim(0, 90)
    axes.set_ylim(0, max(1.12 * most, 1e-3))
    axes.set_xticks(range(0, 91, 15))
    axes.set_xlabel("polar angle of viewer or beam in degrees")
    axes.set_ylabel("share of the light, red, green and blue")
    kinds = (("-", "to a viewer, of an even sky"), ("--", "of a beam, to everywhere"))
    lines = [Line2D([], [], color="#555555", linestyle=style, label=words) for style, words in kinds]
    axes.legend(handles=lines, frameon=False, loc="best")
    return figure


def _reciprocity(source: BrdfSource, cuts: Mapping[str, Slices]) -> Any:
    """What exchanging light and viewer changes, over all pairs in the plane of incidence."""
    degrees, difference = reciprocity_map(source)
    figure = new_figure(4.6, 3.8)
    axes = figure.add_subplot()
    reach = float(np.clip(np.nanquantile(np.abs(difference), 0.98), 0.02, 1)) if np.isfinite(difference).any() else 1.0
    extent = (degrees[0], degrees[-1], degrees[0], degrees[-1])
    ends = {"vmin": -100 * reach, "vmax": 100 * reach}
    picture = axes.imshow(100 * difference, origin="lower", extent=extent, cmap="RdBu_r", **ends)
    axes.grid(False)
    axes.set_facecolor("#888888")
    axes.set_xticks(_TICK_DEGREES[1:-1])
    axes.set_yticks(_TICK_DEGREES[1:-1])
    axes.set_xlabel("viewer's polar angle in degrees")
    axes.set_ylabel("light's polar angle in degrees")
    figure.colorbar(picture, ax=axes, extend="both", label="f(light, viewer) over the mean of both, less 1, in %")
    return figure


def _angles(source: BrdfSource, cuts: Mapping[str, Slices]) -> Any:
    """As colours: the peak on the left edge, grazing angles above, retroreflection below."""
    picture, white = angles_picture(source)
    figure = new_figure(4.2, 3.9)
    axes = figure.add_subplot()
    axes.imshow(to_srgb(picture), extent=(0, 1, 0, 1), aspect="equal", interpolation="bilinear")
    axes.grid(False)
    degrees = np.array([1, 5, 10, 20, 30, 45, 60, 90])
    axes.set_xticks(np.sqrt(degrees / 90), [f"{value}" for value in degrees])
    even = np.arange(0, 91, 15)
    axes.set_yticks(even / 90, [f"{value}" for value in even])
    axes.set_xlabel("half angle in degrees")
    axes.set_ylabel("difference angle in degrees")
    axes.set_title(f"white: {white:.3g} 1/sr", loc="right", fontsize=8)
    return figure


_FIGURES = {
    "slices": _slices,
    "polar": _polar,
    "albedo": _albedo,
    "reciprocity": _reciprocity,
    "angles": _angles,
}
