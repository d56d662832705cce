"""Rules of the scene check: materials, their textures, the objects that wear them, and the table of lamps."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import bpy
import numpy as np

from ...bake.errors import BakeError
from ...nodes import compat
from ...nodes.aimed_light_group import INSTEAD_KEY, SLOTS_KEY, can_switch, room_of
from ...nodes.data_image import PART_KEY, has_common_name, rename_packed
from ...nodes.group import HASH_KEY, content_hash, hashing_once
from ...nodes.lamp_light_groups import SAMPLED_KEY
from ...nodes.osl_script import is_one_script
from ...nodes.texture_content import file_of
from ..lights import aim_targets, light_tables
from ..lights.lamp_survey import LampReport
from ..material import rebuild
from ..material.build_brdf import sampling_for
from ..material.build_shading_map import sampling_for_map
from ..material.choices import AUTO, OSL, Choices
from ..material.facts import is_measured, record_of
from ..material.kinds import SHADING_MAP, kind_of
from ..material.lighting import uses_mode
from ..material.scene_fit import MIRROR_EFFECTS, SAMPLED_EFFECT, plan_sampling
from ..material.texture_repair import expected, is_another, load_right, right_file
from .findings import NOTE, SLOW, WRONG, Finding, Subject, editable, measured_trees, middle, setting

_OTHER = "a file of the same name was taken, and the material renders with another's numbers"
# Coordinates of float32 are then a thousandth apart.
_FAR = 10_000.0


# --- materials ------------------------------------------------------------------------------------------


def bump_correction(subject: Subject) -> Iterator[Finding]:
    """Set by the builder; a copied or merged material may have lost it."""
    for material in subject.mirrors:
        if material.cycles.use_bump_map_correction:
            why = "it bends the mirror where its reflection dips under the facet: +0.4 % on a coarse sphere"
            mend = setting(material.cycles, "use_bump_map_correction", False)
            yield Finding("bump_correction", WRONG, _name(material), "Bump Map Correction is on", "off", why, mend)


def emission_sampling(subject: Subject) -> Iterator[Finding]:
    """Set by the builder; a copied or merged material may have lost it."""
    for material in subject.mirrors:
        sampled = any(SAMPLED_KEY in tree for tree in measured_trees(material))
        if sampled and material.cycles.emission_sampling != "NONE":
            why = "Cycles takes it for a lamp, and its shader then sees no shadows (5.2)"
            mend = setting(material.cycles, "emission_sampling", "NONE")
            found = f"Emission Sampling is {material.cycles.emission_sampling}"
            yield Finding("emission_sampling", WRONG, _name(material), found, "None", why, mend)


def changed_groups(subject: Subject) -> Iterator[Finding]:
    """An artist's work, not to be undone."""
    with hashing_once():
        changed = {
            material: [t.name for t in measured_trees(material) if t.is_editable and t[HASH_KEY] != content_hash(t)]
            for material in subject.wearers
        }
    for material, names in changed.items():
        if names:
            found = f"group {', '.join(names)} is not as it was built"
            why = "edited manually, its textures renamed, or made by another version of Blender"
            yield Finding("changed_group", NOTE, _name(material), found, "", why)


# --- textures -------------------------------------------------------------------------------------------


def textures(subject: Subject) -> Iterator[Finding]:
    """Numbers that are to reach the shader as they are."""
    for image, material in _data_images(subject):
        if image is None:
            yield Finding("no_texture", WRONG, _name(material), "a texture is gone", "", "bake it again")
            continue
        where = f"texture {image.name}"
        space = image.colorspace_settings
        if not space.is_data:
            why = "the table's numbers are taken for colours and changed"
            found, mend = f"Color Space is {space.name}", setting(space, "is_data", True)
            yield Finding("colour_space", WRONG, where, found, "Non-Color", why, mend)
        if image.alpha_mode != "CHANNEL_PACKED":
            why = "numbers would be divided by what the alpha channel holds"
            mend = setting(image, "alpha_mode", "CHANNEL_PACKED")
            found = f"Alpha is {image.alpha_mode.replace('_', ' ').title()}"
            yield Finding("alpha_mode", WRONG, where, found, "Channel Packed", why, mend)
        if is_another(image, material, anew=True):
            place = right_file(image, material)
            mend = editable(image, partial(load_right, image, place)) if place else None
            found, why = f"file {image.filepath} is not the one that {material.name} was built with", _OTHER
            yield Finding("wrong_texture", WRONG, where, found, str(place) if place else "baked again", why, mend)
        if _is_missing(image):
            place = right_file(image, material)
            mend = editable(image, partial(load_right, image, place)) if place else None
            found, why = f"file {image.filepath} is not there", "the material renders without it"
            wanted = str(place) if place else "found, or baked again"
            yield Finding("missing_texture", WRONG, where, found, wanted, why, mend)


