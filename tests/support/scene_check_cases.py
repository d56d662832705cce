"""Ways to spoil a scene that shows a measured paint, each with the rule that reports it."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.addon.scene_check.findings import NOTE, SLOW, WRONG, Finding, measured_trees
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes.group import FAMILY_KEY, HASH_KEY, content_hash, trees_below

from support.scenes import TestScene

PAINT = analytic.MetallicPaint(diffuse=(0.05, 0.1, 0.3), flake=(0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)


_BAKED: list[Bundle] = []


def paint_bundle(folder: Path) -> Bundle:
    """Small, with an envelope; baked into the folder by the first of a process who asks."""
    if not _BAKED:
        sampler = SamplerLayout(n_o=16, n_h=16, n_phi=8)
        settings = BakeSettings(resolution=24, alpha=(0.5, 0.4), sampler=sampler, envelope=True)
        _BAKED.append(read_bundle(bake_source(PAINT, folder / "paint.mmat", settings).path))
    return _BAKED[0]


def clear_blend() -> None:
    """Remove everything of the kinds that these scenes are made of.

    But for groups that aim, most of the time that a material takes to build: the next takes them up where they are as
    they were built, and `update_scene` writes their tables anew.
    """
    kept = _as_built()
    for kind in ("materials", "node_groups", "images", "lights", "libraries", "collections", "texts"):
        for block in list(getattr(bpy.data, kind)):
            if block not in kept:
                getattr(bpy.data, kind).remove(block)


def _as_built() -> set[Any]:
    """Groups that aim, with all inside; of linked ones nothing."""
    own = [t for t in bpy.data.node_groups if t.library is None and FAMILY_KEY in t]
    trees = {inner for t in own if t.get(HASH_KEY) == content_hash(t) for inner in trees_below(t)}
    return trees | {n.image for tree in trees for n in tree.nodes if n.bl_idname == "ShaderNodeTexImage"}


def rules(scene: TestScene) -> dict[str, Finding]:
    return {finding.rule: finding for finding in check_scene(scene.scene) or ()}


def lamp_of(scene: TestScene) -> Any:
    return next(obj for obj in scene.scene.objects if obj.type == "LIGHT")


def material_of(scene: TestScene) -> Any:
    return scene.sphere.data.materials[0]


def table_image(scene: TestScene) -> Any:
    return next(image for image in bpy.data.images if image.name.startswith("metallic-paint residual"))


def cycles(name: str, value: Any) -> Callable[[TestScene], None]:
    return lambda scene: setattr(scene.scene.cycles, name, value)


def lamp(name: str, value: Any) -> Callable[[TestScene], None]:
    return lambda scene: setattr(lamp_of(scene).data, name, value)


def another_lamp(kind: str, **settings: Any) -> Callable[[TestScene], None]:
    def add(scene: TestScene) -> None:
        data = bpy.data.lights.new(kind, kind)
        for name, value in settings.items():
            setattr(data, name, value)
        obj = bpy.data.objects.new(kind, data)
        obj.location = (0, 0, 4)
        scene.scene.collection.objects.link(obj)
        update_scene(scene.scene)

    return add


def image_world(scene: TestScene) -> None:
    node = scene.scene.world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = bpy.data.images.new("sky", 4, 2)
    scene.scene.world.cycles.sampling_method = "NONE"


def shrunk(scene: TestScene) -> None:
    scene.scene.render.use_simplify = True
    scene.scene.cycles.texture_limit_render = "128"


def changed(scene: TestScene) -> None:
    measured_trees(material_of(scene))[0].nodes.new("ShaderNodeMath")


def scripted(scene: TestScene) -> None:
    measured_trees(material_of(scene))[0].nodes.new("ShaderNodeScript")


def scripted_on_gpu(scene: TestScene) -> None:
    scripted(scene)
    scene.scene.cycles.shading_system, scene.scene.cycles.device = True, "GPU"


def mixed(scene: TestScene, share: float = 0.3) -> None:
    tree = material_of(scene).node_tree
    group = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeGroup")
    mix, black = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    black.inputs["Color"].default_value = (0, 0, 0, 1)
    mix.inputs[0].default_value = 1 - share
    target = group.outputs["BSDF"].links[0].to_socket
    tree.links.new(group.outputs["BSDF"], mix.inputs[1])
    tree.links.new(black.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], target)


def mixed_under_a_sun(scene: TestScene) -> None:
    another_lamp("SUN", energy=2, angle=math.radians(0.526))(scene)
    mixed(scene)


def moved(scene: TestScene) -> None:
    lamp_of(scene).location = (1, 1, 4)
    lamp_of(scene).matrix_world.translation = (1, 1, 4)


def shadow_linked(scene: TestScene) -> None:
    lamp_of(scene).light_linking.blocker_collection = bpy.data.collections.new("blockers")


def far(scene: TestScene) -> None:
    scene.sphere.matrix_world.translation = (2e4, 0, 0)
    update_scene(scene.scene)


def without_texture(scene: TestScene) -> None:
    bpy.data.images.remove(table_image(scene))


def lost_texture(scene: TestScene) -> None:
    table_image(scene).filepath = "//gone/" + Path(table_image(scene).filepath).name


def in_an_older_bundle(scene: TestScene) -> None:
    """A texture of the same content, called as every bundle's up to schema 2."""
    image = table_image(scene)
    older = Path(image.filepath).parent.with_name("older.mmat")
    older.mkdir(exist_ok=True)
    image.filepath = str(shutil.copy(image.filepath, older / "residual.exr"))


