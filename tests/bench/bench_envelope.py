"""What native closures carry of measured materials: by budget, by number, and what further closures would add."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from csv_rows import write_rows
from materials import merl_file, rgl_files
from measured_materials.bake.directions import normalize
from measured_materials.bake.envelope import (
    BASIS,
    EnvelopeFit,
    EnvelopeSettings,
    ResidualSource,
    closure_values,
    fit_envelope,
    reconstruction_errors,
)
from measured_materials.bake.envelope.linear_program import solve
from measured_materials.bake.envelope.views import gauss_chords, sample_views
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.table import tabulate
from measured_materials.bake.tables.treated_source import TreatedSource

MERL = (
    "pink-felt", "white-fabric2", "beige-fabric", "green-latex", "pvc", "specular-black-phenolic",
    "blue-metallic-paint2", "alum-bronze", "nickel", "chrome",
)  # fmt: skip
BUDGETS = (0.0, 1e-3, 1e-2)
# Of the first trial at a budget of 0.1 %, MERL's at 0, with up to twenty closures.
TRIAL = {
    "pink-felt": 0.90, "white-fabric2": 0.90, "beige-fabric": 0.90, "alum-bronze": 0.60, "chrome": 0.05,
    "irid_flake_paint1_rgb": 0.36, "satin_rosaline_rgb": 0.74, "paper_white_rgb": 0.86,
}  # fmt: skip
GRID = NormalVectorGrid(64, "bezier", 0.5, 0.5)


def run(out: Path, quick: bool) -> None:
    """One line per material, and a CSV."""
    print("share of the energy that E carries; 3 closures at budgets of 0, 0.1 and 1 %, then 1 and 2 at 0.1 %")
    print(
        "RMS: of E + interp(R) over that of interp(f), trilinear tables of 64 x 64 x 128; s: of processor time, a fit"
    )
    heads = ("0", "0.1 %", "1 %", "1", "2", "basis", "trial", "over", "worst", "RMS", "s")
    print(f"{'':24s}" + "".join(f"{head:>8s}" for head in heads) + "  closures")
    rows = []
    for source in _sources(quick):
        rows.append(_row(source))
        _print_row(rows[-1])
    write_rows(out / "envelope.csv", rows)
    _further_closures(quick)


def _sources(quick: bool) -> Iterator[BrdfSource]:
    with tempfile.TemporaryDirectory() as folder:
        for name in (MERL[0], MERL[-1]) if quick else MERL:
            yield read_source(merl_file(name, Path(folder)), Reading(merl="nodes"))
    for file in rgl_files()[:: 6 if quick else 1]:
        yield read_source(file)


def _row(source: BrdfSource) -> dict[str, Any]:
    fits, seconds = {}, 0.0
    for budget in BUDGETS:
        started = time.process_time()
        fits[budget] = fit_envelope(source, EnvelopeSettings(budget=budget, enough=1.0))
        if budget == 1e-3:
            seconds = time.process_time() - started
    fewer = [fit_envelope(source, EnvelopeSettings(most=most, enough=1.0)) for most in (1, 2)]
    fit = fits[1e-3]
    whole, rest = tabulate(TreatedSource(source), GRID), tabulate(ResidualSource(source, fit), GRID)
    errors = reconstruction_errors(source, fit, rest, whole, direction_pairs(16384))
    return {
        "material": source.name,
        **{f"share at {budget:g}": _share(fit) for budget, fit in fits.items()},
        **{f"share of {most}": _share(few) for most, few in zip((1, 2), fewer)},
        "basis": fit.measured["reach"],
        "trial": TRIAL.get(source.name, float("nan")),
        "overshoot": fit.measured["overshoot"],
        "largest overshoot": fit.measured["overshoot_largest"],
        "rms ratio": errors["rms_ratio"],
        "seconds": seconds,
        "closures": " ".join(f"{lobe.name} {lobe.p1:g}" if lobe.p1 else lobe.name for lobe in fit.closures),
    }


def _share(fit: EnvelopeFit) -> float:
    return float(fit.measured["share"])


def _print_row(row: dict[str, Any]) -> None:
    cells = []
    for key, value in row.items():
        if key == "closures" or key == "material":
            continue
        percent = "overshoot" in key
        text = f"{100 * value:.3f}%" if percent else f"{value:.1f}" if key == "seconds" else f"{value:.3f}"
        cells.append(f"{'-' if value != value else text:>8s}")
    print(f"{row['material'][:23]:24s}" + "".join(cells) + f"  {row['closures']}", flush=True)


# --- closures that are not in the basis -----------------------------------------------------------------


def _tilted(alpha: float, tilt: float) -> Callable[[Array, Array], Array]:
    """GGX f cos about a normal tilted toward the viewer (away if negative), cut at the surface's own horizon."""

    def value(wi: Array, wo: Array) -> Array:
        wi, wo = np.broadcast_arrays(wi, wo)
        # The share of the view direction, or of its part in the plane.
        toward = wo if tilt > 0 else wo * [1.0, 1.0, 0.0]
        normal = normalize((1 - max(tilt, 0)) * np.array([0.0, 0.0, 1.0]) + tilt * toward)
        # wo lies in the x-z plane, and so does the normal: turn both about y.
        x = normal[..., [2, 1, 0]] * [1.0, 0.0, -1.0]
        turned = [np.stack([(w * x).sum(-1), w[..., 1], (w * normal).sum(-1)], -1) for w in (wi, wo)]
        seen = (turned[0][..., 2] > 0) & (turned[1][..., 2] > 0) & (wi[..., 2] > 0)
        return np.where(seen, Lobe("ggx", alpha).value(*turned) * turned[0][..., 2], 0)

    return value


FURTHER: dict[str, list[Callable[[Array, Array], Array]]] = {
    "Oren-Nayar": [lambda wi, wo, r=r: closure_values([Lobe("oren_nayar", r)], wi, wo)[..., 0] for r in (0.3, 1.0)],
    "toward": [_tilted(alpha, tilt) for tilt in (0.25, 0.5, 1.0) for alpha in (0.35, 0.6, 1.0)],
    "away": [_tilted(alpha, tilt) for tilt in (-0.1, -0.25) for alpha in (0.1, 0.2, 0.35, 0.6)],
}


def _further_closures(quick: bool) -> None:
    print("\nshare that the whole basis carries at twelve viewers, and what further closures add to it")
    print(f"{'':24s}{'budget':>8s}{'basis':>8s}" + "".join(f"{name:>12s}" for name in FURTHER))
    for source in _sources(quick):
        chords, weights = gauss_chords(12)
        views = sample_views(TreatedSource(source), chords, 28, 16)
        values = views.values.mean(-1)
        energy = (views.areas * values).sum(-1)
        importance = weights * energy / (weights * energy).sum()
        basis = closure_values(BASIS, views.wi, views.wo)
        for budget in BUDGETS[:2]:
            shares = []
            for functions in ([], *FURTHER.values()):
                columns = [basis, *(f(views.wi, views.wo)[..., None] for f in functions)]
                parts = np.concatenate(columns, -1) / energy[:, None, None]
                gains = np.einsum("nm,nmk->nk", views.areas, parts)
                found = solve(parts, values / energy[:, None], views.areas, gains, budget, 10.0, 1e-5)
                shares.append(float(found.objective @ importance))
            added = "".join(f"{share - shares[0]:12.3f}" for share in shares[1:])
            print(f"{source.name[:23]:24s}{budget:8g}{shares[0]:8.3f}{added}", flush=True)
