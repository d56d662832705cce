"""The table by which shaders sample the world's picture themselves, and whether they may (method.md, section 10)."""

from __future__ import annotations

import bpy
import numpy as np

from ...bake.source import Array
from ...nodes.group import trees_below
from ...nodes.light_images import WORLD_LIGHT_TEXELS, new_table
from ...nodes.world_picture import PICTURE, Surroundings
from .lamp_survey import LampReport
from .world_survey import WorldPicture

WORLD_LIGHT_TABLE = "MM World Light"


def world_light_image() -> bpy.types.Image:
    """The file's table; made, with nothing to sample, where there is none."""
    image = bpy.data.images.get((WORLD_LIGHT_TABLE, None))
    return image if image in world_light_images() else new_table(WORLD_LIGHT_TABLE, WORLD_LIGHT_TEXELS, 1)


def world_light_images() -> list[bpy.types.Image]:
    """The file's table, and those that came along with linked and appended materials."""
    tables = (image for image in bpy.data.images if image.name.startswith(WORLD_LIGHT_TABLE))
    return [image for image in tables if tuple(image.size) == (WORLD_LIGHT_TEXELS, 1)]


def surroundings_of(report: LampReport) -> Surroundings | None:
    """What a material is built to sample; None where the world's light is not known exactly."""
    picture = report.world.picture
    image = next((image for image in bpy.data.images if picture and image.session_uid == picture.image), None)
    if picture is None or image is None or report.world_inexact:
        return None
    return Surroundings(image, picture.interpolation, world_light_image())


def world_light_table(report: LampReport) -> Array:
    """(1, 3, 4) float32, as `Surroundings` has it; dark where a material shows another picture than the world.

    Such materials were built under another world, and handlers may exchange no image: all then aim at the world only.
    """
    table = np.zeros((1, WORLD_LIGHT_TEXELS, 4), np.float32)
    picture = report.world.picture
    if picture is not None and not report.world_inexact and all_show(picture):
        table[0, :, :3] = picture.rows
        table[0, :2, 3] = max(picture.strength, 0.0), report.world_rays
    return table


def all_show(picture: WorldPicture) -> bool:
    """Whether all materials that sample a picture were built for this one.

    Groups that removed materials have left in the file are of no matter.
    """
    wanted = picture.image, picture.interpolation
    other = {tree for tree in bpy.data.node_groups if tree.name.startswith(PICTURE) and _shown_by(tree) - {wanted}}
    return not other or other.isdisjoint(
        tree for material in bpy.data.materials if material.node_tree for tree in trees_below(material.node_tree)
    )


def _shown_by(tree: bpy.types.NodeTree) -> set[tuple[int, str]]:
    """Pictures of a group, and how they are interpolated."""
    nodes = (node for node in tree.nodes if node.bl_idname == "ShaderNodeTexEnvironment")
    return {(node.image.session_uid if node.image else 0, node.interpolation) for node in nodes}
