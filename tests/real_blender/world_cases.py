"""Scenes of unbiased.py under a world of one picture, which the shader samples: beside `lamp_cases`."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from common import ours
from lamp_cases import Case, Dress, Materials, add_lamp, ball, bump, card_before, measured_node, on, plane
from mathutils import Vector

_ROWS, _COLUMNS = 64, 128
# Towards the sun of the picture that is not turned.
_SUN = Vector((1.2, -1.0, 2.2))


def directions() -> Any:
    """Of the middles of the picture's pixels (rows, columns, 3), row 0 at the zenith."""
    polar = (np.arange(_ROWS) + 0.5)[:, None] * (np.pi / _ROWS)
    azimuth = np.pi - (np.arange(_COLUMNS) + 0.5) * (2 * np.pi / _COLUMNS)
    x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
    return np.stack(np.broadcast_arrays(x, y, np.cos(polar)), -1)


def outdoors() -> Any:
    """A sky that is darker upwards, ground, and a sun of a few pixels that gives most of the light."""
    towards = directions()
    up = towards[..., 2:]
    pixels = np.where(up > 0, (0.5 - 0.35 * up) * np.array([0.5, 0.7, 1.0]), np.array([0.12, 0.1, 0.08]))
    pixels[towards @ np.array(_SUN.normalized()) > np.cos(0.07)] = 150.0, 120.0, 80.0
    return pixels


def indoors() -> Any:
    """Dim walls, graded, and a window that gives about half of the light."""
    rows, columns = np.mgrid[:_ROWS, :_COLUMNS]
    walls = 0.15 + 0.1 * np.cos(columns / 12) * np.sin(rows / 8) + 0.05 * (rows < _ROWS / 2)
    pixels = walls[..., None] * np.array([1.0, 0.9, 0.75])
    pixels[16:32, 80:96] = 4.0, 5.0, 6.5
    return pixels


def picture(pixels: Any) -> bpy.types.Image:
    """Of linear radiances (H, W, 3), row 0 at the zenith."""
    image = bpy.data.images.new("around", pixels.shape[1], pixels.shape[0], float_buffer=True, is_data=True)
    rgba = np.concatenate([pixels[::-1], np.ones_like(pixels[..., :1])], -1).astype(np.float32)
    image.pixels.foreach_set(np.ascontiguousarray(rgba).ravel())
    image.pack()
    return image


def surround(
    scene: bpy.types.Scene, pixels: Any, *, strength: float = 1.0, turn: tuple[float, float, float] | None = None
) -> bpy.types.World:
    """Show a picture (H, W, 3) all around."""
    world, background = ours("nodes.compat").new_world("around")
    tree = world.node_tree
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = picture(pixels)
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    background.inputs["Strength"].default_value = strength
    if turn is not None:
        mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
        mapping.inputs["Rotation"].default_value = turn
        tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    scene.world = world
    return world


def under_the_sun(scene: bpy.types.Scene) -> Dress:
    """A card takes a part of the sun's light."""
    surround(scene, outdoors())
    card_before(scene, _SUN)
    return on(ball(scene))


def in_a_room(scene: bpy.types.Scene) -> Dress:
    """The picture is turned and dimmed, and there is ground that reflects."""
    surround(scene, indoors(), strength=0.7, turn=(0.4, 0.9, -1.3))
    plane(scene, 4, (0, 0, -1))
    return on(ball(scene))


def beside_a_lamp(scene: bpy.types.Scene) -> Dress:
    """A large lamp before the window, seen by the same draws, and a small one."""
    surround(scene, indoors())
    add_lamp(scene, "AREA", energy=40, size=1.2)
    add_lamp(scene, "POINT", (-1.5, 0.5, 2), energy=20, shadow_soft_size=0.2)
    card_before(scene)
    return on(ball(scene))


def not_for_cameras(scene: bpy.types.Scene) -> Dress:
    """The camera does not see the world, a second ball reflects the first, and a wall stands around both."""
    surround(scene, indoors()).cycles_visibility.camera = False
    plane(scene, 3, (-1.2, 0, 0), (1, 0, 0))
    first = ball(scene, (-0.5, 0, 0), (0.5, 0.5, 0.5))
    second = ball(scene, (0.5, 0, 0), (0.5, 0.5, 0.5))

    def dress(materials: Materials) -> None:
        on(first)(materials)
        on(second, name="metal")(materials)

    return dress


def leaning(scene: bpy.types.Scene) -> Dress:
    """A plane of bumps above nothing: what is reflected to below it has no ground to meet."""
    surround(scene, indoors())
    obj = plane(scene, 2, (0, 0, 0))
    obj.visible_camera = True

    def dress(materials: Materials) -> None:
        bump(materials["paint"])
        on(obj)(materials)

    return dress


def by_the_lens(scene: bpy.types.Scene) -> Dress:
    """The camera's numbers place what is drawn."""
    surround(scene, indoors())
    lens = scene.camera.data
    lens.dof.use_dof, lens.dof.focus_distance, lens.dof.aperture_fstop = True, 5.6, 64.0
    return on(ball(scene))


def glossier(scene: bpy.types.Scene) -> Dress:
    """World and lamp, by a table whose directions a change of gloss carries elsewhere; one half is softer."""
    surround(scene, indoors()).cycles_visibility.camera = False
    add_lamp(scene, "AREA", energy=40, size=1.2)
    first = ball(scene, (-0.5, 0, 0), (0.5, 0.5, 0.5))
    second = ball(scene, (0.5, 0, 0), (0.5, 0.5, 0.5))

    def dress(materials: Materials) -> None:
        for name, gloss in (("paint", 2.0), ("metal", 0.6)):
            measured_node(materials[name]).inputs["Gloss"].default_value = gloss
        on(first)(materials)
        on(second, name="metal")(materials)

    return dress


def exchange(scene: bpy.types.Scene) -> None:
    """Another picture in the same world: materials aim at it, until they are fitted to the scene again."""
    texture = next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeTexEnvironment")
    texture.image = picture(outdoors())


CASES = {
    "world with a sun": Case(under_the_sun, samples=96),
    "world with a window": Case(in_a_room, samples=96),
    "world and lamps": Case(beside_a_lamp, samples=96),
    "world and lamp, gloss": Case(glossier, samples=288),
    "world that cameras miss": Case(not_for_cameras, samples=288),
    "world under a plane": Case(leaning, samples=96),
    "world by the lens": Case(by_the_lens, samples=64),
    "world exchanged": Case(beside_a_lamp, samples=96, later=exchange),
}
