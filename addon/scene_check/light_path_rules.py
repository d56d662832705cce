"""Scene check: light that differs by kind of ray through nodes, and what Cycles does to rays within a volume."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ...nodes import compat
from ...nodes.group import trees_below
from ..lights.exact_lamps import has_volume
from .findings import WRONG, Finding, Subject, setting
from .light_node_rules import emission_outputs, volume_outputs

# Native closures sample light by rays of no kind, and the mirror by reflected ones. Of the outputs not named here,
# those of camera, shadow, transmission and volume rays, of lengths and of refractions say the same for both.
_KINDS = frozenset({"Is Diffuse Ray", "Is Glossy Ray", "Is Singular Ray", "Is Reflection Ray"})
_BOUNCES = frozenset({"Diffuse Depth", "Glossy Depth"})
# A ray that ends in the world or in a lamp counts one bounce more than one that is aimed there.
_TELLING = {
    "world": _KINDS | _BOUNCES | {"Ray Depth"},
    "lamp": _BOUNCES | {"Ray Depth"},
    "emission": _KINDS | _BOUNCES,
    # What dims light on its way knows the rays that sample it, too.
    "volume": _KINDS | _BOUNCES | {"Is Shadow Ray"},
}
# What lies on the way to a light is passed by the rays of the mirror, and not where light is sampled.
_PASSED = "Transparent Depth"
# Cycles' largest, and above any number of bounces.
_ALL_BOUNCES = 1024


def light_paths(subject: Subject) -> Iterator[Finding]:
    """Studios light by kind of ray; a measured material is two kinds at once."""
    scene = subject.scene
    if scene.world is not None and compat.uses_nodes(scene.world):
        yield from _told(subject, "world", f"world {scene.world.name}", scene.world.node_tree)
        yield from _dimmed(f"world {scene.world.name}", scene.world.node_tree)
    for data in dict.fromkeys(obj.data for obj in subject.lamps):
        if compat.uses_nodes(data):
            yield from _told(subject, "lamp", f"lamp {data.name}", data.node_tree)
    for material in subject.materials:
        if compat.uses_nodes(material):
            yield from _told(subject, "emission", f"material {material.name}", material.node_tree)
            yield from _dimmed(f"material {material.name}", material.node_tree)


_WHY = {
    "world": "a world black for glossy rays took 64 % of a paint's light in mode Exact and 79 % in Reference",
    "lamp": "a lamp black beyond no glossy bounce gave a paint 37 % less in mode Exact and nothing in Reference",
    "emission": "an emitter black for glossy rays took 34 % of a paint's light in mode Exact and 90 % in Reference",
}


def _told(subject: Subject, kind: str, where: str, tree: bpy.types.NodeTree) -> Iterator[Finding]:
    outputs = emission_outputs(tree)
    telling = sorted(outputs & _TELLING[kind])
    if _PASSED in outputs and any(_may_be_transparent(material) for material in subject.materials):
        telling.append(_PASSED)
    if telling:
        found = f"Light Path, {', '.join(telling)} changes its light by kind of ray"
        why = f"Cycles' own shaders and the mirror see it as different rays do; {_WHY[kind]}"
        yield Finding(f"{kind}_light_path", WRONG, where, found, "the same light for all but camera rays", why)


def _dimmed(where: str, tree: bpy.types.NodeTree) -> Iterator[Finding]:
    """A volume that lets pass, scatters or emits otherwise by kind of ray."""
    if telling := sorted(volume_outputs(tree) & _TELLING["volume"]):
        found = f"Light Path, {', '.join(telling)} changes its volume by kind of ray"
        why = "light of Cycles' own shaders is dimmed as shadow rays are, that of the mirror as reflected ones"
        yield Finding("volume_light_path", WRONG, where, found, "the same volume for all but camera rays", why)


def _may_be_transparent(material: bpy.types.Material) -> bool:
    """Whether rays may pass its surface as they are."""
    nodes = (node for tree in trees_below(material.node_tree) for node in tree.nodes) if material.node_tree else ()
    for node in nodes:
        alpha = node.inputs.get("Alpha") if node.bl_idname == "ShaderNodeBsdfPrincipled" else None
        if node.bl_idname == "ShaderNodeBsdfTransparent" or (alpha and (alpha.is_linked or alpha.default_value < 1)):
            return True
    return False


def volumes(subject: Subject) -> Iterator[Finding]:
    """Cycles ends paths at random (Russian roulette), and within a volume does not make up for lamps they would meet.

    Lit meshes are made up for, and light that native closures sample needs no such luck.
    """
    cycles = subject.scene.cycles
    volume = _volume(subject)
    if volume and subject.lamps and cycles.min_light_bounces < cycles.max_bounces:
        why = (
            "in any volume, however thin, rays that are to meet a lamp are lost after the first bounce; "
            "a room of matte material lost 13 % in mode Reference, one of paint 4 % in Exact"
        )
        found = f"Light Paths, Min Light Bounces are {cycles.min_light_bounces}, with {volume}"
        mend = setting(cycles, "min_light_bounces", _ALL_BOUNCES)
        where = f"scene {subject.scene.name}"
        yield Finding("volume_roulette", WRONG, where, found, str(_ALL_BOUNCES), why, mend)


def _volume(subject: Subject) -> str:
    """The first volume that a render meets, in words; empty where there is none."""
    world = subject.scene.world
    if world is not None and compat.uses_nodes(world) and has_volume(world.node_tree):
        return f"a volume in world {world.name}"
    for material in subject.materials:
        if compat.uses_nodes(material) and has_volume(material.node_tree):
            return f"a volume in material {material.name}"
    return next((f"volume {obj.name}" for obj in subject.objects if obj.type == "VOLUME"), "")


RULES = (light_paths, volumes)