def common_names(subject: Subject) -> Iterator[Finding]:
    """Images of bundles up to schema 2, which are called alike in all of them."""
    files = [
        (image, *wanted)
        for image, material in _data_images(subject)
        if image is not None and image.source == "FILE" and image.packed_file is None and image.is_editable
        if (wanted := expected(image, material)) is not None and has_common_name(image, wanted[0])
    ]
    if not files:
        return

    def pack() -> None:
        for image, part, sha256 in files:
            image.pack()
            rename_packed(image, image.name, part, sha256)

    found = f"{len(files)} textures are files of names that every older bundle has"
    why = "Find Missing Files and packers that flatten folders take one material's for another's; packed they are safe"
    yield Finding("common_names", NOTE, f"scene {subject.scene.name}", found, "", why, pack)


def osl_files(subject: Subject) -> Iterator[Finding]:
    """OSL reads files by mip levels that it takes from derivatives, and slices chosen at random have none."""
    files = [
        image
        for image, _ in _data_images(subject)
        if image is not None and image.source == "FILE" and image.packed_file is None
    ]
    if not files or not subject.scene.cycles.shading_system:
        return

    def pack() -> None:
        for image in files:
            image.pack()

    why = "with Open Shading Language on, tables read from files lost 20 % at random; packed ones did not"
    found = f"{len(files)} textures are files"
    yield Finding("osl_files", WRONG, f"scene {subject.scene.name}", found, "packed into the .blend", why, pack)


def texture_limit(subject: Subject) -> Iterator[Finding]:
    """Simplify shrinks tables, which destroys them.

    The texture cache of Blender 5.2 needs no rule: it takes smaller textures by derivatives, and directions drawn at
    random have none (pictures with and without it were equal to 1e-6).
    """
    scene = subject.scene
    cycles, where = scene.cycles, f"scene {scene.name}"
    if not scene.render.use_simplify:
        return
    why = "it shrinks tables as if they were pictures; 128 lost 3 to 5 %, half of the size 10 to 16 %"
    limit = getattr(cycles, "texture_limit_render", "OFF")
    largest = max((max(image.size) for image, _ in _data_images(subject) if image is not None), default=0)
    if limit != "OFF" and largest > int(limit):
        found, mend = f"Simplify, Texture Limit is {limit}", setting(cycles, "texture_limit_render", "OFF")
        yield Finding("texture_limit", WRONG, where, found, "No Limit", why, mend)
    share = getattr(cycles, "texture_resolution_render", 1.0)  # since 5.2
    if share < 1:
        found, mend = f"Simplify, Texture Resolution is {share:.0%}", setting(cycles, "texture_resolution_render", 1.0)
        yield Finding("texture_resolution", WRONG, where, found, "100%", why, mend)


def _data_images(subject: Subject) -> list[tuple[bpy.types.Image | None, bpy.types.Material]]:
    """Textures of measured groups, each once, with a material that uses it."""
    found: dict[tuple[Any, Any], bpy.types.Material] = {}
    for material in subject.wearers:
        for tree in measured_trees(material):
            for node in tree.nodes:
                if node.bl_idname == "ShaderNodeTexImage":
                    found.setdefault((node.image, None if node.image else material), material)
    return [(image, material) for (image, _), material in found.items()]


def _is_missing(image: bpy.types.Image) -> bool:
    return image.source == "FILE" and image.packed_file is None and not os.path.isfile(file_of(image))


# --- objects --------------------------------------------------------------------------------------------


