"""Whether anything in another frame moves, zooms or scales a datablock, or gives it another value.

What may change counts as changing: a curve with one key, a constraint whose target stands still. Whoever asks leaves
something out where nothing changes: a change that is not seen costs the picture, one too many only time.
"""

from __future__ import annotations

from collections.abc import Container, Iterator

import bpy

from ..nodes import compat
from ..nodes.group import trees_below

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
    return _changes(block, set())


def _changes(block: bpy.types.ID | None, seen: set[bpy.types.ID]) -> bool:
    if block is None or block in seen:
        return False
    seen.add(block)
    if isinstance(block, bpy.types.Scene):
        cameras = {marker.camera for marker in block.timeline_markers if marker.camera is not None}
        return bool(cameras - {block.camera})
    if any(True for _ in _animated_paths(block)):
        return True
    if isinstance(block, bpy.types.Object):
        return _object_changes(block, seen)
    if isinstance(block, bpy.types.Collection):
        return any(_changes(obj, seen) for obj in block.all_objects)
    if isinstance(block, bpy.types.Image):
        return block.source in ("MOVIE", "SEQUENCE")
    tree = block if isinstance(block, bpy.types.NodeTree) else getattr(block, "node_tree", None)
    if tree is not None and any(_tree_changes(below, seen) for below in (tree, *trees_below(tree))):
        return True
    return any(_changes(other, seen) for other in _pointed_at(block))


def _object_changes(obj: bpy.types.Object, seen: set[bpy.types.ID]) -> bool:
    if obj.constraints or obj.rigid_body or obj.rigid_body_constraint or obj.particle_systems or obj.soft_body:
        return True
    if obj.pose and any(bone.constraints for bone in obj.pose.bones):
        return True
    if any(_modifier_changes(modifier, seen) for modifier in obj.modifiers):
        return True
    if obj.type == "META":  # one surface of all of a name
        family = obj.name.split(".")[0]
        if any(_changes(o, seen) for o in bpy.data.objects if o.type == "META" and o.name.split(".")[0] == family):
            return True
    instanced = obj.instance_collection if obj.instance_type == "COLLECTION" else None
    return any(_changes(block, seen) for block in (obj.parent, obj.data, instanced))


def _modifier_changes(modifier: bpy.types.Modifier, seen: set[bpy.types.ID]) -> bool:
    """The clock's, or those that follow another datablock."""
    return modifier.type in _TIMED or any(_changes(block, seen) for block in _pointed_at(modifier))


def _tree_changes(tree: bpy.types.NodeTree, seen: set[bpy.types.ID]) -> bool:
    if any(True for _ in _animated_paths(tree)):
        return True
    for node in tree.nodes:
        if node.bl_idname in _TIMED_NODES or _changes(getattr(node, "image", None), seen):
            return True
    return False


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
