"""A drawing of how a swatch is photographed with a phone, a lamp on a string and a protractor."""

from __future__ import annotations

from math import cos, radians, sin
from pathlib import Path

from commands import save
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Rectangle
from PIL import Image

_ELEVATIONS = (10, 20, 30, 40, 50, 60, 70)
_SHOWN = 40
_INK, _FAINT, _LIGHT = "#222222", "#9a9a9a", "#d98c00"


def make(out: Path, folder: Path) -> None:
    """Draw it."""
    figure = Figure(figsize=(9, 5.4), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_xlim(-4.9, 6.4)
    axes.set_ylim(-1.25, 5.9)
    axes.set_aspect("equal")
    axes.axis("off")
    _table(axes)
    _phone(axes)
    _lamp(axes)
    figure.savefig(folder / "setup.png")
    save(Image.open(folder / "setup.png"), out / "setup.jpg")


def _say(axes: object, x: float, y: float, text: str, **more: object) -> None:
    axes.text(x, y, text, color=_INK, fontsize=11, va="center", **more)


def _table(axes: object) -> None:
    axes.plot([-4.8, 6.3], [0, 0], color=_INK, lw=2)
    axes.add_patch(Rectangle((-0.6, 0), 1.2, 0.1, color="#46618c"))
    axes.add_patch(Rectangle((-1.15, 0), 0.4, 0.06, facecolor="white", edgecolor=_INK))
    _say(axes, 0.0, -0.35, "flat swatch", ha="center")
    _say(axes, -1.15, -0.8, "white card", ha="center")
    axes.plot([-0.98, -1.1], [-0.03, -0.62], color=_FAINT, lw=1)


def _phone(axes: object) -> None:
    axes.add_patch(Rectangle((-0.5, 4.6), 1.0, 0.16, color=_INK))
    axes.add_patch(Circle((0.0, 4.57), 0.07, color="#5a8fd0"))
    # A stand.
    axes.plot([-0.5, -3.4, -3.4], [4.68, 4.68, 0], color=_INK, lw=3, solid_capstyle="round")
    axes.plot([0, -0.75], [4.5, 0.12], color=_FAINT, lw=1, ls=":")
    axes.plot([0, 0.75], [4.5, 0.12], color=_FAINT, lw=1, ls=":")
    _say(
        axes,
        -0.1,
        5.15,
        "phone, straight above, at least 40 cm away,\nnever moved, exposure and focus locked",
        ha="center",
    )


def _lamp(axes: object) -> None:
    radius = 4.2
    axes.add_patch(Arc((0, 0), 2 * radius, 2 * radius, theta1=3, theta2=78, color=_FAINT, lw=1, ls="--"))
    for elevation in _ELEVATIONS:
        x, y = radius * cos(radians(elevation)), radius * sin(radians(elevation))
        axes.add_patch(Circle((x, y), 0.1, facecolor="white", edgecolor=_LIGHT, lw=1.5))
        axes.text(1.09 * x, 1.09 * y, f"{elevation}°", color=_LIGHT, fontsize=10, ha="center", va="center")
    x, y = radius * cos(radians(_SHOWN)), radius * sin(radians(_SHOWN))
    axes.add_patch(Circle((x, y), 0.16, color=_LIGHT))
    axes.plot([0, x], [0.1, y], color=_INK, lw=1.3)
    axes.add_patch(Arc((0, 0.05), 2.6, 2.6, theta1=0, theta2=_SHOWN, color=_INK, lw=1.3))
    _say(axes, 1.5, 0.5, f"{_SHOWN}°, read from\na protractor", ha="left")
    _say(axes, 1.35, 2.35, "string keeps\nthe distance", ha="center")
    _say(axes, 4.45, 3.15, "one small lamp,\nthe only light in the room", ha="left")
