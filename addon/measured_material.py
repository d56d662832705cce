"""Measured materials in the open .blend: made from a file, baked again in place, and what is known of them.

What is particular to shading maps is in `arc_material`.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy

from ..bake.brdf.bake import bake_file, bake_source
from ..bake.brdf.settings import BakeSettings
from ..bake.bundle import SUFFIX, Bundle, read_bundle
from ..bake.errors import BakeError
from ..bake.material_json import dump_json
from ..bake.result import BakeResult, Progress
from ..bake.sources.analytic import by_name
from ..nodes.material import BUNDLE_KEY, SOURCE_KEY
from .brdf_build import account_of, build_brdf, usual_choices
from .cli_result import one_line
from .describe import image_sizes
from .kept_textures import keep_textures
from .quality_properties import choices_of, show_choices

# The bundle's facts as JSON text, so that the panel knows them wherever the .blend goes.
FACTS_KEY = "measured_materials_facts"


def import_brdf(
    file: Path, folder: Path, settings: BakeSettings, *, pack: bool, progress: Progress | None = None
) -> bpy.types.Material:
    """Bake a measurement to a bundle in `folder`, which must exist, and make a material of it. Raises BakeError.

    The bundle gets a name that is free, since an older one of the same name may serve another material.
    """
    result = bake_file(file, free_bundle(folder, Path(file).stem), settings, progress)
    return material_from(result, pack=pack, file=file)


def bake_again(
    material: bpy.types.Material,
    settings: BakeSettings,
    *,
    pack: bool,
    file: Path | None = None,
    progress: Progress | None = None,
) -> bpy.types.Material:
    """Bake the material's measurement, or another one, and rebuild it in place. Raises BakeError."""
    if file is None:
        file = source_file(material)
    target = target_of(material, file)
    if file is not None:
        result = bake_file(file, target, settings, progress)
    else:
        result = bake_source(_analytic_of(material), target, settings, progress)
    return material_from(result, material, pack=pack, file=file)


def material_from(
    result: BakeResult, material: bpy.types.Material | None = None, *, pack: bool, file: Path | None = None
) -> bpy.types.Material:
    """The material of a bundle just baked from `file`; a given one keeps its users. Raises BakeError."""
    bundle = read_bundle(result.path)
    choices = usual_choices(bundle)
    if material is not None and is_measured(material) and bundle.has("envelope"):
        choices = choices_of(material.measured_quality)
    material, plan = build_brdf(bundle, material, choices=choices, pack=pack)
    keep_textures(material, bundle, pack=pack, others=bundle.material["images"])
    remember(material, bundle, pack=pack, file=file, rendering=account_of(choices, plan))
    show_choices(material.measured_quality, choices)
    return material


def remember(
    material: bpy.types.Material, bundle: Bundle, *, pack: bool, file: Path | None, **further: dict[str, Any]
) -> None:
    """Keep with the material what its bundle says, what is `further` known, and what was baked."""
    facts = {**bundle.material, **further, "packed": pack}
    facts["images"] = {
        name: {**entry, "file_bytes": size["file_bytes"]}
        for (name, entry), size in zip(
            facts["images"].items(), image_sizes(facts, bundle.path, bundle.path).values(), strict=True
        )
    }
    keep_facts(material, facts)
    material[SOURCE_KEY] = str(Path(file).resolve()) if file is not None else ""


def keep_facts(material: bpy.types.Material, facts: Mapping[str, Any]) -> None:
    """Replace what is known of the material."""
    material[FACTS_KEY] = dump_json(facts, material.name)


def is_measured(material: bpy.types.Material | None) -> bool:
    """Whether the material was made here."""
    return material is not None and isinstance(material.get(FACTS_KEY), str)


def is_shading_map(material: bpy.types.Material | None) -> bool:
    """Whether the material was made here of photographs."""
    return material is not None and is_measured(material) and facts_of(material).get("kind") == "shading_map"


def facts_of(material: bpy.types.Material) -> dict[str, Any]:
    """What its bundle said of it; empty if that is not to be read. Do not change it."""
    return _parsed(material[FACTS_KEY])


