"""Time of a table's lookup in rendered nodes, by all that it depends on; what the table holds is of no matter to it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...bake.images.image_io import write_image
from ...bake.images.storage import TABLE_STORAGES, Storage
from ...bake.report.journal import Journal
from ...bake.report.tables import USUAL_FILTER, USUAL_STORAGE, LookupKey, TableSizes
from ...bake.report.tabulation import ANISOTROPIC_KINDS, KINDS, Kind
from ...bake.tables.atlas import AtlasLayout
from ...bake.tables.grids.anisotropic_grids import AnisotropicHalfGrid, AnisotropicNormalGrid
from ...bake.tables.grids.grid import Grid
from ...bake.tables.grids.half_vector_grid import HalfVectorGrid
from ...bake.tables.grids.normal_vector_grid import NormalVectorGrid
from ...bake.tables.log_codes import LogCodes
from ...bake.tables.search.anisotropic_search import half_shape, normal_shape
from ...bake.tables.search.isotropic_search import half_sizes
from ...bake.tables.table import FILTERS
from ...nodes import expr
from ...nodes.data_image import load_data_image
from ...nodes.group import call
from ...nodes.table_lookup_group import table_lookup_group
from .render_timing import Build, Effort, evaluation_ns

LOOKUPS = 4  # at a shading point
# The kind whose time is measured for every filter and storage; others meet the usual storage.
_THOROUGH: tuple[Kind, ...] = (("half", "fitted"), ("half", "slopes"))

# Any will do: all take the same time.
_CODES = LogCodes.reaching(np.ones(3), np.full(3, 5.0))


@dataclass(frozen=True)
class _Batch:
    """Lookups that share size and storage of their textures, and are rendered in turns."""

    anisotropic: bool
    resolution: int
    storage: Storage
    ways: tuple[tuple[Kind, str], ...]  # with the filter


def measure_lookups(
    journal: Journal, sizes: TableSizes, anisotropic: bool, effort: Effort, progress: Callable[[float], None]
) -> dict[LookupKey, float]:
    """Nanoseconds of processor per lookup, one slice drawn at random as in materials."""
    batches = list(_batches(sizes, anisotropic))
    found: dict[LookupKey, float] = {}
    for k, batch in enumerate(batches):
        progress(k / len(batches))
        key = f"lookups {'four' if anisotropic else 'three'} axes {batch.resolution} {batch.storage}"
        for kind, filter, ns in journal.measure(key, partial(_measured, batch, effort)):
            found[(kind[0], kind[1], batch.resolution, filter, str(batch.storage))] = ns
    return found


def _batches(sizes: TableSizes, anisotropic: bool) -> Iterable[_Batch]:
    kinds = ANISOTROPIC_KINDS if anisotropic else KINDS
    for n in sizes.resolutions:
        for storage in map(Storage, TABLE_STORAGES):
            ways = [
                (kind, filter)
                for kind in kinds
                for filter in FILTERS
                if kind in _THOROUGH or (storage == USUAL_STORAGE and (sizes.crossed or filter == USUAL_FILTER))
            ]
            if storage != USUAL_STORAGE:
                ways = [way for way in ways if sizes.crossed or way[1] == USUAL_FILTER]
            yield _Batch(anisotropic, n, storage, tuple(ways))


def _measured(batch: _Batch, effort: Effort) -> list[tuple[Kind, str, float]]:
    """Kind, filter and nanoseconds."""
    names = {f"{kind[0]} {kind[1]} {filter}": (kind, filter) for kind, filter in batch.ways}
    images: dict[tuple[int, int], bpy.types.Image] = {}
    groups: list[bpy.types.ShaderNodeTree] = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            builds: dict[str, Build] = {}
            for name, (kind, filter) in names.items():
                grid = _grid(kind, batch.resolution, batch.anisotropic)
                size = AtlasLayout.of(grid).size
                if size not in images:
                    images[size] = _white(
                        Path(folder) / f"{size[0]}_{size[1]}{batch.storage.suffix}", size, batch.storage
                    )
                groups.append(_group(f"MM Timing {name}", images[size], grid, filter, batch.storage))
                builds[name] = partial(_looked_up, groups[-1])
            ns = evaluation_ns(builds, _directions_only, LOOKUPS, effort)
        finally:
            bpy.data.batch_remove([*groups, *images.values()])
    return [(*names[name], ns[name]) for name in names]


def _grid(kind: Kind, n: int, anisotropic: bool) -> Grid:
    basis, spacing = kind
    if anisotropic and basis == "half":
        return AnisotropicHalfGrid(half_shape(n, True))
    if anisotropic:
        return AnisotropicNormalGrid(normal_shape(n, True), folded=True, parameterization=spacing)
    parameterization: Any = spacing
    return (
        HalfVectorGrid(half_sizes(n, True)[0], parameterization)
        if basis == "half"
        else NormalVectorGrid(n, parameterization)
    )


def _white(path: Path, size: tuple[int, int], storage: Storage) -> bpy.types.Image:
    """From a file, so that Cycles holds it as it would hold a bundle's."""
    write_image(path, np.ones((size[1], size[0], 3), np.float32), storage.image)
    return load_data_image(path, path.name, half=storage == Storage.HALF)


def _group(name: str, image: bpy.types.Image, grid: Grid, filter: str, storage: Storage) -> bpy.types.ShaderNodeTree:
    log = _CODES if storage is Storage.LOG else None
    return table_lookup_group(name, image, grid, filter, stochastic=True, log=log)


def _looked_up(group: bpy.types.ShaderNodeTree, place: Any) -> Any:
    total = expr.vec(0.0, 0.0, 0.0)
    for wi, wo, random in _directions(place):
        total = total + call(group, wi, wo, random)
    return total


def _directions_only(place: Any) -> Any:
    total = expr.vec(0.0, 0.0, 0.0)
    for wi, wo, random in _directions(place):
        total = total + expr.scale(wi + wo, random)
    return total


def _directions(place: Any) -> Iterable[tuple[Any, Any, Any]]:
    """Pairs all over the upper hemisphere, and a number that stands for a random one."""
    x, y, _ = expr.components(place)
    for k in range(LOOKUPS):
        wi = expr.normalize(expr.vec(x * (3 + k) - 2, y * 5 - 3, 1 + 0.2 * k))
        wo = expr.normalize(expr.vec(2 - y * 4, x * 2 - 1, 1.1 + 0.1 * k))
        random = x * (97 + 10 * k)
        yield wi, wo, random - expr.floor(random)
