"""Rules of the scene check: what spoils light that comes through a sheet.

Its rays are refracted where refraction leads, and go through a Ray Portal elsewhere, seen at flat angles above all. A
refracted ray is one of transmission; one of a portal stays what it was, the camera's at first, and counts as one that
passed something transparent. Figures are of a white Lambertian sheet in mode Reference, seen at that angle from its
normal.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np

from ...bake.source import Array
from ...nodes.aimed_light_group import ON_SHEET, SLOTS_KEY, WORLD_KEY
from ...nodes.lamp_light_groups import SAMPLED_KEY
from ...nodes.osl_sheet import leads_through
from ...nodes.through_closure import PORTAL
from ..lights.lamp_survey import CAPACITY, LampReport, survey_scene
from ..lights.seen_world import world_light_table
from ..material.rebuild import effects_of
from ..material.scene_fit import SAMPLED_EFFECT
from .findings import NOTE, WRONG, Finding, Subject, measured_trees, setting

# As many as carry all the light that one can measure in a room, see `scene_rules`.
_BOUNCES = 4
# Faces of an object that are asked on which side a lamp is; of more, so many of them.
_FACES = 4096
# Passes of the first surface that is opaque enough, as a view layer has them, and passes that go by how opaque each is.
_DATA_PASSES = {
    "use_pass_z": "Depth",
    "use_pass_position": "Position",
    "use_pass_normal": "Normal",
    "use_pass_uv": "UV",
    "use_pass_vector": "Vector",
    "use_pass_object_index": "Object Index",
    "use_pass_material_index": "Material Index",
}
_CRYPTOMATTE = {
    "use_pass_cryptomatte_object": "Cryptomatte Object",
    "use_pass_cryptomatte_material": "Cryptomatte Material",
    "use_pass_cryptomatte_asset": "Cryptomatte Asset",
}
_LOST = "26 % of the light through a sheet at 60 degrees and 43 % at 80"


def sheets(subject: Subject) -> dict[bpy.types.Material, tuple[bpy.types.Object, ...]]:
    """Measured materials that send rays through portals, each with the objects that show it."""
    return {
        material: objects
        for material, objects in subject.wearers.items()
        if any(node.bl_idname == PORTAL or leads_through(node) for node in _nodes(material))
    }


def _sampling(subject: Subject, what: str) -> set[bpy.types.Material]:
    """Sheets whose shader samples lamps (SLOTS_KEY), or the world (WORLD_KEY), in the scene as it is.

    Groups of nodes are told how much they may sample. Scripts go by tables, which are dark where the light is no longer
    known exactly: it is then the mirror that has to meet it, as of a sheet that samples nothing.
    """
    worn = sheets(subject)
    scripts = {material for material in worn if any(map(leads_through, _nodes(material)))}
    found = {
        material
        for material in worn
        if any(tree.get(SAMPLED_KEY) and tree.get(what) for tree in measured_trees(material))
    }
    if scripts and _is_known(survey_scene(subject.scene, for_render=True), what):
        found |= {material for material in scripts if _fitted(material, what)}
    return found


def _is_known(report: LampReport, what: str) -> bool:
    """Whether a script's tables hold the light of lamps, or of the world."""
    return not report.inexact if what == SLOTS_KEY else bool(world_light_table(report)[0, 0, 3] > 0)


def _fitted(material: bpy.types.Material, what: str) -> bool:
    """Whether a script was built to sample lamps, or the world."""
    sampled = any(effect.name == SAMPLED_EFFECT and effect.kept for effect in effects_of(material))
    pictures = (node.bl_idname == "ShaderNodeTexEnvironment" for node in _nodes(material))
    return sampled and (what == SLOTS_KEY or any(pictures))


def _most_sampled(material: bpy.types.Material) -> int:
    """Lamps that it samples where there are as many."""
    return CAPACITY if any(map(leads_through, _nodes(material))) else ON_SHEET


def _nodes(material: bpy.types.Material) -> Iterator[bpy.types.Node]:
    return (node for tree in measured_trees(material) for node in tree.nodes)


