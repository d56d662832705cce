"""Tables: error against bytes and against time per lookup (Mallett & Yuksel 2016, figures 3 and 6)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..accuracy import DirectionPairs, direction_pairs
from ..atlas import AtlasLayout
from ..bspline_fit import fit_coefficients
from ..grid_search import choose_grid
from ..half_grid import HalfGrid
from ..source import Array, BrdfSource
from ..storage import Storage
from ..table import BrdfTable, Filter, Grid, TreatedSource, pad_slices, tabulate
from ..table_storage import store_table
from .chart import Chart, Point
from .journal import Journal
from .page import Section, Table

KINDS = (
    ("normal", "identity"),
    ("normal", "uniform"),
    ("normal", "bezier"),
    ("normal", "fitted"),
    ("half", "uniform"),
    ("half", "squared"),
    ("half", "fitted"),
)
RESOLUTIONS = (16, 24, 32, 48, 64, 96, 128)
QUICK_RESOLUTIONS = (16, 32, 64)
_FILTERS: tuple[Filter, ...] = ("nearest", "trilinear", "bspline")
_STORAGES = (Storage.FLOAT32, Storage.HALF, Storage.RGBE, Storage.LOG)
# The shapes of a grid are chosen at one resolution: they hardly change with it, and a choice takes seconds.
_CHOSEN_AT = 48
_PAIRS = 16384
_TIMED = 1 << 15


@dataclass(frozen=True)
class Setting:
    """One way of tabulating, and what was measured for it."""

    basis: str
    parameterization: str
    resolution: int
    filter: str
    storage: str
    bytes: int
    rms: float
    relative: float
    lookup_ns: float

    @property
    def label(self) -> str:
        """All that the series' name leaves open."""
        return f"N {self.resolution}, {self.filter}, {self.storage}"


def measure_tables(
    source: BrdfSource, journal: Journal, quick: bool, progress: Callable[[float], None]
) -> list[Setting]:
    """All settings for one material; the error is at directions no table holds."""
    treated = TreatedSource(source)
    pairs = direction_pairs(_PAIRS)
    truth = treated.evaluate(pairs.wi, pairs.wo)
    resolutions = QUICK_RESOLUTIONS if quick else RESOLUTIONS
    found: list[Setting] = []
    for k, (basis, kind) in enumerate(KINDS):
        chosen: Grid | None = None
        for j, n in enumerate(resolutions):
            progress((k + j / len(resolutions)) / len(KINDS))
            key = f"tables {source.name} {basis} {kind} {n}"
            if key not in journal.found and chosen is None:
                chosen = choose_grid(treated, _CHOSEN_AT, (basis,), kind).grid  # type: ignore[arg-type]
            rows = journal.measure(key, partial(_measured, treated, chosen, n, pairs, truth))
            found += [Setting(basis, kind, n, **row) for row in rows]
    return found


def _resized(grid: Grid, n: int) -> Grid:
    if isinstance(grid, HalfGrid):
        n_d, n_h, n_phi = (max(4, round(size * n / _CHOSEN_AT)) for size in grid.sizes)
        return replace(grid, sizes=(n_d, n_h, n_phi))
    return replace(grid, n=n)


def _measured(
    source: TreatedSource, chosen: Grid | None, n: int, pairs: DirectionPairs, truth: Array
) -> list[dict[str, Any]]:
    assert chosen is not None
    grid = _resized(chosen, n)
    table = tabulate(source, grid)
    width, height = AtlasLayout(grid.shape).size
    rows = []
    for values, filter, storage in _variants(table):
        stored = store_table(BrdfTable(grid, values), pad_slices(values), storage, filter, pairs, truth).table
        difference = stored.evaluate(pairs.wi, pairs.wo, filter) - truth
        rows.append(
            {
                "filter": filter,
                "storage": str(storage),
                "bytes": width * height * storage.file_bytes(3),
                "rms": pairs.rms(difference),
                "relative": pairs.relative_error(difference, truth),
                "lookup_ns": _lookup_ns(stored, pairs, filter),
            }
        )
    return rows


def _variants(table: BrdfTable) -> Iterator[tuple[Array, Filter, Storage]]:
    """Every filter with the usual storage, and every storage with the usual filter."""
    for filter in _FILTERS:
        values = fit_coefficients(table.values) if filter == "bspline" else table.values
        for storage in _STORAGES if filter == "trilinear" else (Storage.HALF,):
            yield values, filter, storage


def _lookup_ns(table: BrdfTable, pairs: DirectionPairs, filter: Filter) -> float:
    """Nanoseconds of one lookup in numpy, the least of three runs."""
    repeats = -(-_TIMED // len(pairs.wi))
    wi, wo = np.tile(pairs.wi, (repeats, 1))[:_TIMED], np.tile(pairs.wo, (repeats, 1))[:_TIMED]
    table.evaluate(wi[:64], wo[:64], filter)  # the continuation over the poles is made once
    seconds = []
    for _ in range(3):
        started = time.perf_counter()
        table.evaluate(wi, wo, filter)
        seconds.append(time.perf_counter() - started)
    return min(seconds) / _TIMED * 1e9


def tables_section(name: str, settings: list[Setting]) -> Section:
    """Charts and table for one material."""
    usual = [s for s in settings if s.filter == "trilinear" and s.storage == Storage.HALF]
    section = Section(
        f"Tables: {name}",
        [
            "Error is the cosine-weighted RMS difference in 1/sr at directions that the table does not hold. A table "
            "of resolution N has N x N x 2N entries in the normal-vector basis (theta_o, theta_i, phi_delta) and as "
            "many in the half-vector basis (theta_d, theta_h, phi_d)."
        ],
    )
    section.charts = [
        _chart(f"{name}: error against memory", "bytes in the file, before compression", usual, lambda s: s.bytes),
        _chart(
            f"{name}: filters and storage", "bytes in the file, before compression", settings, lambda s: s.bytes, True
        ),
        _chart(f"{name}: error against time", "ns per lookup (numpy)", settings, lambda s: s.lookup_ns, True),
    ]
    head = ("basis", "parameterisation", "N", "filter", "storage", "bytes", "RMS 1/sr", "energy off", "ns/lookup")
    section.tables = [Table(head, [list(vars(s).values()) for s in sorted(settings, key=lambda s: s.rms)])]
    section.notes = ["Time per lookup is numpy's; in a render a texture tap costs little and the choice is of error."]
    return section


def _chart(
    title: str, cost: str, settings: list[Setting], of: Callable[[Setting], float], by_filter: bool = False
) -> Chart:
    series: dict[str, list[Point]] = {}
    for s in settings:
        name = f"{s.filter}, {s.storage}" if by_filter else f"{s.basis}, {s.parameterization}"
        label = f"{s.basis} {s.parameterization} N {s.resolution}" if by_filter else s.label
        series.setdefault(name, []).append(Point(of(s), s.rms, label))
    return Chart(title, cost, "RMS, 1/sr", series, joined=not by_filter)