@functools.lru_cache(maxsize=64)
def _parsed(text: str) -> dict[str, Any]:
    try:
        facts = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return facts if isinstance(facts, dict) else {}


def source_file(material: bpy.types.Material) -> Path | None:
    """The measurement or the folder of photographs it was baked from, as a path that may be gone; None for a model."""
    text = material.get(SOURCE_KEY)
    return Path(text) if isinstance(text, str) and text else None


def why_not_bakeable(material: bpy.types.Material) -> str:
    """Why the material cannot be baked again without being given a file; empty if it can."""
    file = source_file(material)
    if file is not None:
        what = "folder" if is_shading_map(material) else "measurement"
        return "" if _exists(file) else f"The {what} {file} is not there"
    try:
        _analytic_of(material)
    except BakeError:
        return "The material does not say what it was baked from"
    return ""


def assign(material: bpy.types.Material, obj: bpy.types.Object | None) -> str:
    """Put the material into the object's active slot and return nothing; else keep it by a fake user and say why."""
    why = _why_not_assignable(obj)
    if not why and obj is not None:
        obj.active_material = material
        if obj.active_material == material:
            return ""
        why = "its slot does not take it"
    material.use_fake_user = True
    return why


# A Volume's slot takes any material and shows none of its surface; a Grease Pencil's takes only its own kind.
_WITH_SURFACE = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD")


def _why_not_assignable(obj: bpy.types.Object | None) -> str:
    if obj is None:
        return "no object is active"
    if obj.type not in _WITH_SURFACE:
        kind = obj.bl_rna.properties["type"].enum_items[obj.type].name
        return f"an object of type {kind} has no surface to show it"
    if not (obj.is_editable and obj.data.is_editable):
        return "it belongs to another .blend file"
    return ""


def told_place(operator: bpy.types.Operator, material: bpy.types.Material, obj: bpy.types.Object | None) -> str:
    """Put the material onto the object; words on where it is, and a warning where an object does not take it."""
    why = assign(material, obj)
    if obj is None:
        return ""
    if why:
        name = one_line(obj.name)
        operator.report({"WARNING"}, f"{material.name} is not on {name}: {why}; assign it to another object")
    return "" if why else f" on {obj.name}"


def bundle_folder(chosen: str, file: Path) -> Path:
    """Where a bundle goes: the chosen folder, else beside the .blend, else beside the measurement."""
    if chosen:
        return Path(bpy.path.abspath(chosen))
    if bpy.data.filepath:
        return Path(bpy.data.filepath).parent
    return Path(file).parent


def free_bundle(folder: Path, stem: str) -> Path:
    """A bundle's path in `folder` that nothing has yet."""
    number = 1
    while _exists(path := folder / f"{stem}{f'_{number}' if number > 1 else ''}{SUFFIX}"):
        number += 1
    return path


def target_of(material: bpy.types.Material, file: Path | None) -> Path:
    """The material's own bundle, or a new one where somebody may still read the old: a copy of the material, or the
    textures of a .blend that are not packed into it, to which undo and older versions of that .blend lead back.
    """
    own = Path(str(material.get(BUNDLE_KEY) or f"{material.name}{SUFFIX}"))
    shared = any(
        other != material and other.get(BUNDLE_KEY) == material.get(BUNDLE_KEY) for other in bpy.data.materials
    )
    if own.is_absolute() and _exists(own.parent):
        return free_bundle(own.parent, own.stem) if shared or not facts_of(material).get("packed") else own
    if file is None and not bpy.data.filepath:
        raise BakeError(own, "lay in a folder that is gone", "save the .blend file first; the bundle goes beside it")
    return free_bundle(bundle_folder("", file or own), own.stem)


def _analytic_of(material: bpy.types.Material) -> Any:
    """The model that the material was baked from. Raises BakeError where it was not one."""
    source = facts_of(material).get("source")
    about = dict(source["facts"]) if isinstance(source, dict) and isinstance(source.get("facts"), dict) else {}
    if about.pop("format", None) != "analytic":
        raise BakeError(material.name, "was not baked from a model", "choose the measurement")
    model = str(about.pop("model", ""))
    parameters = {key: tuple(value) if isinstance(value, list) else value for key, value in about.items()}
    return by_name(model, **parameters)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False
