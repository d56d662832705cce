"""Time of a shading map's lookup in rendered nodes, for every way to keep the map."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ...bake.images.image_io import write_image
from ...bake.images.storage import Storage
from ...bake.report.journal import Journal
from ...bake.report.maps import USUAL_STORAGE, Images, MapKey, MapSizes, Model, settings_of
from ...bake.shading_maps.record_parts import StoredMap
from ...bake.shading_maps.shading_map import ShadingMap, linearise
from ...bake.shading_maps.slice_atlas import SliceLayout
from ...bake.shading_maps.store import store_map
from ...nodes import expr
from ...nodes.data_image import load_data_image
from ...nodes.group import call
from ...nodes.shading_map_material import map_group
from ...nodes.slices_group import SliceImages, SliceOptions
from .render_timing import Build, Effort, evaluation_ns

LOOKUPS = 4  # at a shading point


def measure_map_times(
    name: str, images: Images, journal: Journal, sizes: MapSizes, effort: Effort, progress: Callable[[float], None]
) -> dict[MapKey, float]:
    """Nanoseconds of processor per sample, all ways of one number of slices rendered in turns.

    Of the storages the usual one is timed: texels reach the shader as floats in any case.
    """
    found: dict[MapKey, float] = {}
    for k, slices in enumerate(sizes.timed):
        progress(k / len(sizes.timed))
        wanted = [m for m, n, storage in settings_of(sizes) if n == slices and storage == USUAL_STORAGE]
        key = f"map times {name} {slices}"
        times = journal.measure(key, partial(_measured, linearise(images, slices).map, wanted, effort))
        found |= {(model, slices, str(USUAL_STORAGE)): ns for model, ns in times.items()}
    return found


def _measured(shading_map: ShadingMap, models: list[Model], effort: Effort) -> dict[str, float]:
    textures: list[bpy.types.Image] = []
    groups: list[bpy.types.ShaderNodeTree] = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            builds: dict[str, Build] = {}
            for model in models:
                groups.append(_group(shading_map, model, Path(folder), textures))
                builds[model.name] = partial(_looked_up, groups[-1])
            return evaluation_ns(builds, _places_only, LOOKUPS, effort)
        finally:
            bpy.data.batch_remove([*groups, *textures])


def _group(
    shading_map: ShadingMap, model: Model, folder: Path, textures: list[bpy.types.Image]
) -> bpy.types.ShaderNodeTree:
    """The lookup as materials use it, its textures from files as a bundle's are."""
    stored, facts, _ = store_map(shading_map, model.compression, USUAL_STORAGE, model.rank)
    loaded: dict[str, bpy.types.Image] = {}
    for name, image in stored.items():
        path = folder / f"{model.name} {name}{image.storage.suffix}"
        write_image(path, image.pixels, image.storage)
        loaded[name] = load_data_image(path, path.name, half=image.storage == Storage.HALF)
        textures.append(loaded[name])
    slices, height, width = shading_map.slices.shape[:3]
    tiles = slices - 1 if model.compression == "none" else model.rank
    curves = tuple(tuple(row) for row in facts.get("curves", ()))
    layout = SliceLayout(tiles, height, width)
    own = StoredMap(facts["model"], slices, layout, facts["scale"], facts.get("envelope_scale", 1.0), curves)
    main = loaded[own.image]
    images = SliceImages(main, loaded.get("envelope", main), layout, 1 / own.scale, 1 / own.envelope_scale)
    return map_group(f"MM Timing {model.name}", own, images, SliceOptions(stochastic=True))


def _looked_up(group: bpy.types.ShaderNodeTree, place: Any) -> Any:
    total = expr.vec(0.0, 0.0, 0.0)
    for uv, x, random in _places(place):
        _, residual, envelope, share = call(group, uv, x, 1.0, random)
        total = total + residual + expr.scale(envelope, share)
    return total


def _places_only(place: Any) -> Any:
    total = expr.vec(0.0, 0.0, 0.0)
    for uv, x, random in _places(place):
        total = total + expr.scale(uv, x) + expr.scale(uv, random)
    return total


def _places(place: Any) -> Any:
    x, y, _ = expr.components(place)
    for k in range(LOOKUPS):
        level, random = y * (3 + k), x * (97 + 10 * k)
        yield expr.vec(x * (2 + k), y * 3, 0.0), level - expr.floor(level), random - expr.floor(random)
