"""cos^n and its cheaper curves: error over n, tail, digits of the printed formula, and time in numpy, nodes and OSL."""

from __future__ import annotations

import math
import time
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
from measured_materials.addon.report.lobe_timing import BARE_POWER

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from csv_rows import write_rows
from measured_materials.addon.report.lobe_timing import measure_rendered
from measured_materials.addon.report.render_timing import Effort
from measured_materials.bake import xp_numpy
from measured_materials.bake.lobes.cosine_lobes import (
    COSINE_LOBES,
    coefficient_table,
    cosine_lobe,
    cubic_coefficients,
    cubic_lobe,
    tabulated_coefficients,
)
from numpy.typing import NDArray
from record import put

Array = NDArray[Any]
FAR = (1e3, 1e4, 1e6, 1e8)
# Bands of the tail's value, and the largest error that Romanyuk 2007 states for each.
BANDS = ((0.42, 0.5, 0.01), (0.37, 0.42, 0.03), (0.27, 0.37, 0.10), (0.0, 0.27, None))
RIVALS = COSINE_LOBES[1:]


def run(out: Path, quick: bool) -> None:
    """All parts; with --quick fewer exponents and shorter renders."""
    near = np.unique(np.round(np.geomspace(1, 256, 24))) if quick else np.arange(1.0, 257.0)
    rows = [_errors(float(n)) for n in (*near, *FAR)]
    _write(out / "lobes_error.csv", rows)
    _show_errors(rows)
    _show_bands(near)
    _show_bare(near)
    digits = [_digits(float(n)) for n in (10, 100, 1e3, 1e4, 1e5, 1e6, 1e8)]
    _write(out / "lobes_digits.csv", digits)
    _show_digits(digits)
    _show_table()
    times = _times(quick)
    _write(out / "lobes_time.csv", times)
    _show_times(times)
    _plot(out / "lobes.png", rows, times)


def _half_width(n: float) -> float:
    return -math.expm1(-math.log(2) / n)


def _exact(u: Array, n: float) -> Array:
    with np.errstate(divide="ignore"):
        return np.exp(n * np.log1p(-np.minimum(u, 1)))


def _value(name: str, u: Array, n: float) -> Array:
    return np.asarray(cosine_lobe(xp_numpy, name, u, np.float64(n)))


def _errors(n: float) -> dict[str, Any]:
    """Largest errors of every lobe: relative down to the half value, absolute there and everywhere."""
    p = _half_width(n)
    core, whole = (
        np.linspace(0, p, 4001),
        np.concatenate([np.linspace(0, min(20 * p, 1), 8001), np.geomspace(p, 1, 4001)]),
    )
    row: dict[str, Any] = {"n": n}
    for name in RIVALS:
        off = np.abs(_value(name, core, n) - _exact(core, n))
        row[f"{name} relative"] = (off / _exact(core, n)).max()
        row[f"{name} core"] = off.max()
        row[f"{name} absolute"] = np.abs(_value(name, whole, n) - _exact(whole, n)).max()
    return row


def _show_errors(rows: list[dict[str, Any]]) -> None:
    print("largest error down to the half value, relative / absolute; then absolute over the whole lobe")
    print(f"{'n':>9s}" + "".join(f"{name:>19s}" for name in RIVALS) + "".join(f"{name:>10s}" for name in RIVALS))
    for row in rows:
        if row["n"] in (1, 2, 5, 8, 25, 100, 256, *FAR):
            core = "".join(f"{row[f'{r} relative']:10.3%}/{row[f'{r} core']:8.3%}" for r in RIVALS)
            print(f"{row['n']:9g}{core}" + "".join(f"{row[f'{r} absolute']:10.2%}" for r in RIVALS))
    near = [row for row in rows if row["n"] <= 256]
    for name in RIVALS:
        least = 1 if name == "cubic" else 4
        put(f"relative, {name}", max(row[f"{name} relative"] for row in near if row["n"] >= least))
        put(f"of the peak, {name}", max(row[f"{name} absolute"] for row in near))
    worst = max(near, key=lambda row: row["cubic relative"])
    ratios = [row["schlick relative"] / row["cubic relative"] for row in near if row["n"] >= 4]
    print(
        f"cubic, n in [1, 256]: {worst['cubic relative']:.3%} relative at n = {worst['n']:g}, "
        f"{max(row['cubic core'] for row in near):.3%} absolute; "
        f"Schlick's relative error is {min(ratios):.1f} to {max(ratios):.0f} times as large (n >= 4; "
        "at 1, 2 and 3 the cubic is cos^n)"
    )


