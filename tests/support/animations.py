"""Animations of a plate before a camera, by everything that moves, zooms or scales it."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from measured_materials.addon.material import texel_footprint as footprint
from measured_materials.addon.material.texel_footprint import texel_footprint
from measured_materials.nodes import compat


class View:
    """A camera of 90 degrees, 100 pixels across, 50 units above a square of 2 units whose UVs are 0 to 1."""

    def __init__(self) -> None:
        self.scene = bpy.data.scenes.new("view")
        self.scene.render.resolution_x = self.scene.render.resolution_y = 100
        mesh = bpy.data.meshes.new("plate")
        mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
        mesh.uv_layers.new().uv.foreach_set("vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
        self.material = bpy.data.materials.new("swatch")
        compat.node_tree(self.material)
        mesh.materials.append(self.material)
        self.plate = self.add("plate", mesh)
        self.camera = self.add("camera", bpy.data.cameras.new("camera"))
        self.camera.data.angle = math.pi / 2
        self.camera.matrix_world = Matrix.Translation((0, 0, 50))
        self.scene.camera = self.camera

    def add(self, name: str, data: Any = None) -> Any:
        obj = bpy.data.objects.new(name, data)
        self.scene.collection.objects.link(obj)
        return obj

    def footprint(self) -> footprint.Footprint:
        return texel_footprint(self.material, self.scene, (10, 10))


def keyed(block: Any, path: str, first: Any, last: Any, index: int = -1) -> None:
    """Two keys, at frames 1 and 20; the scene then stands at the first."""
    owner, _, name = path.rpartition(".")
    target = block.path_resolve(owner) if owner else block
    for frame, value in ((1, first), (20, last)):
        if index < 0:
            setattr(target, name, value)
        else:
            getattr(target, name)[index] = value
        block.keyframe_insert(path, index=index, frame=frame)


def nearer(block: Any) -> None:
    keyed(block, "location", 0.0, 40.0, 2)


def in_the_nla(block: Any) -> None:
    """The action of an animated datablock becomes a strip, and there is no active action."""
    data = block.animation_data
    action, slot = data.action, getattr(data, "action_slot", None)
    data.action = None
    strip = data.nla_tracks.new().strips.new("strip", 1, action)
    if slot is not None:
        strip.action_slot = slot


def by_nla(view: View) -> None:
    nearer(view.plate)
    in_the_nla(view.plate)


def by_driver(view: View) -> None:
    view.plate.driver_add("location", 2).driver.expression = "2 * frame"


def by_lens(view: View) -> None:
    keyed(view.camera.data, "lens", 18.0, 90.0)


def by_lens_in_the_nla(view: View) -> None:
    by_lens(view)
    in_the_nla(view.camera.data)


def by_ortho_scale(view: View) -> None:
    view.camera.data.type = "ORTHO"
    keyed(view.camera.data, "ortho_scale", 100.0, 5.0)


def by_sensor(view: View) -> None:
    keyed(view.camera.data, "sensor_width", 36.0, 3.0)


def by_parent(view: View) -> None:
    parents = [view.add(name) for name in ("child", "grandparent")]
    view.plate.parent, parents[0].parent = parents
    nearer(parents[1])
    in_the_nla(parents[1])


def by_parent_of_the_camera(view: View) -> None:
    view.camera.parent = view.add("crane")
    keyed(view.camera.parent, "location", 0.0, -40.0, 2)


def by_constraint(view: View) -> None:
    target = view.add("target")
    view.plate.constraints.new("COPY_LOCATION").target = target
    nearer(target)


def by_bone(view: View) -> None:
    """Parented to a bone that a constraint moves."""
    rig = view.add("rig", bpy.data.armatures.new("rig"))
    previous = bpy.context.window.scene
    bpy.context.window.scene = view.scene
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("bone")
    bone.tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.window.scene = previous
    target = view.add("target")
    rig.pose.bones[0].constraints.new("COPY_LOCATION").target = target
    view.plate.parent, view.plate.parent_type, view.plate.parent_bone = rig, "BONE", "bone"
    nearer(target)


def instanced(view: View) -> Any:
    """The plate in a collection of its own, shown by an empty only; returns the empty."""
    collection = bpy.data.collections.new("kept apart")
    collection.objects.link(view.plate)
    view.scene.collection.objects.unlink(view.plate)
    empty = view.add("instancer")
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    return empty


def by_instancer(view: View) -> None:
    nearer(instanced(view))


def by_parent_of_the_instancer(view: View) -> None:
    empty = instanced(view)
    empty.parent = view.add("carrier")
    nearer(empty.parent)


def by_nested_instancer(view: View) -> None:
    inner = instanced(view)
    nearer(inner)
    collection = bpy.data.collections.new("outer")
    collection.objects.link(inner)
    view.scene.collection.objects.unlink(inner)
    outer = view.add("outer")
    outer.instance_type, outer.instance_collection = "COLLECTION", collection


def by_vertices(view: View) -> None:
    """Instanced on the vertices of a parent, which moves."""
    mesh = bpy.data.meshes.new("points")
    mesh.from_pydata([(0, 0, 0)], [], [])
    points = view.add("points", mesh)
    points.instance_type, view.plate.parent = "VERTS", points
    nearer(points)


def by_scale(view: View) -> None:
    keyed(view.plate, "scale", 1.0, 9.0, 0)


def by_shape_key(view: View) -> None:
    view.plate.shape_key_add(name="Basis")
    key = view.plate.shape_key_add(name="large")
    for point in key.data:
        point.co *= 20
    keyed(view.plate.data.shape_keys, 'key_blocks["large"].value', 0.0, 1.0)


def by_mesh(view: View) -> None:
    """Vertices keyed one by one."""
    for vertex in view.plate.data.vertices:
        index = vertex.index
        keyed(view.plate.data, f"vertices[{index}].co", vertex.co[0], 20 * vertex.co[0], 0)


def by_hook(view: View) -> None:
    hook = view.add("hook")
    modifier = view.plate.modifiers.new("hook", "HOOK")
    modifier.object = hook
    modifier.vertex_indices_set([0, 1, 2, 3])
    nearer(hook)


def by_lattice(view: View) -> None:
    lattice = view.add("lattice", bpy.data.lattices.new("lattice"))
    lattice.scale = (3, 3, 3)
    view.plate.modifiers.new("lattice", "LATTICE").object = lattice
    lattice.shape_key_add(name="Basis")
    for point in lattice.shape_key_add(name="large").data:
        point.co *= 20
    keyed(lattice.data.shape_keys, 'key_blocks["large"].value', 0.0, 1.0)


def by_texture(view: View) -> None:
    texture = bpy.data.textures.new("blend", "BLEND")
    modifier = view.plate.modifiers.new("displace", "DISPLACE")
    modifier.texture, modifier.strength, modifier.mid_level = texture, 40.0, 0.0
    keyed(texture, "intensity", 0.1, 2.0)


def by_wave(view: View) -> None:
    wave = view.plate.modifiers.new("wave", "WAVE")
    wave.height, wave.width, wave.narrowness = 30.0, 4.0, 0.5


def by_modifier(view: View) -> None:
    view.plate.modifiers.new("displace", "DISPLACE").mid_level = 0.0
    keyed(view.plate, 'modifiers["displace"].strength', 0.0, 40.0)


def by_geometry_nodes(view: View, animate: bool = True) -> Any:
    """A group that scales the geometry, by the clock."""
    tree = bpy.data.node_groups.new("grow", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeTransform", "NodeGroupOutput")
    source, scale, sink = (tree.nodes.new(kind) for kind in kinds)
    tree.links.new(source.outputs[0], scale.inputs[0])
    tree.links.new(scale.outputs[0], sink.inputs[0])
    if animate:
        clock = tree.nodes.new("GeometryNodeInputSceneTime")
        tree.links.new(clock.outputs["Frame"], scale.inputs["Scale"])
    view.plate.modifiers.new("grow", "NODES").node_group = tree
    return tree


def by_keyed_geometry_nodes(view: View) -> None:
    tree = by_geometry_nodes(view, animate=False)
    scale = next(n for n in tree.nodes if n.bl_idname == "GeometryNodeTransform")
    index = scale.inputs.find("Scale")  # one further since 5.0, where Mode is an input
    keyed(tree, f'nodes["{scale.name}"].inputs[{index}].default_value', 1.0, 20.0, 0)


def by_hiding(view: View) -> None:
    """A copy close to the camera, hidden in the first frames."""
    copy = view.plate.copy()
    copy.location = (0, 0, 45)
    view.scene.collection.objects.link(copy)
    for name in ("hide_render", "hide_viewport"):
        keyed(copy, name, True, False)


def by_a_still_percentage(view: View) -> None:
    """Fitted at a preview's size; the picture is rendered at the whole one."""
    view.scene.render.resolution_percentage = 5