def lamps(subject: Subject) -> Iterator[Finding]:
    """Lamps that neither kind of ray may meet."""
    worn = sheets(subject)
    shown = list(dict.fromkeys(obj for objects in worn.values() for obj in objects))
    # What samples all lamps itself needs no ray to meet them.
    sampling = {found for found in _sampling(subject, SLOTS_KEY) if len(subject.lamps) <= _most_sampled(found)}
    mirrors = [objects for material, objects in worn.items() if material not in sampling]
    aimed = list(dict.fromkeys(obj for objects in mirrors for obj in objects))
    for obj in subject.lamps if shown else ():
        where = f"lamp {obj.name}"
        if not obj.visible_camera and obj.visible_diffuse and _is_behind(obj, aimed, subject.scene):
            why = (
                "the camera's rays go on through a sheet at flat angles and do not meet it; behind a sheet seen at 60 "
                "degrees a lamp lost 37 % where it leant from the normal towards the viewer, and nothing where it "
                "leant away"
            )
            mend = setting(obj, "visible_camera", True)
            yield Finding("lamp_camera", WRONG, where, "Ray Visibility, Camera is off", "on", why, mend)
        if aimed and obj.visible_diffuse and not obj.visible_transmission:
            why = (
                "rays that are bent through a sheet are transmission rays and do not meet it; those that go on at flat "
                "angles do, and those of Cycles' own shaders"
            )
            mend = setting(obj, "visible_transmission", True)
            yield Finding("lamp_transmission", WRONG, where, "Ray Visibility, Transmission is off", "on", why, mend)


def world(subject: Subject) -> Iterator[Finding]:
    """The same of the world."""
    world = subject.scene.world
    if world is None or not sheets(subject) or not world.cycles_visibility.diffuse:
        return
    visibility, where = world.cycles_visibility, f"world {world.name}"
    if _sampling(subject, WORLD_KEY) == set(sheets(subject)):
        return  # which needs no ray to meet it
    if not visibility.camera:
        why = f"the camera's rays go on through a sheet at flat angles and do not meet it; {_LOST} were lost"
        mend = setting(visibility, "camera", True)
        yield Finding("world_camera", WRONG, where, "Ray Visibility, Camera is off", "on", why, mend)
    if not visibility.transmission:
        why = "its light comes through sheets at flat angles only, and by Cycles' own shaders"
        mend = setting(visibility, "transmission", True)
        yield Finding("world_transmission", WRONG, where, "Ray Visibility, Transmission is off", "on", why, mend)


def bounces(subject: Subject) -> Iterator[Finding]:
    """Both kinds of ray are counted, each by its own setting."""
    if not sheets(subject):
        return
    cycles, where = subject.scene.cycles, f"scene {subject.scene.name}"
    for name, label, counted in (
        ("transmission_bounces", "Transmission", "a ray bent through a sheet counts as one of transmission"),
        ("transparent_max_bounces", "Transparent", "a ray that goes through a sheet at a flat angle counts as one"),
    ):
        value = getattr(cycles, name)
        if value < _BOUNCES:
            why = f"{counted}; beyond them only lamps and the world are seen"
            found = f"Light Paths, {label} Bounces are {value}"
            yield Finding(name, WRONG, where, found, str(_BOUNCES), why, setting(cycles, name, _BOUNCES))
    if not cycles.caustics_refractive:
        why = "without it, rays that a diffuse surface has scattered pass a sheet by Cycles' own shaders only"
        mend = setting(cycles, "caustics_refractive", True)
        yield Finding("refractive_caustics", WRONG, where, "Refractive Caustics is off", "on", why, mend)


def film(subject: Subject) -> Iterator[Finding]:
    """What is cut out of the picture, through sheets too."""
    scene = subject.scene
    if not scene.render.film_transparent or not sheets(subject):
        return
    where = f"scene {scene.name}"
    # What a shader samples of the world is shown; the film's alpha lacks it all the same.
    sampled = _sampling(subject, WORLD_KEY) == set(sheets(subject))
    cut = "the alpha of the world" if sampled else "the world"
    why = f"{cut} behind a sheet is cut out where the camera's rays go on through it: {_LOST}"
    wanted = "off, or the world replaced by lamps and surfaces"
    yield Finding("film_transparent", WRONG, where, "Film, Transparent is on", wanted, why)
    if scene.cycles.film_transparent_glass:
        why = "all light of the world that a sheet's mirrors bring is cut out, as of clear glass"
        mend = setting(scene.cycles, "film_transparent_glass", False)
        yield Finding("transparent_glass", WRONG, where, "Film, Transparent Glass is on", "off", why, mend)


