"""Textures that a material keeps beside those in its nodes, so that it can be rebuilt when its bundle is gone."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ....bake.bundle.bundle import Bundle, is_bundle, read_bundle
from ....bake.bundle.image_names import title_of
from ....bake.errors import BakeError
from ....bake.shading_maps.record import Record, read_record
from ....nodes.data_image import CONTENT_KEY, PART_KEY, Images, LoadedBundle, bundle_images
from ....nodes.group import trees_below
from ....nodes.material_tree import BUNDLE_KEY, part_name
from ....nodes.texture_content import is_of_content

# With the name of a bundle's image behind it: the texture.
TEXTURE_KEY = "measured_materials_texture_"


def keep_textures(material: bpy.types.Material, bundle: Bundle, *, pack: bool, others: Collection[str] = ()) -> None:
    """Note which texture in its nodes is which image of the bundle just built; older ones go.

    `others` are images of the bundle to load and keep although no node uses them now. Cycles loads none of those.
    """
    images = (node.image for node in image_nodes(material.node_tree))
    found = {image[PART_KEY]: image for image in images if _is_of(bundle, image)}
    load = bundle_images(bundle, part_name(title_of(bundle.material, material.name)), pack=pack)
    for name in others:
        if name not in found and bundle.has(name):
            found[name] = load(name)
    older = set(textures_of(material).values())
    for key in [key for key in material.keys() if key.startswith(TEXTURE_KEY)]:
        del material[key]
    for name, image in found.items():
        material[TEXTURE_KEY + name] = image
    for image in older - set(found.values()):
        if not image.users:
            bpy.data.images.remove(image)


def textures_of(material: bpy.types.Material) -> dict[str, bpy.types.Image]:
    """Textures that the material keeps, by the names of the bundle's images; some may have lost their file."""
    keys = [key for key in material.keys() if key.startswith(TEXTURE_KEY)]
    found = {key.removeprefix(TEXTURE_KEY): material[key] for key in keys}
    return {name: image for name, image in found.items() if isinstance(image, bpy.types.Image)}


def image_nodes(tree: bpy.types.NodeTree) -> Iterator[bpy.types.Node]:
    """Nodes with an image, those inside groups too, each once."""
    for inner in trees_below(tree):
        for node in inner.nodes:
            if node.bl_idname == "ShaderNodeTexImage" and node.image:
                yield node


def _is_of(bundle: Bundle, image: bpy.types.Image) -> bool:
    entry = bundle.material["images"].get(image.get(PART_KEY))
    return entry is not None and entry["sha256"] == image.get(CONTENT_KEY)


def bundle_path(material: bpy.types.Material) -> Path:
    """The folder that the material was built from; it may be gone."""
    return Path(str(material.get(BUNDLE_KEY) or material.name))


def rebuild(
    material: bpy.types.Material,
    record: Record,
    needed: Collection[str],
    build: Callable[[Any, Images | None], object],
) -> None:
    """Call `build` with this record and the material's own textures, or the files of its bundle if one is missing.

    Parameters
    ----------
    needed : names of the images that the material is to be built of
    record : what is known of the material, without images
    build : builds the material in place from the record and of the textures it is given; None for those of the bundle

    Raises
    ------
    BakeError : a texture is missing and the bundle is gone, or is another one now; and whatever `build` raises
    """
    if why := missing_texture(material, record, needed):
        bundle = _read_again(material, record, why)
        build(read_record(bundle), None)
        keep_textures(material, bundle, pack=record.packed, others={*needed, *textures_of(material)})
    else:
        loaded = LoadedBundle(bundle_path(material), dict(record.document), textures_of(material))
        build(read_record(loaded), loaded.texture)


def missing_texture(material: bpy.types.Material, record: Record, needed: Collection[str]) -> str:
    """Words on a texture that is needed and not there with the pixels of the bake; empty if there is none."""
    there = textures_of(material)
    for name, entry in record.images.items():
        if name not in needed:
            continue
        image = there.get(name)
        if image is None or tuple(image.size) != entry.size:
            return f"The texture {name} is missing"
        if not is_of_content(image, entry.sha256):
            return f"The texture {name} is not that of the bake, but another file"
    return ""


def _read_again(material: bpy.types.Material, record: Record, why: str) -> Bundle:
    """The material's bundle, if it still is the one that was baked for it."""
    path = bundle_path(material)
    if not is_bundle(path):
        raise BakeError(path, f"{why[:1].lower()}{why[1:]}, and the folder {path.name} is gone", "bake again")
    bundle = read_bundle(path)
    now = bundle.material["images"]
    if any(name not in now or now[name]["sha256"] != entry.sha256 for name, entry in record.images.items()):
        raise BakeError(path, f"the folder {path.name} holds another bake now", "bake again")
    return replace(bundle, material=dict(record.document))
