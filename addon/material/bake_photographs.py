"""Shading-map materials in the open .blend: made of photographs, baked again, and what they keep."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from ...bake.bundle.bundle import read_bundle
from ...bake.bundle.result import BakeResult, Progress
from ...bake.errors import BakeError
from ...bake.shading_maps.bake import ArcSettings, bake_arc
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.slice_atlas import SliceLayout
from ...nodes import portions
from ...nodes.material_tree import SWATCH_MAPPING
from ...nodes.shading_map_material import build_shading_map
from ..lights.light_tables import lamp_image
from ..photographs.blender_decoder import decode
from ..summary.shading_map_rows import energy_rows, map_error_rows, map_rows
from .bake_material import free_bundle, remember, target_of
from .build_shading_map import build_map
from .facts import record_of, source_file
from .lighting import show_lighting
from .textures.kept import keep_textures

# Names of the photographs as JSON where they are not a whole folder.
FILES_KEY = "measured_materials_photographs"


def import_arc(
    source: Path | Sequence[Path], folder: Path, settings: ArcSettings, *, pack: bool, progress: Progress | None = None
) -> bpy.types.Material:
    """Bake a folder of photographs, or photographs, to a bundle in `folder` and make a material. Raises BakeError."""
    target = free_bundle(folder, folder_of(source).resolve().name or "swatch")
    return swatch_from(bake_arc(source, target, settings, progress, decode), source, pack=pack)


def bake_arc_again(
    material: bpy.types.Material,
    settings: ArcSettings,
    *,
    pack: bool,
    source: Path | Sequence[Path] | None = None,
    progress: Progress | None = None,
) -> bpy.types.Material:
    """Bake the material's photographs, or others, and rebuild it in place. Raises BakeError."""
    if source is None:
        source = photographs_of(material)
    target = target_of(material, folder_of(source))
    return swatch_from(bake_arc(source, target, settings, progress, decode), source, material, pack=pack)


def photographs_of(material: bpy.types.Material) -> Path | list[Path]:
    """Photographs that a material was baked from: a folder or files. Raises BakeError where it does not say."""
    folder = source_file(material)
    if folder is None:
        raise BakeError(material.name, "does not say what it was baked from", "choose the photographs")
    try:
        names = json.loads(material.get(FILES_KEY) or "[]")
        return [folder / str(name) for name in names] or folder
    except (ValueError, TypeError):
        return folder


def folder_of(source: Path | Sequence[Path]) -> Path:
    return source if isinstance(source, Path) else source[0].parent


def swatch_from(
    result: BakeResult,
    source: Path | Sequence[Path] | None,
    material: bpy.types.Material | None = None,
    *,
    pack: bool,
) -> bpy.types.Material:
    """The material of a bundle baked from photographs, which may not be known; a given one keeps its users.

    Raises BakeError.
    """
    bundle = read_bundle(result.path)
    fresh = material is None
    record = ShadingMapRecord.read(bundle)
    further = {"map": {**bundle.material["map"], "means": _means(record)}}
    if (behind := record.transmitted()) is not None:
        told = bundle.material["through"]
        further["through"] = {**told, "map": {**told["map"], "means": _means(behind)}}
    # With what `build_map` will ask for where nothing is known of the material's place: the same group, made once.
    material = build_shading_map(record, material, pack=pack, lamps=lamp_image())
    if fresh:
        set_repeat(material, 1.0, record.map.layout)
    rendering = build_map(record, material, record.render, pack=pack)
    keep_textures(material, bundle, pack=pack)
    remember(
        material,
        bundle,
        pack=pack,
        file=None if source is None else folder_of(source),
        **further,
        rendering=rendering,
    )
    whole = source is None or isinstance(source, Path)
    material[FILES_KEY] = "" if whole else json.dumps([path.name for path in source])
    show_lighting(material, record.render)
    return material


def _means(record: ShadingMapRecord) -> list[list[float]]:
    """Mean colour of every slice, by which the albedo under another light follows without a look at the pixels."""
    return portions.once(
        f"means {record.images[record.map.image].sha256}",
        lambda: record.load_map().slices.mean(axis=(1, 2), dtype=np.float64).tolist(),
    )


def map_words(material: bpy.types.Material) -> str:
    """Short description of a baked shading map."""
    record = record_of(material)
    rows = dict(map_rows(record) + energy_rows(record) + map_error_rows(record))
    shaders = rows["Cycles' shaders"]
    return f"{rows['Shading map']}, Cycles' shaders {shaders}, left-out error {rows['Left-out error']}"


def set_repeat(material: bpy.types.Material, repeat: float, layout: SliceLayout) -> None:
    """Have the swatch lie `repeat` times along a unit of texture coordinates, its sides in proportion."""
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeMapping" and node.label == SWATCH_MAPPING:
            node.inputs["Scale"].default_value = (repeat, repeat * layout.width / layout.height, 1.0)
