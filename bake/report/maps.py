"""Shading maps: error against bytes and time for numbers of slices, compressions and storages (Kautz et al. 2004)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..images.storage import IMAGE_STORAGES, Storage, quantize
from ..shading_maps import power_law, slice_basis
from ..shading_maps.shading_map import ShadingMap, at_level, averages_of, linearise
from ..shading_maps.slice_atlas import SliceLayout, unpack_slices
from ..shading_maps.store import Compression, check_storage, store_map
from ..source import Facts
from .chart import SAME_TIME, Chart, Point
from .journal import Journal
from .page import Section, Table
from .tables import storage_words

Images = NDArray[np.float32]
MapKey = tuple[str, int, str]

USUAL_STORAGE = Storage.HALF
LEAST_PHOTOGRAPHS = 4


@dataclass(frozen=True)
class Model:
    """A way to keep a map: "none" its slices, "power" two numbers per texel and channel, "basis" `rank` numbers."""

    name: str
    compression: Compression
    rank: int = 2


MODELS = (
    Model("slices", "none"),
    Model("power law", "power"),
    Model("1 curve", "basis", 1),
    Model("2 curves", "basis", 2),
    Model("3 curves", "basis", 3),
)


@dataclass(frozen=True)
class MapSizes:
    """Sizes of the shading maps that are tried.

    slices : numbers of them, black included; those of `timed` are rendered too
    parts : into which the photographs are divided, each being predicted from all the others
    """

    slices: tuple[int, ...]
    timed: tuple[int, ...]
    storages: tuple[Storage, ...]
    parts: int


FULL = MapSizes((3, 4, 6, 8, 12, 16, 24, 32), (3, 4, 6, 8, 12, 16, 24, 32), IMAGE_STORAGES, 4)
QUICK = MapSizes((3, 8, 16), (8, 16), (Storage.HALF, Storage.BYTE), 2)


@dataclass(frozen=True)
class MapSetting:
    """One way to keep a shading map, and what was measured for it.

    bytes : of its textures in their files, before lossless compression
    error : RMS difference at photographs that the map was made without, in parts of their RMS
    sample_ns : of one lookup in rendered nodes, where it was measured
    """

    model: str
    slices: int
    storage: str
    bytes: int
    error: float
    sample_ns: float | None = None

    @property
    def key(self) -> MapKey:
        """Key of everything that the setting's time depends on."""
        return self.model, self.slices, self.storage


def settings_of(sizes: MapSizes) -> Iterator[tuple[Model, int, Storage]]:
    """All settings that can be built."""
    for model in MODELS:
        for slices in sizes.slices:
            if slices <= model.rank and model.compression == "basis":
                continue
            for storage in sizes.storages:
                try:
                    check_storage(model.compression, storage)
                except BakeError:
                    continue
                yield model, slices, storage


def measure_maps(
    name: str, images: Images, journal: Journal, sizes: MapSizes, progress: Callable[[float], None]
) -> list[MapSetting]:
    """Measure all settings for one swatch.

    Parameters
    ----------
    images : (n, H, W, 3) linear photographs, `LEAST_PHOTOGRAPHS` or more

    Raises
    ------
    BakeError : the photographs make no shading map
    """
    found = []
    wanted = list(settings_of(sizes))
    for k, (model, slices, storage) in enumerate(wanted):
        progress(k / len(wanted))
        key = f"maps {name} {model.name} {slices} {storage}"
        row = journal.measure(key, partial(_measured, images, model, slices, storage, sizes.parts))
        found.append(MapSetting(model.name, slices, str(storage), **row))
    return found


def timed(settings: Sequence[MapSetting], times: Mapping[MapKey, float]) -> list[MapSetting]:
    """Copy with the times in rendered nodes."""
    return [replace(s, sample_ns=times.get(s.key)) for s in settings]


def _measured(images: Images, model: Model, slices: int, storage: Storage, parts: int) -> Facts:
    averages = averages_of(images)
    order = np.argsort(averages, kind="stable")
    # The darkest and the brightest stay: without them a map would have to guess beyond what it knows.
    inner = order[1:-1]
    lost, whole, size = 0.0, 0.0, 0
    for part in range(min(parts, len(inner))):
        left_out = inner[part::parts]
        rest = linearise(np.delete(images, left_out, axis=0), slices)
        lookup, size = stored_lookup(rest.map, model, storage)
        for k in left_out:
            predicted = lookup(averages[k] / rest.a_max) * np.float32(rest.a_max)
            lost += float(np.square(predicted - images[k], dtype=np.float64).sum())
            whole += float(np.square(images[k], dtype=np.float64).sum())
    return {"bytes": size, "error": float(np.sqrt(lost / max(whole, 1e-300)))}