def by_marker(view: View) -> None:
    close = view.add("close", bpy.data.cameras.new("close"))
    close.matrix_world = Matrix.Translation((0, 0, 4))
    view.scene.timeline_markers.new("cut", frame=10).camera = close
    view.scene.timeline_markers.new("first", frame=1).camera = view.camera


def by_mapping(view: View) -> None:
    """The material's nodes: how large the swatch is laid out."""
    node = view.material.node_tree.nodes.new("ShaderNodeMapping")
    keyed(view.material.node_tree, f'nodes["{node.name}"].inputs["Scale"].default_value', 1.0, 0.1, 0)


def by_particles(view: View) -> None:
    view.plate.modifiers.new("particles", "PARTICLE_SYSTEM")


def by_cloth(view: View) -> None:
    view.plate.modifiers.new("cloth", "CLOTH")


def by_rigid_body(view: View) -> None:
    with bpy.context.temp_override(scene=view.scene, view_layer=view.scene.view_layers[0], object=view.plate):
        bpy.ops.rigidbody.world_add()
        bpy.ops.rigidbody.object_add()
    assert view.plate.rigid_body


ANIMATIONS = [value for name, value in list(globals().items()) if name.startswith("by_")]
# What the footprint's own arithmetic does not follow.
UNFOLLOWED = {"by_mapping", "by_particles", "by_cloth", "by_rigid_body", "by_a_still_percentage"}
