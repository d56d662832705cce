"""Measured materials in the open .blend: made from a file, baked again in place, and what is known of them.

What is particular to shading maps is in `bake_photographs`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ...bake.brdf.bake import bake_file, bake_source
from ...bake.brdf.record import BrdfRecord
from ...bake.brdf.settings import BakeSettings
from ...bake.bundle.bundle import SUFFIX, Bundle, read_bundle
from ...bake.bundle.result import BakeResult, Progress
from ...bake.errors import BakeError
from ...bake.sources import title_of
from ...bake.sources.analytic import by_name
from ...nodes.material_tree import BUNDLE_KEY, SOURCE_KEY
from ..summary.brdf_rows import error_rows
from ..summary.text import one_line
from .build_brdf import account_of, build_brdf, usual_choices
from .choices import choices_of, show_choices
from .facts import facts_of, is_measured, keep_facts, record_of, source_file
from .textures.kept import keep_textures


def import_brdf(
    file: Path, folder: Path, settings: BakeSettings, *, pack: bool, progress: Progress | None = None
) -> bpy.types.Material:
    """Bake a measurement to a bundle in `folder`, which must exist, and make a material of it. Raises BakeError.

    The bundle gets a name that is free, since an older one of the same name may serve another material.
    """
    result = bake_file(file, free_bundle(folder, title_of(file, settings.reading)), settings, progress)
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
        result = bake_source(analytic_of(material), target, settings, progress)
    return material_from(result, material, pack=pack, file=file)


def material_from(
    result: BakeResult,
    material: bpy.types.Material | None = None,
    *,
    pack: bool,
    file: Path | None = None,
    mode: str | None = None,
) -> bpy.types.Material:
    """The material of a bundle just baked from `file`; a given one keeps its users, and its mode unless one is given.

    Raises BakeError.
    """
    bundle = read_bundle(result.path)
    record = BrdfRecord.read(bundle)
    choices = usual_choices(record, mode)
    if material is not None and is_measured(material) and record.has("envelope"):
        choices = choices_of(material.measured_quality)
        choices = replace(choices, mode=mode or choices.mode)
    material, plan = build_brdf(record, material, choices=choices, pack=pack)
    keep_textures(material, bundle, pack=pack, others=record.images)
    remember(material, bundle, pack=pack, file=file, rendering=account_of(choices, plan))
    show_choices(material.measured_quality, choices)
    return material


def remember(
    material: bpy.types.Material, bundle: Bundle, *, pack: bool, file: Path | None, **further: dict[str, Any]
) -> None:
    """Keep with the material what its bundle says, what is `further` known, and what was baked."""
    facts = {**bundle.material, **further, "packed": pack}
    facts["images"] = {
        name: {**entry, "file_bytes": bundle.image_path(name).stat().st_size}
        for name, entry in bundle.material["images"].items()
    }
    keep_facts(material, facts)
    material[SOURCE_KEY] = str(Path(file).resolve()) if file is not None else ""


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


def error_words(material: bpy.types.Material) -> str:
    """Measured error of a bake in a few words."""
    rows = dict(error_rows(record_of(material)))
    return f"RMS error {rows['RMS error']} ({rows['Relative']})"


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
    """Folder for a bundle: the chosen one, else beside the .blend, else beside the measurement."""
    if chosen:
        return Path(bpy.path.abspath(chosen))
    if bpy.data.filepath:
        return Path(bpy.data.filepath).parent
    return Path(file).parent


def free_bundle(folder: Path, stem: str, suffix: str = SUFFIX) -> Path:
    """A bundle's path in `folder` that nothing has yet, or that of another folder."""
    number = 1
    while exists(path := folder / f"{stem}{f'_{number}' if number > 1 else ''}{suffix}"):
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
    if own.is_absolute() and exists(own.parent):
        return free_bundle(own.parent, own.stem) if shared or not facts_of(material).get("packed") else own
    if file is None and not bpy.data.filepath:
        raise BakeError(own, "lay in a folder that is gone", "save the .blend file first; the bundle goes beside it")
    return free_bundle(bundle_folder("", file or own), own.stem)


def analytic_of(material: bpy.types.Material) -> Any:
    """The model that the material was baked from. Raises BakeError where it was not one."""
    name, parameters = model_of(material)
    return by_name(name, **parameters)


def model_of(material: bpy.types.Material) -> tuple[str, dict[str, Any]]:
    """Name and parameters of the model that the material was baked from. Raises BakeError where it was not one."""
    source = facts_of(material).get("source")
    about = dict(source["facts"]) if isinstance(source, dict) and isinstance(source.get("facts"), dict) else {}
    if about.pop("format", None) != "analytic":
        raise BakeError(material.name, "was not baked from a model", "choose the measurement")
    model = str(about.pop("model", ""))
    parameters = {key: tuple(value) if isinstance(value, list) else value for key, value in about.items()}
    return model, parameters


def exists(path: Path) -> bool:
    """Whether there is something of this path, which may hold anything."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False
