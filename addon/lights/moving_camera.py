"""Whether a scene's camera moves while its shutter is open: then where a ray crossed the lens tells no numbers."""

from __future__ import annotations

import bpy

from ...nodes.lens_group import MOVES, lens_groups, value_node
from .motion import changes


def follow_cameras() -> None:
    """Tell the materials whether any scene's camera moves under motion blur.

    Makes and links no datablock: for handlers. Groups that have not been told take it for moving: noise, and no bias.
    """
    groups = lens_groups()
    if groups:
        moves = float(any(camera_moves(scene) for scene in bpy.data.scenes))
        for group in groups:
            node = value_node(group, MOVES)
            if node is not None and node.outputs[0].default_value != moves:
                node.outputs[0].default_value = moves


def camera_moves(scene: bpy.types.Scene) -> bool:
    """Whether motion blur is on, and the camera may be elsewhere while the shutter is open."""
    return scene.render.use_motion_blur and (changes(scene) or changes(scene.camera))