def _show_bands(exponents: Array) -> None:
    print("tail of the cubic, n in [1, 256]: largest error, in bands of its value and in bands of cos^n")
    print(f"{'band':>12s}{'absolute':>10s}{'relative':>10s}{'absolute':>10s}{'relative':>10s}{'paper':>8s}")
    for low, high, stated in BANDS:
        worst = np.zeros(4)
        for n in exponents:
            p = _half_width(float(n))
            u = np.concatenate([np.linspace(p, min(30 * p, 1), 20001), np.geomspace(p, 1, 4001)])
            tail, exact = _value("cubic", u, float(n)), _exact(u, float(n))
            off = np.abs(tail - exact)
            for k, banded in enumerate((tail, exact)):
                inside = (banded >= low) & (banded < high) & (u < 1)
                worst[2 * k] = max(worst[2 * k], off[inside].max(initial=0))
                worst[2 * k + 1] = max(worst[2 * k + 1], (off / np.maximum(exact, 1e-300))[inside].max(initial=0))
        shown = "".join(f"{w:10.2%}" if w < 100 else f"{'> 100':>10s}" for w in worst)
        print(f"{low:5.2f}..{high:.2f} {shown}{f'{stated:.0%}' if stated else 'none':>8s}")


def _show_bare(exponents: Array) -> None:
    """What the cubic does below the half value without its tail."""
    u = np.linspace(0, 1, 20001)
    lowest, highest = (0.0, 0.0), (0.0, 0.0)
    for n in (*np.linspace(1, 4, 301), *exponents):
        p, g, a = cubic_coefficients(xp_numpy, np.float64(n))
        bare = (1 - u) * (1 - u / p * (g + a * (1 - u / p)))
        lowest, highest = min(lowest, (bare.min(), n)), max(highest, (bare.max(), n))
    print(
        f"the cubic without its tail, n in [1, 256]: lowest {lowest[0]:.2g} (n = {lowest[1]:.3g}), "
        f"highest {highest[0]:.3g} times the peak (n = {highest[1]:.3g})"
    )


def _expanded(u: Array, n: float, dtype: Any) -> Array:
    """The cubic as printed, a x^3 + b x^2 + c x in x = cos, computed in one type throughout; without the tail."""
    one, two, half, m = (dtype(k) for k in (1, 2, 0.5, n))
    q = half ** (one / m)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        a = half * (one - two * q + two * q * q + m * q - m) / (q * q * (q * q - two * q + one))
        b = (half - q) / (q * q - q) - a * (q + one)
        c = one - a - b
        x = one - u.astype(dtype)
        return ((a * x + b) * x + c) * x


def _digits(n: float) -> dict[str, Any]:
    """Error in float32 of the printed form and of the stable one against the latter in float64."""
    u = np.linspace(0, _half_width(n) * (1 - 1e-6), 2001).astype(np.float32)
    truth = _value("cubic", u.astype(float), n)
    printed = np.abs(_expanded(u, n, np.float32) - truth).max()
    stable = np.abs(cosine_lobe(xp_numpy, "cubic", u, np.full(1, n, np.float32)) - truth).max()
    saved = math.log10(min(printed, 1.0) / stable) if np.isfinite(printed) else -math.log10(stable)
    return {"n": n, "printed": float(printed), "stable": float(stable), "digits saved": saved}


def _show_digits(rows: list[dict[str, Any]]) -> None:
    print("the cubic in float32, largest error of a peak of 1: as printed, and about the peak (bake.lobes)")
    for row in rows:
        saved = f"{row['digits saved']:4.1f} digits saved"
        print(f"{row['n']:9g}  printed {row['printed']:9.2g}  stable {row['stable']:8.2g}  {saved}")


def _show_table() -> None:
    """Tables of coefficients: over whole n, as the paper advises, and over 1 / n."""
    n = np.concatenate([np.linspace(1, 256, 2551), FAR])
    share = np.linspace(0, 1, 101)[:, None]
    u = share * -np.expm1(-math.log(2) / n)
    truth = cubic_lobe(xp_numpy, u, n, cubic_coefficients(xp_numpy, n))
    whole = np.arange(1.0, 257.0)
    rows = [np.interp(n, whole, k) for k in cubic_coefficients(xp_numpy, whole)]
    found = cubic_lobe(xp_numpy, u, n, (rows[0], rows[1], rows[2]))
    near = n <= 256
    print(
        f"table of 256 rows over n: error {np.abs(found - truth)[:, near].max():.1e} between whole n, none beyond 256"
    )
    for size in (16, 64, 256):
        found = cubic_lobe(xp_numpy, u, n, tabulated_coefficients(coefficient_table(size), n))
        print(f"table of {size:3d} rows over 1 / n: error {np.abs(found - truth).max():.1e} up to 1e8")


