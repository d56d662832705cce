"""Scenes of unbiased.py: every kind of lamp, and what may come between a lamp and a measured surface.

A case builds a scene seen from straight above, and gives a function that puts materials on what is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy
from common import empty_scene, ours
from mathutils import Matrix, Vector

EDGE = 40
Materials = dict[str, bpy.types.Material]
Dress = Callable[[Materials], None]
_PLACE = Vector((1.6, -1.2, 2.6))


@dataclass(frozen=True)
class Case:
    """How a scene is built, and samples of a pixel and seed.

    Attributes
    ----------
    brightest : pixels around those that are brighter than so many times the median are left out: they show a lamp
    moving : with motion blur, a whole frame long
    later : what happens once the materials are built, so that they cannot sample what they were built for
    swatch : the bundle of the one material of photographs, called "swatch"; without, the materials are of the formulas
    """

    build: Callable[[bpy.types.Scene], Dress]
    samples: int = 64
    brightest: float = math.inf
    moving: bool = False
    later: Callable[[bpy.types.Scene], None] | None = None
    swatch: str = ""


# --- things ------------------------------------------------------------------------------------------------


def link(scene: bpy.types.Scene, data: bpy.types.ID, matrix: Matrix | None = None) -> bpy.types.Object:
    """An object of the scene."""
    obj = bpy.data.objects.new(data.name if data else "empty", data)
    scene.collection.objects.link(obj)
    obj.matrix_world = matrix or Matrix.Identity(4)
    return obj


def ball(scene: bpy.types.Scene, place: Any = (0, 0, 0), scale: Any = (1, 1, 1)) -> bpy.types.Object:
    """A fine sphere; facets of a coarse one shade each other where a native closure is told not to look."""
    mesh = ours("addon.studio.studio_meshes").sphere_mesh(128, 64)
    mesh.materials.append(None)
    obj = link(scene, mesh, Matrix.LocRotScale(Vector(place), None, Vector(scale)))
    obj.shadow_terminator_geometry_offset = obj.shadow_terminator_shading_offset = 0
    return obj


def plane(scene: bpy.types.Scene, size: float, place: Any, facing: Any = (0, 0, 1)) -> bpy.types.Object:
    """A square that the camera does not see, grey without a material."""
    mesh = bpy.data.meshes.new("plane")
    corners = [(x * size / 2, y * size / 2, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(None)
    turn = Vector(facing).to_track_quat("Z", "Y").to_matrix().to_4x4()
    obj = link(scene, mesh, Matrix.Translation(place) @ turn)
    obj.visible_camera = False
    return obj


def add_lamp(scene: bpy.types.Scene, kind: str, place: Any = _PLACE, **settings: Any) -> bpy.types.Object:
    """A lamp that looks at the origin."""
    data = bpy.data.lights.new(kind, kind)
    for name, value in settings.items():
        setattr(data, name, value)
    turn = (-Vector(place)).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    return link(scene, data, Matrix.Translation(place) @ turn)


def sky(scene: bpy.types.Scene, strength: float) -> None:
    """The same from everywhere."""
    scene.world, background = ours("nodes.compat").new_world("sky")
    background.inputs["Color"].default_value = (0.8, 0.9, 1, 1)
    background.inputs["Strength"].default_value = strength


def card_before(scene: bpy.types.Scene, place: Any = _PLACE, size: float = 0.45) -> bpy.types.Object:
    """Half way to a lamp, and in the way of about a third of its light."""
    middle = Vector(place) * 0.6 + Vector((0.25, 0.1, 0))
    return plane(scene, size, middle, place)


def on(*objects: bpy.types.Object, name: str = "paint") -> Dress:
    """Puts one of the materials on objects."""

    def dress(materials: Materials) -> None:
        for obj in objects:
            obj.data.materials[0] = materials[name]

    return dress


def measured_node(material: bpy.types.Material) -> bpy.types.Node:
    """The node of the measured group."""
    return next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeGroup")


def bump(material: bpy.types.Material) -> None:
    """Lean all normals by a Normal Map, and lay a Bump of noise on top."""
    tree = material.node_tree
    where, noise = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeTexNoise")
    lean, bumps = tree.nodes.new("ShaderNodeNormalMap"), tree.nodes.new("ShaderNodeBump")
    noise.inputs["Scale"].default_value, bumps.inputs["Strength"].default_value = 3.0, 0.3
    lean.inputs["Color"].default_value = (0.6, 0.45, 0.95, 1)
    tree.links.new(where.outputs["Object"], noise.inputs["Vector"])
    tree.links.new(noise.outputs[0], bumps.inputs["Height"])
    tree.links.new(lean.outputs["Normal"], bumps.inputs["Normal"])
    tree.links.new(bumps.outputs["Normal"], measured_node(material).inputs["Normal"])


# --- cases -------------------------------------------------------------------------------------------------


def lit_by(kind: str, **settings: Any) -> Callable[[bpy.types.Scene], Dress]:
    """A ball under one lamp, a card half way to it."""

    def build(scene: bpy.types.Scene) -> Dress:
        add_lamp(scene, kind, **settings)
        card_before(scene)
        return on(ball(scene))

    return build


def in_frame(scene: bpy.types.Scene) -> Dress:
    """The camera sees a lamp before the ball, and one beside it."""
    for place in ((0.3, 0.25, 2.4), (-1.0, -0.95, 1.1)):
        lamp = add_lamp(scene, "POINT", place, energy=20, shadow_soft_size=0.12)
        lamp.visible_camera = True
    return on(ball(scene))


def three_lamps(scene: bpy.types.Scene) -> Dress:
    """Of three kinds and colours, under a faint sky, above ground that reflects."""
    add_lamp(scene, "AREA", energy=60, size=0.6, color=(1, 0.7, 0.5))
    add_lamp(scene, "SUN", (-2, 1, 2), energy=1, angle=0.1, color=(0.5, 0.7, 1))
    add_lamp(scene, "SPOT", (0.5, 2, 2), energy=80, shadow_soft_size=0.2, spot_size=0.8, spot_blend=0.5)
    sky(scene, 0.06)
    plane(scene, 6, (0, 0, -1))
    card_before(scene)
    return on(ball(scene))


def moving_lamp(scene: bpy.types.Scene) -> Dress:
    """By 1 m a frame, ever faster: where it is in the middle is not half way."""
    lamp = add_lamp(scene, "AREA", energy=60, size=0.5)
    for frame, x in ((0, 2.0), (1, 1.6), (2, 0.2)):
        lamp.location.x = x
        lamp.keyframe_insert("location", frame=frame)
    card_before(scene)
    return on(ball(scene))


def moving_things(scene: bpy.types.Scene) -> Dress:
    """The ball, and what shades it."""
    add_lamp(scene, "AREA", energy=60, size=0.5)
    things = card_before(scene), ball(scene)
    for obj, way in zip(things, (Vector((0.3, 0.2, 0)), Vector((-0.2, 0.1, 0.2)))):
        for frame in (0, 2):
            obj.location += way * (frame - 1)
            obj.keyframe_insert("location", frame=frame)
            obj.location -= way * (frame - 1)
    return on(things[1])


def mirrored(scene: bpy.types.Scene) -> Dress:
    """A ball turned inside out along x and stretched, and two instances of a collection, one of them mirrored."""
    add_lamp(scene, "AREA", energy=80, size=0.6)
    first = ball(scene, (-0.45, 0.45, 0), (-0.5, 0.35, 0.5))
    second = ball(scene, (0, 0, 0), (0.4, 0.4, 0.4))
    held = bpy.data.collections.new("held")
    scene.collection.objects.unlink(second)
    held.objects.link(second)
    for place, scale in (((0.45, 0.45, 0), (1, -1.2, 1)), ((0.1, -0.45, 0), (1.2, 1, 0.8))):
        shown = link(scene, None, Matrix.LocRotScale(Vector(place), None, Vector(scale)))
        shown.instance_type, shown.instance_collection = "COLLECTION", held
    card_before(scene)
    return on(first, second)


def two_measured(scene: bpy.types.Scene) -> Dress:
    """A ball of metal in a corner of paint: each is lit by the other, and shades it."""
    add_lamp(scene, "AREA", (0.8, -1.2, 2.6), energy=90, size=0.6)
    walls = [plane(scene, 3, (0, 0, -0.7)), plane(scene, 3, (-0.75, 0, 0), (1, 0, 0))]
    for wall in walls:
        wall.visible_camera = True
    inner = ball(scene, (0, 0, -0.1), (0.6, 0.6, 0.6))

    def dress(materials: Materials) -> None:
        on(*walls)(materials)
        on(inner, name="metal")(materials)

    return dress


def mixed(scene: bpy.types.Scene) -> Dress:
    """A Mix Shader of two measured materials, by a pattern, under a wide lamp and a sky.

    Where Cycles has more than one material's closures to choose from, what a mirror brings of a lamp and what is taken
    off for it no longer cancel: under small lamps far more samples are needed.
    """
    add_lamp(scene, "AREA", energy=60, size=2.5)
    sky(scene, 0.3)
    card_before(scene)
    obj = ball(scene)

    def dress(materials: Materials) -> None:
        material, other = materials["paint"], measured_node(materials["metal"])
        tree, node = material.node_tree, measured_node(material)
        beside = tree.nodes.new("ShaderNodeGroup")
        beside.node_tree = other.node_tree
        beside.inputs["Tint"].default_value = (1, 1, 1, 1)
        tree.links.new(node.inputs["Normal"].links[0].from_socket, beside.inputs["Normal"])
        mix = tree.nodes.new("ShaderNodeMixShader")
        where, noise = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeTexNoise")
        noise.inputs["Scale"].default_value = 1.5
        tree.links.new(where.outputs["Object"], noise.inputs["Vector"])
        tree.links.new(noise.outputs[0], mix.inputs[0])
        surface = node.outputs["BSDF"].links[0].to_socket
        for source, target in ((node, mix.inputs[1]), (beside, mix.inputs[2])):
            tree.links.new(source.outputs["BSDF"], target)
        tree.links.new(mix.outputs[0], surface)
        on(obj)(materials)

    return dress


def bumpy(scene: bpy.types.Scene) -> Dress:
    """A Normal Map leans all normals, and a Bump of noise comes on top."""
    add_lamp(scene, "AREA", energy=80, size=0.6)
    card_before(scene)
    obj = ball(scene)

    def dress(materials: Materials) -> None:
        bump(materials["paint"])
        on(obj)(materials)

    return dress


def out_of_focus(scene: bpy.types.Scene) -> Dress:
    """A lens as wide as a quarter of the ball."""
    add_lamp(scene, "AREA", energy=80, size=0.6)
    card_before(scene)
    lens = scene.camera.data
    lens.dof.use_dof, lens.dof.focus_distance, lens.dof.aperture_fstop = True, 5.6, lens.lens / 1000 / (2 * 0.25)
    return on(ball(scene))


def swatch_on_a_ball(scene: bpy.types.Scene) -> Dress:
    """Photographs of a rough canvas under two lamps and a sky, above ground that reflects."""
    add_lamp(scene, "AREA", energy=80, size=0.6)
    add_lamp(scene, "SUN", (-2, 1, 2), energy=1, angle=0.1, color=(0.5, 0.7, 1))
    sky(scene, 0.06)
    plane(scene, 6, (0, 0, -1))
    card_before(scene)
    return on(ball(scene), name="swatch")


def against_the_light(scene: bpy.types.Scene) -> Dress:
    """A swatch that lets light through, leant, between a lamp behind it, half hidden by a card, and one before it."""
    behind = Vector((0.8, -0.6, -2.6))
    add_lamp(
        scene, "AREA", behind, energy=80, size=0.6
    ).visible_camera = True  # for the mirror, whose rays it hides from
    plane(scene, 0.5, 0.5 * behind + Vector((0.2, 0.1, 0)), behind)
    add_lamp(scene, "POINT", energy=40, shadow_soft_size=0.3)
    sky(scene, 0.06)
    curtain = plane(scene, 2.0, (0, 0, 0), (0.3, 0.2, 1))
    curtain.data.uv_layers.new()
    curtain.visible_camera = True
    return on(curtain, name="swatch")


_AREA = {"energy": 80, "size": 0.3}
CASES = {
    "point": Case(lit_by("POINT", energy=60, shadow_soft_size=0.3)),
    "ball of light": Case(lit_by("POINT", energy=60, shadow_soft_size=0.3, use_soft_falloff=False)),
    "spot": Case(lit_by("SPOT", energy=120, shadow_soft_size=0.2, spot_size=0.7, spot_blend=0.5)),
    "square": Case(lit_by("AREA", **_AREA)),
    "square, narrow": Case(lit_by("AREA", **_AREA | {"spread": 1.2})),
    "disk": Case(lit_by("AREA", shape="DISK", **_AREA | {"size": 2.0})),
    "sun": Case(lit_by("SUN", energy=2, angle=0.2)),
    "in the frame": Case(in_frame, samples=128, brightest=6.0),
    "three lamps": Case(three_lamps),
    "moving lamp": Case(moving_lamp, moving=True),
    "moving things": Case(moving_things, samples=128, moving=True),
    "mirrored": Case(mirrored, samples=96),
    "two measured": Case(two_measured),
    "mixed": Case(mixed),
    "bumpy": Case(bumpy),
    "out of focus": Case(out_of_focus),
    "swatch": Case(swatch_on_a_ball, swatch="swatch_none"),
    "swatch over azimuth": Case(swatch_on_a_ball, swatch="swatch_azimuth", samples=128),
    "swatch, measured": Case(swatch_on_a_ball, swatch="swatch_measured"),
    "swatch against the light": Case(against_the_light, swatch="swatch_none_through", samples=128),
    "swatch against the light, measured": Case(against_the_light, swatch="swatch_measured_through", samples=256),
}


def built(case: Case) -> tuple[bpy.types.Scene, Dress]:
    """A case's scene, ready to be rendered once it is dressed."""
    scene = empty_scene(size=EDGE)
    ours("addon.rendering.renderer").set_unbiased(scene, samples=1, seed=0)
    scene.camera.data.lens = 95
    dress = case.build(scene)
    scene.frame_set(1)
    if case.moving:
        scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    bpy.context.view_layer.update()
    return scene, dress