def another_file(scene: TestScene) -> None:
    image = table_image(scene)
    image.filepath = next(str(f) for f in Path(image.filepath).parent.iterdir() if f.name.endswith("_sampler.exr"))


def stores_denoising_data(scene: TestScene) -> None:
    scene.scene.view_layers[0].cycles.denoising_store_passes = True


@dataclass(frozen=True)
class Case:
    rule: str
    severity: str
    spoil: Callable[[TestScene], None]
    mendable: bool = True


CASES = [
    Case("filter_glossy", WRONG, cycles("blur_glossy", 1.0)),
    Case("clamp_direct", WRONG, cycles("sample_clamp_direct", 10.0)),
    Case("clamp_indirect", WRONG, cycles("sample_clamp_indirect", 10.0)),
    Case("reflective_caustics", WRONG, cycles("caustics_reflective", False)),
    Case("fast_gi", WRONG, cycles("use_fast_gi", True)),
    Case("glossy_bounces", WRONG, cycles("glossy_bounces", 3)),
    Case("max_bounces", WRONG, cycles("max_bounces", 4)),
    Case("osl_files", WRONG, cycles("shading_system", True)),
    Case("path_guiding", SLOW, cycles("use_guiding", True)),
    Case("light_tree", SLOW, cycles("use_light_tree", False)),
    Case("denoising", NOTE, cycles("use_denoising", True)),
    Case("denoising_data", NOTE, stores_denoising_data, False),
    Case("normal_pass", WRONG, lambda s: setattr(s.scene.view_layers[0], "use_pass_normal", True), False),
    Case("engine", WRONG, lambda s: setattr(s.scene.render, "engine", "BLENDER_WORKBENCH"), False),
    Case("world_glossy", WRONG, lambda s: setattr(s.scene.world.cycles_visibility, "glossy", False)),
    Case("world_diffuse", WRONG, lambda s: setattr(s.scene.world.cycles_visibility, "diffuse", False), False),
    Case("world_sampling", SLOW, image_world),
    Case("lamp_glossy", WRONG, lambda s: setattr(lamp_of(s), "visible_glossy", False)),
    Case("lamp_diffuse", WRONG, lambda s: setattr(lamp_of(s), "visible_diffuse", False), False),
    Case("lamp_shadow", WRONG, lamp("use_shadow", False), False),
    Case("shadow_linking", WRONG, shadow_linked, False),
    Case("lamp_mis", WRONG, lambda s: setattr(lamp_of(s).data.cycles, "use_multiple_importance_sampling", False)),
    Case("lamp_size", WRONG, lamp("size", 0.0)),
    Case("lamp_size", WRONG, another_lamp("SUN", energy=2, angle=0.0)),
    Case("lamp_size", WRONG, another_lamp("POINT", energy=2, shadow_soft_size=0.0)),
    Case("lamp_size", WRONG, another_lamp("AREA", energy=2, shape="RECTANGLE", size=1.0, size_y=0.0)),
    Case("lamp_table", SLOW, moved),
    Case("hidden_objects", NOTE, lambda s: setattr(s.sphere, "visible_glossy", False), False),
    Case("bump_correction", WRONG, lambda s: setattr(material_of(s).cycles, "use_bump_map_correction", True)),
    Case("shading_offset", WRONG, lambda s: s.set_terminator(1, 0.3)),
    Case("geometry_offset", NOTE, lambda s: s.set_terminator(2, 0.1)),
    Case("colour_space", WRONG, lambda s: setattr(table_image(s).colorspace_settings, "name", "sRGB")),
    Case("alpha_mode", WRONG, lambda s: setattr(table_image(s), "alpha_mode", "STRAIGHT")),
    Case("missing_texture", WRONG, lost_texture),
    Case("wrong_texture", WRONG, another_file),
    Case("common_names", NOTE, in_an_older_bundle),
    Case("no_texture", WRONG, without_texture, False),
    Case("texture_limit", WRONG, shrunk),
    Case("changed_group", NOTE, changed, False),
    Case("mixed_mirror", WRONG, mixed_under_a_sun),
    Case("osl_off", WRONG, scripted),
    Case("osl_gpu", WRONG, scripted_on_gpu),
    Case("far_away", NOTE, far, False),
]


def spoiler(rule: str) -> Callable[[TestScene], None]:
    """The first that the rule reports."""
    return next(case.spoil for case in CASES if case.rule == rule)