def _times(quick: bool) -> list[dict[str, Any]]:
    """ns per evaluation: numpy in float32, nodes and OSL."""
    rng = np.random.default_rng(0)
    u = (rng.random(1_000_000) ** 2 * 0.2).astype(np.float32)
    exponents = {"one n": np.full(1, 60, np.float32), "n varies": (1 + 100 * rng.random(len(u))).astype(np.float32)}
    rows = [{"lobe": name} for name in COSINE_LOBES]
    for row in rows:
        for label, n in exponents.items():
            evaluate = partial(cosine_lobe, xp_numpy, row["lobe"], u, n)
            seconds = [_seconds(evaluate) for _ in range(3 if quick else 7)]
            row[f"numpy, {label}"] = min(seconds) / len(u) * 1e9
    plain = [_seconds(lambda: np.power(1 - u, exponents["one n"])) for _ in range(5)]
    put("ns, numpy, power alone", min(plain) / len(u) * 1e9)
    print(f"numpy's power alone, its base rounded: {min(plain) / len(u) * 1e9:.1f} ns")
    rendered = measure_rendered(COSINE_LOBES, Effort(96, 16, 2) if quick else Effort(240, 16, 5))
    if rendered.missing:
        print(f"OSL: {rendered.missing}")
    for column, found in rendered.ns.items():
        put(f"ns, {column}, power alone", found[BARE_POWER])
        print(f"{column}: the power node or function alone, its base rounded: {found[BARE_POWER]:.1f} ns")
        for row in rows:
            row[column] = found[row["lobe"]]
    return rows


def _seconds(function: Any) -> float:
    started = time.process_time()
    function()
    return time.process_time() - started


def _show_times(rows: list[dict[str, Any]]) -> None:
    columns = [c for c in rows[0] if c != "lobe"]
    print("ns of processor per evaluation; of nodes and OSL beyond a material without the lobe")
    print(f"{'':9s}" + "".join(f"{c:>18s}" for c in columns))
    for row in rows:
        print(f"{row['lobe']:9s}" + "".join(f"{row[c]:18.1f}" for c in columns))
    power = rows[0]
    for row in rows:
        for column in columns:
            put(f"ns, {column}, {row['lobe']}", row[column])
            put(f"time over cos^n, {column}, {row['lobe']}", row[column] / power[column])
    for column in columns:
        cheaper = [r["lobe"] for r in rows[1:] if r[column] < 0.8 * power[column]]
        words = f"cheaper than cos^n: {', '.join(cheaper)}" if cheaper else "cos^n is as cheap as any"
        print(f"  {column}: {words}")


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    write_rows(path, rows)


def _plot(path: Path, rows: list[dict[str, Any]], times: list[dict[str, Any]]) -> None:
    figure, (shape, error, cost) = plt.subplots(1, 3, figsize=(15, 4.5), dpi=110)
    n = 100.0
    angle = np.radians(np.linspace(0, 30, 1200))
    u = 2 * np.sin(angle / 2) ** 2
    for name in COSINE_LOBES:
        shape.plot(np.degrees(angle), _value(name, u, n), label="cos^n" if name == "power" else name)
    bare = _expanded(u, n, np.float64)
    shape.plot(np.degrees(angle), bare, "k:", label="cubic without its tail")
    shape.set(xlabel="degrees", title=f"n = {n:g}", ylim=(-0.05, 1.6))
    shape.axhline(0, color="k", linewidth=0.5)
    for name in RIVALS:
        off = [max(r[f"{name} relative"], 1e-5) for r in rows]
        error.loglog([r["n"] for r in rows], off, color=f"C{COSINE_LOBES.index(name)}", label=name)
    error.set(xlabel="n", title="largest relative error down to the half value")
    for name in RIVALS:
        worst = max(r[f"{name} relative"] for r in rows if 4 <= r["n"] <= 256)
        row = next(r for r in times if r["lobe"] == name)
        for column, marker in zip([c for c in row if c != "lobe"], "os^vDP"):
            cost.loglog(max(row[column], 0.5), worst, marker, color=f"C{COSINE_LOBES.index(name)}")
            cost.axvline(times[0][column], color="0.8", linewidth=0.8, zorder=0)
    for column, marker in zip([c for c in times[0] if c != "lobe"], "os^vDP"):
        cost.plot([], [], f"k{marker}", label=column)
    cost.set(xlabel="ns of processor per evaluation; lines: cos^n", title="error, 4 <= n <= 256, against time")
    for axes in (shape, error, cost):
        axes.grid(True, alpha=0.25)
        axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path)
    print(f"plot {path}")
