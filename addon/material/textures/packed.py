"""Textures put into the .blend, where Open Shading Language reads them as Cycles' own nodes do."""

from __future__ import annotations

import bpy

from ....nodes.group import HASH_KEY, trees_below


def pack_textures(material: bpy.types.Material) -> None:
    """Put a material's textures into the .blend: of files, Open Shading Language reads mip levels at random.

    The world's picture, which its groups may sample, and pictures of the artist's own nodes stay where they are.
    """
    own = (tree for tree in trees_below(material.node_tree) if HASH_KEY in tree)
    for image in {node.image for tree in own for node in tree.nodes if node.bl_idname == "ShaderNodeTexImage"}:
        if image is not None and image.source == "FILE" and image.packed_file is None and image.is_editable:
            image.pack()
