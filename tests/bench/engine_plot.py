"""Plot of `bench engine`: noise and time against the residual's share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

_MARKERS = {"sky": ("o", "tab:blue"), "small lamp": ("^", "tab:red"), "sun and sky": ("s", "tab:orange")}
_MARKERS |= {"HDR world": ("D", "tab:green")}


def plot(
    path: Path,
    rows: Sequence[Any],
    goals: Sequence[tuple[float, float]],
    most_time: float,
    shown: tuple[str, str],
) -> None:
    """Noise of two variants, the second in outlines, and time of the first, with the lines they are to stay under.

    `goals` are the residual's share up to which each holds, and the multiple of Principled's noise.
    """
    figure, (noise, time) = plt.subplots(2, 1, figsize=(9, 8.5), dpi=110, sharex=True, height_ratios=(2, 1))
    variant, other = shown
    for light, (marker, colour) in _MARKERS.items():
        chosen = [row for row in rows if row.light == light and row.variant == variant]
        outlined = [row for row in rows if row.light == light and row.variant == other]
        if not chosen:
            continue
        style = {"marker": marker, "color": colour, "linestyle": "none"}
        noise.semilogy([r.residual for r in chosen], [r.noise for r in chosen], label=f"{variant}, {light}", **style)
        outline = {"fillstyle": "none", "alpha": 0.5, "markersize": 4}
        noise.semilogy([r.residual for r in outlined], [r.noise for r in outlined], **style, **outline)
        time.plot([r.residual for r in chosen], [r.time for r in chosen], **style)
    noise.plot([], [], "ko", fillstyle="none", alpha=0.5, markersize=4, label=other)
    most = max(row.residual for row in rows)
    low = 0.0
    for high, factor in goals:
        if low < most:
            noise.hlines(factor, low, min(high, 1.1 * most), "k", "--", linewidth=1)
            noise.text(low, factor * 1.06, f"goal: {factor:g}", fontsize=8)
        low = high
    time.axhline(most_time, color="k", linestyle="--", linewidth=1)
    noise.set_ylabel("noise at equal samples / Principled's")
    noise.set_title("Measured materials beside a Principled BSDF of about the same look")
    noise.legend(fontsize=8, loc="upper right")
    noise.grid(True, which="both", alpha=0.2)
    time.set_ylabel("time of a sample / Principled's")
    time.set_xlabel("share of the light that native closures leave to the mirror")
    time.set_ylim(0, None)
    time.grid(True, alpha=0.2)
    for name, share in {row.material: row.residual for row in rows}.items():
        time.text(share, 0.03, name, rotation=90, fontsize=7, ha="center", va="bottom", color="0.35")
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)
    print(f"plot {path}")