def shadow_terminator(subject: Subject) -> Iterator[Finding]:
    """Cycles' remedies for coarse meshes change what closures reflect."""
    moved = []
    for obj in subject.shown:
        owner, shading, geometry = compat.shadow_terminator(obj)
        if getattr(owner, shading) > 0:
            found = f"Shadow Terminator, Shading Offset is {getattr(owner, shading):.2g}"
            why = "it darkens each shader by its own normal; 0.3 lost 10 to 16 % on a sphere of 32 segments"
            mend = setting(owner, shading, 0.0)
            yield Finding("shading_offset", WRONG, f"object {obj.name}", found, "0", why, mend)
        if getattr(owner, geometry) > 0:
            moved.append(obj)
    if moved:
        names = ", ".join(obj.name for obj in moved[:3]) + (" and others" if len(moved) > 3 else "")
        found = f"Shadow Terminator, Geometry Offset is above 0 for {names}"
        why = "Cycles' own shaders get up to 0.5 % more light on a coarse sphere, the mirror does not"
        mend = partial(_lay_flat, moved) if any(obj.is_editable for obj in moved) else None
        yield Finding("geometry_offset", NOTE, f"scene {subject.scene.name}", found, "", why, mend)


def _lay_flat(objects: list[bpy.types.Object]) -> None:
    for obj in objects:
        if obj.is_editable:
            owner, _, geometry = compat.shadow_terminator(obj)
            setattr(owner, geometry, 0.0)


def far_away(subject: Subject) -> Iterator[Finding]:
    """Positions are float32."""
    for obj in subject.shown:
        distance = middle(obj).length
        if distance > _FAR:
            found = f"{distance:.0f} units from the origin"
            why = "positions are whole steps of float32 there, and an orthographic close-up may repeat its noise"
            yield Finding("far_away", NOTE, f"object {obj.name}", found, "", why)


# --- what is aimed at -----------------------------------------------------------------------------------


def lamp_tables(subject: Subject) -> Iterator[Finding]:
    """An old table costs noise; of lamps that a shader samples, after a bounce, light too."""
    names = light_tables.TABLE, light_tables.LIGHT_TABLE
    tables = [image for image, _ in _data_images(subject) if image is not None and image.name.startswith(names)]
    if not tables:
        return
    scene = subject.scene
    report = light_tables.survey_scene(scene, for_render=True)
    table, lights = light_tables.table_of(report), light_tables.light_table_of(report)
    groups = {t for m in subject.mirrors for t in measured_trees(m) if SLOTS_KEY in t and INSTEAD_KEY not in t}
    known = 0 if report.inexact else report.slots

    def wanted(group: bpy.types.NodeTree) -> int:
        return min(known if SAMPLED_KEY in group else report.slots, room_of(group))

    narrow = [group for group in groups if group[SLOTS_KEY] < wanted(group)]
    where = f"scene {scene.name}"
    if any(group.is_editable or can_switch(group) for group in narrow) or not all(
        _holds(image, table if image.size[0] == table.shape[1] else lights) for image in tables
    ):
        why = "mirrors aim at lamps that have changed since; without aiming, a small lamp is found by chance only"
        found = f"table {light_tables.TABLE} is out of date"
        yield Finding(
            "lamp_table", SLOW, where, found, "brought up to date", why, lambda: light_tables.keep_current(scene)
        )
    linked = sorted(group.name for group in narrow if not (group.is_editable or can_switch(group)))
    if linked:
        found = f"linked group {', '.join(linked)} aims at fewer lamps than there are"
        why = "only chance finds the others; a group of another .blend cannot be built anew, but one made local can"
        yield Finding("linked_slots", SLOW, where, found, "made local, with its material", why)


def not_sampled(subject: Subject) -> Iterator[Finding]:
    """Fitted to a scene whose lamps were known, or were not."""
    built = [m for m in subject.mirrors if kind_of(m) is not None]
    if not built:
        return
    report = light_tables.survey_scene(subject.scene, for_render=True)
    for material in built:
        choices, sampled = _choices_by_mode(material), _samples(material)
        if choices.mode not in ("exact", "balanced") or choices.sample != AUTO or choices.aim != AUTO:
            continue
        sampling = _sampling(material, choices, report)
        kept = plan_sampling(choices, sampling).kept
        stale = kept and _shows_another_world(material, report)
        if (sampled == kept and not stale) or not (sampled or residual_of(material)):
            continue
        mend = None
        if not kind_of(material).why_not_rebuildable(material):
            mend = editable(material, partial(kind_of(material).refit, material, subject.scene))
        found = f"lamps are no longer sampled: {sampling.impossible or sampling.needless}"
        why = "its mirror is not aimed at them, and meets a small one by chance only"
        if kept:
            found, before = "lamps are not sampled, though they can be", "they could not"
            if sampled:
                found, before = "the world's picture is not sampled, though it can be", "the world was another"
            why = f"it was fitted when {before}; beside a mirror that is aimed, sampling leaves {sampling.gain}"
        yield Finding("not_sampled", SLOW, _name(material), found, "fitted to the scene", why, mend)


