"""Shading-map materials in the open .blend: made of photographs, baked again, and what they keep."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..bake.bundle import read_bundle, require
from ..bake.errors import BakeError
from ..bake.result import BakeResult, Progress
from ..bake.shading.bake_arc import ArcSettings, bake_arc
from ..bake.shading.map_facts import render_of, shading_map_of
from ..nodes.shading_map_material import build_shading_map
from .arc_build import build_map
from .blender_photographs import decode
from .describe_map import energy_rows, map_error_rows, map_rows
from .kept_textures import keep_textures
from .lighting_properties import show_lighting
from .measured_material import facts_of, free_bundle, remember, source_file, target_of

# Names of the photographs as JSON where they are not a whole folder.
FILES_KEY = "measured_materials_photographs"
_MAPPING = "Swatch size and rotation"


def import_arc(
    source: Path | Sequence[Path], folder: Path, settings: ArcSettings, *, pack: bool, progress: Progress | None = None
) -> bpy.types.Material:
    """Bake a folder of photographs, or photographs, to a bundle in `folder` and make a material. Raises BakeError."""
    target = free_bundle(folder, _folder_of(source).resolve().name or "swatch")
    return _material_from(bake_arc(source, target, settings, progress, decode), source, pack=pack)


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
    target = target_of(material, _folder_of(source))
    return _material_from(bake_arc(source, target, settings, progress, decode), source, material, pack=pack)


def photographs_of(material: bpy.types.Material) -> Path | list[Path]:
    """What the material was baked from: a folder or files. Raises BakeError where it does not say."""
    folder = source_file(material)
    if folder is None:
        raise BakeError(material.name, "does not say what it was baked from", "choose the photographs")
    try:
        names = json.loads(material.get(FILES_KEY) or "[]")
        return [folder / str(name) for name in names] or folder
    except (ValueError, TypeError):
        return folder


def _folder_of(source: Path | Sequence[Path]) -> Path:
    return source if isinstance(source, Path) else source[0].parent


def _material_from(
    result: BakeResult,
    source: Path | Sequence[Path],
    material: bpy.types.Material | None = None,
    *,
    pack: bool,
) -> bpy.types.Material:
    """The material of a bundle just baked; a given one keeps its users. Raises BakeError."""
    bundle = read_bundle(result.path)
    fresh = material is None
    facts = bundle.material["map"]
    material = build_shading_map(bundle, material, pack=pack)
    if fresh:
        set_repeat(material, 1.0, facts)
    rendering = build_map(bundle, material, render_of(bundle), pack=pack)
    keep_textures(material, bundle, pack=pack)
    # With the mean colour of every slice the albedo under another light follows without a look at the pixels.
    means = shading_map_of(bundle).slices.mean(axis=(1, 2), dtype=np.float64)
    remember(
        material,
        bundle,
        pack=pack,
        file=_folder_of(source),
        map={**facts, "means": means.tolist()},
        rendering=rendering,
    )
    material[FILES_KEY] = "" if isinstance(source, Path) else json.dumps([path.name for path in source])
    show_lighting(material.measured_lighting, render_of(bundle))
    return material


def map_words(material: bpy.types.Material) -> str:
    """What a bake has come to, short."""
    facts = facts_of(material)
    rows = dict(
        map_rows(facts, material.name) + energy_rows(facts, material.name) + map_error_rows(facts, material.name)
    )
    return f"{rows['Shading map']}, envelope {rows['Envelope']}, held-out error {rows['Held-out']}"


def set_repeat(material: bpy.types.Material, repeat: float, facts: dict[str, Any]) -> None:
    """Have the swatch lie `repeat` times along a unit of texture coordinates, its sides in proportion."""
    width, height = (require(facts, key, int, material.name, minimum=1) for key in ("width", "height"))
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeMapping" and node.label == _MAPPING:
            node.inputs["Scale"].default_value = (repeat, repeat * width / height, 1.0)
