"""Tables: error against bytes and against time per lookup (Mallett & Yuksel 2016, figures 3 and 6)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np

from ..images.storage import TABLE_STORAGES, Storage
from ..source import BrdfSource
from ..tables.accuracy import DirectionPairs
from ..tables.table import FILTERS, Filter
from .chart import SAME_TIME, Chart, Point
from .journal import Journal
from .page import Section, Table
from .tabulation import Kind, Lookup, Tabulation, resized

USUAL_FILTER, USUAL_STORAGE = "trilinear", Storage.HALF
_TIMED = 1 << 14


@dataclass(frozen=True)
class TableSizes:
    """Resolutions, and whether every filter meets every storage or each only the usual one of the other."""

    resolutions: tuple[int, ...]
    crossed: bool


FULL = TableSizes((16, 24, 32, 48, 64, 96, 128), True)
QUICK = TableSizes((16, 32, 64), False)
# Time hardly depends on resolution.
FULL_LOOKUPS, QUICK_LOOKUPS = TableSizes((32, 128), False), TableSizes((64,), False)


@dataclass(frozen=True)
class Setting:
    """One way of tabulating, and what was measured for it.

    bytes : of the table in the file, before its lossless compression
    rms, relative : cosine-weighted, in 1/sr and as a share of the reflected energy
    lookup_ns, render_ns : of one lookup in numpy, and in rendered nodes where that was measured
    """

    basis: str
    parameterization: str
    resolution: int
    filter: str
    storage: str
    bytes: int
    rms: float
    relative: float
    lookup_ns: float
    render_ns: float | None = None

    @property
    def key(self) -> LookupKey:
        """Key of everything that the setting's time depends on."""
        return self.basis, self.parameterization, self.resolution, self.filter, self.storage


LookupKey = tuple[str, str, int, str, str]


@dataclass(frozen=True)
class Measured:
    """Measurements of all settings of one material, and the kind that "auto" takes."""

    settings: list[Setting]
    auto: Kind

    def timed(self, rendered: Mapping[LookupKey, float]) -> Measured:
        """Copy with the times in rendered nodes."""
        settings = [replace(s, render_ns=rendered.get(s.key)) for s in self.settings]
        return replace(self, settings=settings)


def measure_tables(
    source: BrdfSource, journal: Journal, sizes: TableSizes, progress: Callable[[float], None]
) -> Measured:
    """Measure all settings for one material; the error is at directions no table holds."""
    made = Tabulation(source)
    found: list[Setting] = []
    ranked: dict[Kind, float] = {}
    for k, kind in enumerate(made.kinds):
        chosen = None
        if f"shape {source.name} {kind}" not in journal.found:
            chosen = made.chosen(kind)
        ranked[kind] = journal.measure(f"shape {source.name} {kind}", partial(_rms, chosen))
        for j, n in enumerate(sizes.resolutions):
            progress((k + j / len(sizes.resolutions)) / len(made.kinds))
            key = f"tables {source.name} {kind} {n}"
            if key not in journal.found and chosen is None:
                chosen = made.chosen(kind)
            rows = journal.measure(key, partial(_measured, made, chosen and chosen[0], n, sizes.crossed))
            found += [Setting(*kind, n, **row) for row in rows]
    return Measured(found, min(made.auto, key=ranked.__getitem__))


def _rms(chosen: tuple[Any, float] | None) -> float:
    assert chosen is not None
    return chosen[1]


def _measured(made: Tabulation, chosen: Any, n: int, crossed: bool) -> list[dict[str, Any]]:
    grid = resized(chosen, n)
    if not made.texels(grid):
        return []
    samples, rows = made.values(grid), []
    for filter, storages in variants(crossed):
        values = made.coefficients(grid, samples, filter)
        lookups = {storage: made.stored(grid, values, filter, storage) for storage in storages}
        # Only codes have to be decoded.
        timed = {storage is Storage.LOG: lookup for storage, lookup in lookups.items()}
        times = {codes: _lookup_ns(lookup, made.pairs) for codes, lookup in timed.items()}
        for storage, lookup in lookups.items():
            difference = lookup(made.pairs.wi, made.pairs.wo) - made.truth
            rows.append(
                {
                    "filter": filter,
                    "storage": str(storage),
                    "bytes": made.texels(grid) * storage.file_bytes(3),
                    "rms": made.pairs.rms(difference),
                    "relative": made.pairs.relative_error(difference, made.truth),
                    "lookup_ns": times[storage is Storage.LOG],
                }
            )
    return rows


def variants(crossed: bool) -> Iterator[tuple[Filter, Sequence[Storage]]]:
    """Every filter with every storage; or with the usual one, and every storage with the usual filter."""
    for filter in FILTERS:
        every = crossed or filter == USUAL_FILTER
        yield cast(Filter, filter), [Storage(s) for s in TABLE_STORAGES] if every else [USUAL_STORAGE]