def shadow_catchers(subject: Subject) -> Iterator[Finding]:
    """What they catch, seen through a sheet."""
    names = [obj.name for obj in subject.objects if obj.type != "LIGHT" and obj.is_shadow_catcher]
    if names and sheets(subject):
        why = (
            "the camera's rays go on through a sheet at flat angles, where a shadow catcher behind it is cut out of "
            "the sheet's picture: of its alpha 26 % were lost at 60 degrees"
        )
        found = f"Shadow Catcher is on for {', '.join(names[:3])}" + (" and others" if len(names) > 3 else "")
        yield Finding("sheet_catcher", WRONG, f"scene {subject.scene.name}", found, "off where a sheet hides it", why)


def data_passes(subject: Subject) -> Iterator[Finding]:
    """Passes that a ray through a portal fills with what it meets behind the sheet: to Cycles that is transparent."""
    why = "where a ray goes on through a sheet at a flat angle they are of what lies behind it"
    for layer in subject.scene.view_layers if sheets(subject) else ():
        where = f"scene {subject.scene.name}, {layer.name}"
        if layer.use and layer.pass_alpha_threshold > 0 and (shown := _shown(layer, _DATA_PASSES)):
            found = f"{shown} with an Alpha Threshold of {layer.pass_alpha_threshold:.2g}"
            also = "; at 0 they are of what is seen first, also where that is as good as transparent"
            mend = setting(layer, "pass_alpha_threshold", 0.0)
            yield Finding("sheet_passes", NOTE, where, found, "0", f"{why}{also}", mend)
        if layer.use and (shown := _shown(layer, _CRYPTOMATTE)):
            yield Finding("sheet_cryptomatte", NOTE, where, shown, "", why)


def _shown(layer: bpy.types.ViewLayer, passes: dict[str, str]) -> str:
    """Which of these passes a view layer has, in words; empty if none."""
    names = [label for name, label in passes.items() if getattr(layer, name, False)]
    several = f"passes {', '.join(names[:3])}{' and others' * (len(names) > 3)}"
    return several if len(names) > 1 else "".join(f"pass {name}" for name in names)


def _is_behind(lamp: bpy.types.Object, shown: list[bpy.types.Object], scene: bpy.types.Scene) -> bool:
    """Whether a face of these objects lies between lamp and camera, one on each side of it, whatever hides it."""
    camera = scene.camera
    if camera is None:
        return True
    viewer = _place(camera, camera.data.type == "ORTHO")
    light = _place(lamp, lamp.data.type == "SUN")
    for obj in shown:
        faces = _faces(obj, scene)
        if faces is None or scene.objects.get(obj.name) != obj:  # nobody knows
            return True
        points, normals = faces
        sides = [(normals * (place[:3] - points * place[3])).sum(-1) for place in (viewer, light)]
        if (sides[0] * sides[1] < 0).any():
            return True
    return False


def _place(obj: bpy.types.Object, far: bool) -> Array:
    """Homogeneous coordinates (4,): of a place, or of the direction that a camera or a sun is seen in from far away."""
    matrix = np.array(obj.matrix_world)
    return np.append(matrix[:3, 2], 0.0) if far else np.append(matrix[:3, 3], 1.0)


def _faces(obj: bpy.types.Object, scene: bpy.types.Scene) -> tuple[Array, Array] | None:
    """Middles and normals (n, 3) of a mesh's faces as modifiers leave them, in the world; None where a render may show
    others, or none are there, as of curves and of what geometry nodes instance."""
    if obj.type != "MESH" or any(modifier.show_render != modifier.show_viewport for modifier in obj.modifiers):
        return None
    layer = next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])
    shown = obj.evaluated_get(layer.depsgraph)
    if obj.modifiers and not shown.is_evaluated:  # the layer does not show it
        return None
    polygons = shown.data.polygons
    if not polygons:
        return None
    points, normals = (np.empty(3 * len(polygons), np.float32) for _ in range(2))
    polygons.foreach_get("center", points)
    polygons.foreach_get("normal", normals)
    step = max(1, len(polygons) // _FACES)
    matrix = np.array(obj.matrix_world)
    turned = normals.reshape(-1, 3)[::step] @ np.linalg.pinv(matrix[:3, :3])
    return points.reshape(-1, 3)[::step] @ matrix[:3, :3].T + matrix[:3, 3], turned


RULES = (lamps, world, bounces, film, shadow_catchers, data_passes)
