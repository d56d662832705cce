"""Matplotlib where it is installed, one look for all figures, and files that are there whole or not at all."""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...bake.atomic_write import replacing_file
from ...bake.errors import BakeError
from ...bake.images.png import png_about, with_about

# Okabe & Ito's palette, distinct for colour-blind readers too, from dark to light.
COLOURS = ("#000000", "#0072b2", "#009e73", "#d55e00", "#cc79a7", "#e69f00")
RED, GREEN, BLUE = "#c23b22", "#2e8b57", "#1f5fa8"
_DPI = 220
_STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "axes.linewidth": 0.7,
    "lines.linewidth": 1.3,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
}


def need_matplotlib(asked: str) -> None:
    """Raise BakeError where there is nothing to draw with."""
    try:
        importlib.import_module("matplotlib.figure")
    except ImportError as error:
        remedy = "install it (pip install matplotlib), or leave the plot out"
        raise BakeError(asked, "needs matplotlib, which this Python does not have", remedy) from error


def styled() -> Any:
    """A context in which figures are made."""
    import matplotlib

    return matplotlib.rc_context(_STYLE)


def new_figure(width: float, height: float) -> Any:
    """An empty figure of so many inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def refuse_others(files: Sequence[Path], about: str) -> None:
    """Raise BakeError where one of these is there already and is no figure that `save_png` wrote about the same."""
    for file in files:
        try:
            other = os.path.lexists(file) and (not file.is_file() or png_about(file) != about)
        except (OSError, ValueError) as error:
            raise BakeError(file, f"cannot be read ({error})", "choose another folder") from error
        if other:
            cause = "is there already, is no known figure of this source, and is not replaced"
            raise BakeError(file, cause, "give another folder, or --replace to replace it")


def save_png(figure: Any, path: Path, dpi: int = _DPI, about: str = "") -> Path:
    """Write a figure, making its folder; `about` is kept in it, for `refuse_others`. Raises BakeError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing_file(path) as temporary:
            figure.savefig(temporary, format="png", dpi=dpi)
            if about:
                temporary.write_bytes(with_about(temporary.read_bytes(), about))
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        cause = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise BakeError(path, cause, "choose another place for it") from error
    return path