def stored_lookup(shading_map: ShadingMap, model: Model, storage: Storage) -> tuple[Callable[[float], Images], int]:
    """The swatch at a level x, relative to a_max, as it comes back from its files, and their bytes."""
    images, facts, again = store_map(shading_map, model.compression, storage, model.rank)
    size = sum(image.pixels.shape[0] * image.pixels.shape[1] * _texel_bytes(image) for image in images.values())
    if model.compression == "none":
        return partial(at_level, again), size
    name = "power" if model.compression == "power" else "coefficients"
    height, width = shading_map.slices.shape[1:3]
    layout = SliceLayout(model.rank, height, width)
    tiles = unpack_slices(quantize(images[name].pixels, storage), layout) * np.float32(1 / facts["scale"])
    if model.compression == "power":
        law = power_law.PowerLaw(tiles[0], tiles[1])
        return law.evaluate, size
    basis = slice_basis.SliceBasis(np.moveaxis(tiles, 0, -1), np.array(facts["curves"], np.float32))
    return basis.evaluate, size


def _texel_bytes(image: Any) -> int:
    return int(Storage(image.storage).file_bytes(image.pixels.shape[2]))


# --- report ---------------------------------------------------------------------------------------------

_BYTES, _ERROR = "bytes in the files, before compression", "RMS error, relative"


def maps_section(name: str, settings: Sequence[MapSetting], photographs: int) -> Section:
    """Charts and table for one swatch."""
    words = [
        f"A shading map of {photographs} photographs, kept with few slices or many, or compressed. Error is measured "
        "at photographs that the map was made without, each shown at its own brightness: the RMS difference in parts "
        "of the photograph's RMS. It cannot fall below what lies between two photographs, however many slices are kept."
    ]
    section = Section(f"Shading map: {name}", [*words, _advice(settings)])
    usual = [s for s in settings if s.storage == USUAL_STORAGE]
    series: dict[str, list[Point]] = {}
    for s in settings:
        # Of a compressed map, bytes do not depend on the number of slices it was fitted to.
        series.setdefault(f"{s.model}, {storage_words(s.storage)}", []).append(
            Point(s.bytes, s.error, f"{s.slices} slices")
        )
    section.charts = [Chart(f"{name}: error against memory", _BYTES, _ERROR, series)]
    times: dict[str, list[Point]] = {}
    for s in usual:
        if s.sample_ns is not None:
            times.setdefault(s.model, []).append(Point(s.sample_ns, s.error, f"{s.slices} slices"))
    if times:
        title = f"{name}: error against time of a sample in rendered nodes"
        section.charts.append(
            Chart(title, "ns per sample, processor time in Cycles", _ERROR, times, joined=False, same=SAME_TIME)
        )
    head = ("kept as", "slices", "storage", "bytes", "error", "ns, rendered")
    section.tables = [Table(head, [list(vars(s).values()) for s in sorted(settings, key=lambda s: s.error)])]
    return section


def _advice(settings: Sequence[MapSetting]) -> str:
    """What each is for, with this run's figures."""

    def best(model: str) -> MapSetting | None:
        own = [s for s in settings if s.model == model]
        return min(own, key=lambda s: s.error) if own else None

    slices, power, curves = best("slices"), best("power law"), best("2 curves")
    if slices is None or power is None or curves is None:
        return ""
    fewest = min((s for s in settings if s.model == "slices" and s.error < 1.05 * slices.error), key=lambda s: s.bytes)
    return (
        f"Slices are the truest ({slices.error:.1%} at best; {fewest.slices} of them, stored as "
        f"{storage_words(fewest.storage)}, are within a twentieth of that), and are for swatches seen close. The power "
        f"law of Kautz et al. keeps two numbers per texel and channel ({power.error:.1%}); it fails where a texel does "
        "not brighten steadily, as under a shadow that moves across it. Two curves fitted to this very swatch keep as "
        f"many numbers ({curves.error:.1%}), and take more time the more knots they have, one for each slice they were "
        "fitted to."
    )
