"""Let Cycles read a table again that has changed.

A Cycles session that lives on, that of the rendered viewport or of a scene with Persistent Data, keeps an image that it
has once read, whatever happens to its pixels (tried: tags, packing, another precision). It reads the image anew only
where all nodes ask for it with another Extension. Tables are tapped at the middles of their texels, where every
Extension gives the same; so the nodes take turns.
"""

from __future__ import annotations

import hashlib

import bpy
import numpy as np

from ...nodes.group import SWITCHED_KEY

_EXTENSIONS = ("EXTEND", "MIRROR", "REPEAT")
# By scene and image: the Extensions and the content that the last render of Persistent Data has read.
_read: dict[tuple[int, int], tuple[set[str], str]] = {}


def extensions(image: bpy.types.Image) -> set[str]:
    """Image extensions by which nodes ask for a table."""
    return {node.extension for node in _readers(image)}


def extend(image: bpy.types.Image, extension: str) -> None:
    """Let all nodes ask for a table by this one."""
    for node in _readers(image):
        if node.extension != extension:
            node.extension = extension


def for_the_viewport(image: bpy.types.Image) -> None:
    """Call where a table has changed and a rendered viewport may be open."""
    if any(_is_rendered(area) for window in bpy.context.window_manager.windows for area in window.screen.areas):
        _change(image, extensions(image), set())


def for_a_render(scene: bpy.types.Scene, image: bpy.types.Image) -> None:
    """Call before each picture of a scene with Persistent Data, whether the table has changed or not."""
    key, asked = (scene.session_uid, image.session_uid), extensions(image)
    content = _content(image)
    known, last = _read.get(key, (set(), content))
    if content != last and asked & known:
        asked = _change(image, asked, known)
    _read[key] = asked, content


def forget() -> None:
    """Another file has its own."""
    _read.clear()


def _change(image: bpy.types.Image, asked: set[str], known: set[str]) -> set[str]:
    free = [e for e in _EXTENSIONS if e not in asked | known] or [e for e in _EXTENSIONS if e not in known]
    if asked and free:
        extend(image, free[0])
        return {free[0]}
    return asked


def _readers(image: bpy.types.Image) -> list[bpy.types.Node]:
    """In all groups that may be switched."""
    trees = (tree for tree in bpy.data.node_groups if "extension" in tree.get(SWITCHED_KEY, "").split())
    return [n for tree in trees for n in tree.nodes if n.bl_idname == "ShaderNodeTexImage" and n.image == image]


def _is_rendered(area: bpy.types.Area) -> bool:
    return area.type == "VIEW_3D" and area.spaces.active.shading.type == "RENDERED"


def _content(image: bpy.types.Image) -> str:
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return hashlib.sha256(pixels.tobytes()).hexdigest()
