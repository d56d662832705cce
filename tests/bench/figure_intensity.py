"""After figure 3 of Mallett & Yuksel 2016: total intensity of every table of every material, and what it is worth.

The paper takes the parameterisation whose table sums to the most: it has the most samples where the material is bright.
Sums of tables with other sizes are compared as means over the entries, divided by the mean of the BRDF over uniform
theta_o, theta_i and phi_delta, by quadrature: what a converged uniform table in the normal-vector basis has, hence 1.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from csv_rows import write_rows
from materials import all_sources
from measured_materials.bake.directions import spherical
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.search.alpha_search import search_alpha, with_alpha
from measured_materials.bake.tables.search.grid_search import choose_grid
from measured_materials.bake.tables.table import tabulate
from measured_materials.bake.tables.treated_source import TreatedSource
from rich.progress import track

N = 64
_PLAIN = ("identity", "uniform", "squared")
KINDS = (*_PLAIN, "Bezier of most intensity", "Bezier of least error", "fitted")
_ALPHAS = (0.0, 0.25, 0.5, 0.75, 1.0)
_WARP = 4.0  # of the half vector, as in `accuracy.direction_pairs`
_COLORS = ("tab:gray", "tab:blue", "tab:purple", "tab:orange", "tab:red", "tab:green")


def run(out: Path, quick: bool) -> None:
    """Print, write figure-3.csv and plot figure-3.png; --quick takes every tenth material and coarser tables."""
    n = N // 2 if quick else N
    rows = []
    for name, source in track(all_sources(quick), "figure 3", total=10 if quick else 82):
        rows += _measured(name, TreatedSource(source), n)
    write_rows(out / "figure-3.csv", rows)
    _print(rows, n)
    _plot(rows, out / "figure-3.png", n)


def _measured(name: str, source: TreatedSource, n: int) -> Iterator[dict[str, Any]]:
    """One row per table."""
    pairs = direction_pairs(32768)
    truth = source.evaluate(pairs.wi, pairs.wo)
    mean = mean_over_angles(source)
    energy = float((pairs.weight * truth.mean(-1) * pairs.cosines[:, 0]).mean())
    for basis, kind, grid in _grids(source, n):
        table = tabulate(source, grid)
        yield {
            "material": name,
            "basis": basis,
            "table": kind,
            "shape": " ".join(map(str, grid.shape)),
            "total intensity": table.total_intensity,
            "intensity": table.total_intensity / table.values.size / mean,
            "rms": pairs.rms(table.evaluate(pairs.wi, pairs.wo) - truth),
            "peakedness": pairs.rms(truth) / max(energy, 1e-30),
        }


def mean_over_angles(source: TreatedSource, count: int = 1 << 17) -> float:
    """Mean of the BRDF, channels averaged, over uniform (theta_o, theta_i, phi_delta).

    Half of the directions crowd round the mirror direction, and the balance heuristic weights both.
    """
    ratio = 1.0
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / 5)
    u = (0.5 + np.arange(1, count + 1)[:, None] * ratio ** -np.arange(1.0, 5)) % 1
    wo = spherical(u[:, 0] * np.pi / 2, 0.0)
    even = spherical(u[:, 1] * np.pi / 2, 2 * np.pi * u[:, 2])
    half = spherical(2 * np.arcsin(np.sqrt(u[:, 1] ** _WARP / 2)), 2 * np.pi * u[:, 2])
    mirrored = 2 * (wo * half).sum(-1, keepdims=True) * half - wo
    wi = np.where(u[:, 3:] < 0.5, even, mirrored)
    half = wi + wo
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    m = np.maximum(((half - [0, 0, 1]) ** 2).sum(-1) / 2, 1e-30)
    density = 1 / (2 * np.pi * _WARP * m ** (1 - 1 / _WARP)) / (4 * np.maximum((wo * half).sum(-1), 1e-12))
    # Of (theta_i, phi): solid angle has sin theta_i more; the even half has 1 / pi^2.
    sine = np.hypot(wi[:, 0], wi[:, 1])
    weight = 1 / (0.5 + 0.5 * np.pi**2 * sine * density)
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    values = source.evaluate(wi[above], wo[above]).mean(-1)
    return float((weight[above] * values).sum() / count)


def _grids(source: TreatedSource, n: int) -> Iterator[tuple[str, str, Grid]]:
    """(basis, table, grid) of all tables of about equal bytes."""
    search = search_alpha(source, n, direction_pairs(8192, offset=0.25))
    bezier = NormalVectorGrid(n, "bezier")
    for kind in _PLAIN:
        yield "normal", kind, NormalVectorGrid(n, kind)  # type: ignore[arg-type]
    yield "normal", "Bezier of most intensity", with_alpha(bezier, search.by_intensity)
    yield "normal", "Bezier of least error", with_alpha(bezier, search.by_error)
    yield "normal", "fitted", choose_grid(source, n, ("normal",), "fitted").grid
    for kind in _PLAIN:
        yield "half", kind, choose_grid(source, n, ("half",), kind).grid  # type: ignore[arg-type]
    by_error = choose_grid(source, n, ("half",), "bezier").grid
    assert isinstance(by_error, HalfVectorGrid)
    yield "half", "Bezier of most intensity", replace(by_error, alphas=_brightest(source, by_error))
    yield "half", "Bezier of least error", by_error
    yield "half", "fitted", choose_grid(source, n, ("half",), "fitted").grid


def _brightest(source: TreatedSource, grid: HalfVectorGrid) -> tuple[float, float, float]:
    """Shapes of the largest intensity, on a grid of a quarter of the resolution."""
    n_d, n_h, n_phi = (max(4, size // 4) for size in grid.sizes)
    coarse = replace(grid, sizes=(n_d, n_h, n_phi))

    def intensity(alphas: tuple[float, ...]) -> float:
        return tabulate(source, replace(coarse, alphas=alphas)).total_intensity  # type: ignore[arg-type]

    return max(itertools.product(_ALPHAS, repeat=3), key=intensity)  # type: ignore[return-value]


def _print(rows: list[dict[str, Any]], n: int) -> None:
    names = list(dict.fromkeys(row["material"] for row in rows))
    print(
        f"\nFigure 3, tables of the bytes of {n} x {n} x {2 * n}: mean entry over the mean of the BRDF; RMS over least"
    )
    print(f"{'medians of ' + str(len(names)) + ' materials':28s}{'normal':>12s}{'RMS':>9s}{'half':>12s}{'RMS':>9s}")
    least = {name: min(row["rms"] for row in rows if row["material"] == name) or 1e-30 for name in names}
    for kind in KINDS:
        words = ""
        for basis in ("normal", "half"):
            mine = [row for row in rows if (row["basis"], row["table"]) == (basis, kind)]
            loss = np.median([row["rms"] / least[row["material"]] for row in mine])
            words += f"{np.median([row['intensity'] for row in mine]):12.3g}{loss:9.3g}"
        print(f"{kind:28s}{words}")
    print("What the two criteria choose: the table of least error, and how much the choice of the other errs (median)")
    for title, bases, kinds in (
        ("Bezier shape, normal basis", ("normal",), KINDS[3:5]),
        ("Bezier shape, half basis", ("half",), KINDS[3:5]),
        ("parameterisation, normal basis", ("normal",), KINDS),
        ("parameterisation, half basis", ("half",), KINDS),
        ("both", ("normal", "half"), KINDS),
    ):
        found, loss = [], []
        for name in names:
            mine = [r for r in rows if r["material"] == name and r["basis"] in bases and r["table"] in kinds]
            best = min(row["rms"] for row in mine)
            chosen = max(mine, key=lambda row: row["intensity"])["rms"]
            found.append(chosen <= 1.005 * best)
            loss.append(chosen / max(best, 1e-30))
        print(f"  {title:32s} most intensity is least error for {sum(found)} of {len(found)}, x {np.median(loss):.3g}")


def _plot(rows: list[dict[str, Any]], path: Path, n: int) -> None:
    """Materials from matte to glossy: intensity above, error below, one column per basis."""
    order = sorted({row["material"]: row["peakedness"] for row in rows}.items(), key=lambda item: item[1])
    place = {name: k for k, (name, _) in enumerate(order)}
    figure, axes = plt.subplots(2, 2, figsize=(15, 9), sharex=True, sharey="row", constrained_layout=True)
    for column, basis in enumerate(("normal", "half")):
        for kind, color in zip(KINDS, _COLORS):
            mine = sorted(
                (r for r in rows if (r["basis"], r["table"]) == (basis, kind)), key=lambda r: place[r["material"]]
            )
            places = [place[row["material"]] for row in mine]
            style: dict[str, Any] = {"color": color, "marker": "o", "markersize": 3, "linewidth": 0.8, "label": kind}
            for axis, key in zip(axes[:, column], ("intensity", "rms")):
                axis.semilogy(places, [max(row[key], 1e-9) for row in mine], **style)
        axes[0, column].set_title(f"{basis}-vector basis, the bytes of {n} x {n} x {2 * n}")
        axes[1, column].set_xticks(range(len(order)), [name for name, _ in order], rotation=90, fontsize=6)
    axes[0, 0].set_ylabel("mean entry of the table / mean of the BRDF")
    axes[1, 0].set_ylabel("cosine-weighted RMS, 1/sr")
    axes[0, 0].legend(fontsize=8)
    for axis in axes.flat:
        axis.grid(True, alpha=0.25)
        axis.margins(x=0.01)
    figure.savefig(path, dpi=80)
    plt.close(figure)
    print(f"plot {path}")
