"""Let Cycles read a table again that has changed.

A Cycles session that lives on, that of the rendered viewport or of a scene with Persistent Data, keeps an image that it
has once read, whatever happens to its pixels (tried: tags, packing, another precision). It reads the image anew only
where all nodes ask for it with another Extension. Tables are tapped at the middles of their texels, where every
Extension gives the same; so the nodes take turns.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import bpy
import numpy as np

from ..nodes.aimed_light_group import SLOTS_KEY
from ..nodes.group import HASH_KEY, content_hash

_EXTENSIONS = ("EXTEND", "MIRROR", "REPEAT")
# By scene and image: the Extensions and the content that the last render of Persistent Data has read.
_read: dict[tuple[int, int], tuple[set[str], str]] = {}
# A group's hash before, the image and its new Extension: the hash after.
_hashes: dict[tuple[str, str, str], str] = {}


def extensions(image: bpy.types.Image, trees: Iterable[bpy.types.NodeTree] | None = None) -> set[str]:
    """Those by which nodes, by default of all groups that aim, ask for a table."""
    trees = _aiming_trees() if trees is None else trees
    return {node.extension for tree in trees for node in _readers(tree, image)}


def extend(image: bpy.types.Image, extension: str, trees: Iterable[bpy.types.NodeTree] | None = None) -> None:
    """Let these nodes ask for a table by this one; to the scene check the groups stay as they were built."""
    for tree in _aiming_trees() if trees is None else trees:
        nodes = [node for node in _readers(tree, image) if node.extension != extension]
        if not nodes:
            continue
        before = tree.get(HASH_KEY)
        key = (str(before), image.name_full, extension)
        as_built = key not in _hashes and content_hash(tree) == before
        for node in nodes:
            node.extension = extension
        if as_built:
            _hashes[key] = content_hash(tree)
        if key in _hashes:
            tree[HASH_KEY] = _hashes[key]


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


def _aiming_trees() -> list[bpy.types.NodeTree]:
    return [tree for tree in bpy.data.node_groups if SLOTS_KEY in tree]


def _readers(tree: bpy.types.NodeTree, image: bpy.types.Image) -> list[bpy.types.Node]:
    return [node for node in tree.nodes if node.bl_idname == "ShaderNodeTexImage" and node.image == image]


def _is_rendered(area: bpy.types.Area) -> bool:
    return area.type == "VIEW_3D" and area.spaces.active.shading.type == "RENDERED"


def _content(image: bpy.types.Image) -> str:
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return hashlib.sha256(pixels.tobytes()).hexdigest()