def _sampling(material: bpy.types.Material, choices: Choices, report: LampReport) -> aim_targets.Sampling:
    """What the material's builder is told, as far as the material says what it is."""
    swatch = kind_of(material) is SHADING_MAP
    try:
        record = record_of(material)
    except BakeError:
        return aim_targets.sampling_of(report, osl=choices.shader == OSL)
    if swatch:
        return sampling_for_map(choices, report, through=record.through is not None)
    return sampling_for(record, choices, report)


def _shows_another_world(material: bpy.types.Material, report: LampReport) -> bool:
    """Whether a material that samples light holds no picture of the world, or another, though it could hold it."""
    picture = report.world.picture
    if report.world_inexact or picture is None:
        return False
    nodes = (node for tree in measured_trees(material) for node in tree.nodes)
    shown = {n.image.session_uid for n in nodes if n.bl_idname == "ShaderNodeTexEnvironment" and n.image}
    return shown != {picture.image}


def _choices_by_mode(material: bpy.types.Material) -> Choices:
    """What a material was built by; of a swatch whose technique knows no modes, as in one that samples no lamps."""
    choices = rebuild.current_choices(material)
    if kind_of(material) is not SHADING_MAP:
        return choices
    lit = rebuild.current_lighting(material)
    return replace(choices, mode=lit.mode if uses_mode(lit.technique) else "reference")


def residual_of(material: bpy.types.Material) -> bool:
    """Whether a material was built with a mirror for its residual, as all swatches are that have one at all."""
    if kind_of(material) is SHADING_MAP:
        return True
    return any(effect.name in MIRROR_EFFECTS and effect.kept for effect in rebuild.effects_of(material))


def not_aimed(subject: Subject) -> Iterator[Finding]:
    """Fitted to a scene that had no lamps yet."""
    unaimed = [m for m in subject.mirrors if is_measured(m) and not _aims(m)]
    report = light_tables.survey_scene(subject.scene, for_render=True) if unaimed else None
    for material in unaimed:
        targets = aim_targets.what_to_aim_at(report)
        if rebuild.current_choices(material).aim != AUTO or not targets:
            continue
        kind, mend = kind_of(material), None
        if kind is not None and not kind.why_not_rebuildable(material):
            mend = editable(material, partial(kind.refit, material, subject.scene))
        why = "it was fitted when there was nothing to aim at; by chance alone a small lamp has 70 times the noise"
        yield Finding("not_aimed", SLOW, _name(material), "aims at nothing", "fitted to the scene", why, mend)


def _samples(material: bpy.types.Material) -> bool:
    """Whether its shader samples lamps."""
    if is_one_script(material):
        return any(e.name == SAMPLED_EFFECT and e.kept for e in rebuild.effects_of(material))
    return any(SAMPLED_KEY in tree for tree in measured_trees(material))


def _aims(material: bpy.types.Material) -> bool:
    """Whether it knows of lamps; a script's only images, but for those of its preview, are the tables of these."""
    trees = measured_trees(material)
    if is_one_script(material):
        images = (n.image for tree in trees for n in tree.nodes if n.bl_idname == "ShaderNodeTexImage")
        return any(image is None or PART_KEY not in image for image in images)
    return any(SLOTS_KEY in tree for tree in trees)


def _holds(image: bpy.types.Image, table: Any) -> bool:
    pixels = np.empty(table.size, np.float32)
    if image.size[0] * image.size[1] * image.channels != table.size:
        return False
    image.pixels.foreach_get(pixels)
    return bool(np.allclose(pixels, np.asarray(table[::-1], np.float32).ravel(), rtol=1e-5))


def _name(material: bpy.types.Material) -> str:
    return f"material {material.name}"


RULES = (
    bump_correction,
    textures,
    common_names,
    texture_limit,
    shadow_terminator,
    lamp_tables,
    not_aimed,
    not_sampled,
    emission_sampling,
    changed_groups,
    osl_files,
    far_away,
)
# What matters without a mirror too.
OF_TEXTURES = (textures, common_names, texture_limit, changed_groups)