def _lookup_ns(lookup: Lookup, pairs: DirectionPairs) -> float:
    """Nanoseconds of one lookup in numpy, the least of three runs; how its texels were stored is of no matter there."""
    wi, wo = (np.resize(w, (_TIMED, 3)) for w in (pairs.wi, pairs.wo))
    lookup(wi[:64], wo[:64])  # the continuation over the poles is made once
    seconds = []
    for _ in range(3):
        started = time.process_time()
        lookup(wi, wo)
        seconds.append(time.process_time() - started)
    return min(seconds) / _TIMED * 1e9


# --- report ---------------------------------------------------------------------------------------------


def tables_section(name: str, measured: Measured) -> Section:
    """Charts and table for one material."""
    settings = measured.settings
    four = settings[0].parameterization == "slopes" or settings[-1].parameterization == "slopes"
    usual = [s for s in settings if s.filter == USUAL_FILTER and s.storage == USUAL_STORAGE]
    rendered = [s for s in settings if s.render_ns is not None and s.storage == USUAL_STORAGE]
    auto = [s for s in settings if (s.basis, s.parameterization) == measured.auto]
    section = Section(f"Tables: {name}", [_SIZES[four], _AUTO.format(_kind_words(measured.auto))])
    section.charts = [
        Chart(f"{name}: bases and parameterisations ({USUAL_FILTER})", BYTES, RMS, _series(usual, _kind, _size)),
        Chart(f"{name}: filters and storage ({_kind_words(measured.auto)})", BYTES, RMS, _series(auto, _way, _size)),
        _times(f"{name}: time of a lookup in numpy ({USUAL_FILTER})", NUMPY, _series(usual, _kind, _numpy)),
    ]
    if rendered:
        series = _series(rendered, _basis_and_filter, lambda s: s.render_ns or 0.0, spacing=True)
        title = f"{name}: time of a lookup in rendered nodes"
        section.charts.append(_times(title, RENDERED, series))
    told = ("basis", "parameterisation", "N", "filter", "storage", "bytes", "RMS 1/sr", "energy off")
    head = (*told, "ns, numpy", "ns, rendered")
    section.tables = [Table(head, [list(vars(s).values()) for s in sorted(settings, key=lambda s: s.rms)])]
    section.notes = [
        "Times in nodes are of the lookup as materials use it: it draws one of the slices at random with the filter's "
        "weights instead of blending them. They differ little; in a render, choose by error and memory."
    ]
    return section


def _times(title: str, cost: str, series: dict[str, list[Point]]) -> Chart:
    return Chart(title, cost, RMS, series, joined=False, same=SAME_TIME)


BYTES, RMS = "bytes in the file, before compression", "RMS error, 1/sr"
NUMPY, RENDERED = "ns per lookup, numpy", "ns per lookup, processor time in Cycles"
_SIZES = {
    False: "How far a table is from the measurement it was made of: the cosine-weighted RMS difference, in 1/sr, at "
    "directions that the table does not hold. A table of resolution N has N x N x 2N entries in the normal-vector "
    "basis (theta_o, theta_i, phi_delta), and as many in the half-vector basis (theta_d, theta_h, phi_d).",
    True: "How far a table of an anisotropic material is from what it was made of: the cosine-weighted RMS difference, "
    "in 1/sr, at directions that the table does not hold. A table has four axes: at resolution N it has N entries "
    "along each slope of the half vector and N / 4 along each angle of the difference; in the normal-vector basis, as "
    "many in all.",
}
_AUTO = "A bake left to itself (auto) measures as here and takes: {}."
# In words, since "half" is a basis and a storage.
BASES = {"normal": "normal-vector", "half": "half-vector"}


def storage_words(storage: str) -> str:
    """A storage's name for readers."""
    return {"half": "half float", "byte": "bytes"}.get(storage, storage)


def _kind_words(kind: Kind) -> str:
    return f"{BASES[kind[0]]}, {kind[1]}"


def _kind(s: Setting) -> str:
    return f"{BASES[s.basis]}, {s.parameterization}"


def _way(s: Setting) -> str:
    return f"{s.filter}, {storage_words(s.storage)}"


def _basis_and_filter(s: Setting) -> str:
    return f"{BASES[s.basis]}, {s.filter}"


def _size(s: Setting) -> float:
    return float(s.bytes)


def _numpy(s: Setting) -> float:
    return s.lookup_ns


def _series(
    settings: Sequence[Setting],
    name: Callable[[Setting], str],
    cost: Callable[[Setting], float],
    *,
    spacing: bool = False,
) -> dict[str, list[Point]]:
    """Points by name; `spacing`, their parameterisation is stated as well, the name leaving it open."""
    series: dict[str, list[Point]] = {}
    for s in settings:
        label = f"{s.parameterization}, N {s.resolution}" if spacing else f"N {s.resolution}"
        series.setdefault(name(s), []).append(Point(cost(s), s.rms, label))
    return series
