"""Whether anything in another frame moves, zooms or scales a datablock, or gives it another value.

What may change counts as changing: a curve with one key, a constraint whose target stands still. Whoever asks leaves
something out where nothing changes: a change that is not seen costs the picture, one too many only time.
"""

from __future__ import annotations

from collections.abc import Container, Iterator

import bpy

from ...nodes import compat
from ...nodes.lens_group import LENS_KEY

# Modifiers that have a clock of their own.
_TIMED = frozenset({
    "BUILD", "CLOTH", "COLLISION", "DYNAMIC_PAINT", "EXPLODE", "FLUID", "MESH_CACHE", "MESH_SEQUENCE_CACHE", "OCEAN",
    "PARTICLE_INSTANCE", "PARTICLE_SYSTEM", "SOFT_BODY", "SURFACE", "WAVE",
})  # fmt: skip
# Nodes of geometry that read the clock, the camera, files, or an object that only a socket names.
_TIMED_NODES = frozenset({
    "GeometryNodeBake", "GeometryNodeCameraInfo", "GeometryNodeCollectionInfo", "GeometryNodeImportCSV",
    "GeometryNodeImportOBJ", "GeometryNodeImportPLY", "GeometryNodeImportSTL", "GeometryNodeImportText",
    "GeometryNodeImportVDB", "GeometryNodeInputActiveCamera", "GeometryNodeInputCollection",
    "GeometryNodeInputObject", "GeometryNodeInputSceneTime", "GeometryNodeObjectInfo", "GeometryNodeSelfObject",
    "GeometryNodeSimulationOutput",
})  # fmt: skip
_PLACELESS = (bpy.types.Material, bpy.types.Scene)


def changes(block: bpy.types.ID | None, properties: Container[str] = ()) -> bool:
    """Whether a datablock may be another in another frame.

    Parameters
    ----------
    block : an object changes with all that its place, size and shape hang on: parents, constraints, physics, modifiers,
        shape keys, the collection that it instances; a scene with the camera that it looks through, as Blender animates
        no resolution; a camera, lamp, world or mesh with its own settings and nodes
    properties : only curves and drivers of these properties of the datablock itself count, as in `F-curve.data_path`;
        by default everything does
    """
    if properties:
        return any(path in properties for path in _animated_paths(block))
    seen: set[bpy.types.ID] = set()
    pending = [block]  # no recursion: chains of parents are longer than Python allows
    while pending:
        here = pending.pop()
        if here is None or here in seen:
            continue
        if _changes_itself(here):
            return True
        seen.add(here)
        pending += _hangs_on(here)
    return False


def _changes_itself(block: bpy.types.ID) -> bool:
    if isinstance(block, bpy.types.Scene):
        cameras = {marker.camera for marker in block.timeline_markers if marker.camera is not None}
        return bool(cameras - {block.camera})
    # Materials follow the camera by drivers, for the numbers that they draw directions by: the picture stays.
    if LENS_KEY not in block and any(True for _ in _animated_paths(block)):
        return True
    if isinstance(block, bpy.types.Image):
        return block.source in ("MOVIE", "SEQUENCE")
    if isinstance(block, bpy.types.NodeTree):
        return any(node.bl_idname in _TIMED_NODES for node in block.nodes)
    if not isinstance(block, bpy.types.Object):
        return False
    if block.constraints or block.rigid_body or block.rigid_body_constraint or block.particle_systems:
        return True
    bones = block.pose.bones if block.pose else ()
    clocks = any(modifier.type in _TIMED for modifier in block.modifiers)
    return clocks or block.soft_body is not None or any(bone.constraints for bone in bones)


def _hangs_on(block: bpy.types.ID) -> Iterator[bpy.types.ID | None]:
    """What a datablock changes with."""
    if isinstance(block, bpy.types.Object):
        yield from (block.parent, block.data)
        if block.instance_type == "COLLECTION":
            yield block.instance_collection
        for modifier in block.modifiers:
            yield from _pointed_at(modifier)
        if block.type == "META":  # one surface of all of a name
            family = block.name.split(".")[0]
            yield from (o for o in bpy.data.objects if o.type == "META" and o.name.split(".")[0] == family)
    elif isinstance(block, bpy.types.Collection):
        yield from block.all_objects
    elif not isinstance(block, (bpy.types.Scene, bpy.types.Image)):
        yield from _pointed_at(block)
    if isinstance(block, bpy.types.NodeTree):
        for node in block.nodes:
            yield from (getattr(node, "node_tree", None), getattr(node, "image", None))


def _pointed_at(owner: bpy.types.bpy_struct) -> Iterator[bpy.types.ID]:
    """Datablocks that properties of this one name, but for materials, which have no place."""
    for name, prop in owner.bl_rna.properties.items():
        if prop.type == "POINTER" and name not in ("rna_type", "original", "id_data", "library", "override_library"):
            value = getattr(owner, name, None)
            if isinstance(value, bpy.types.ID) and not isinstance(value, _PLACELESS):
                yield value


def _animated_paths(block: bpy.types.ID | None) -> Iterator[str]:
    """Properties with an F-curve, of the action or of the NLA's strips, or with a driver."""
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return
    yield from (curve.data_path for curve in animation.drivers)
    for owner in (animation, *_strips(animation)):
        if owner.action is not None:
            slot = getattr(owner, "action_slot", None)  # since 4.4
            yield from (curve.data_path for curve in compat.curves_of(owner.action, slot))
    if getattr(animation, "action_tweak_storage", None) is not None:  # set aside while a strip is edited
        yield from (curve.data_path for curve in compat.curves_of(animation.action_tweak_storage))


def _strips(animation: bpy.types.AnimData) -> Iterator[bpy.types.NlaStrip]:
    """Of all tracks, those within meta strips too."""
    pending = [strip for track in animation.nla_tracks for strip in track.strips]
    while pending:
        strip = pending.pop()
        yield strip
        pending += strip.strips
