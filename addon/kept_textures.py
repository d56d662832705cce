"""Textures that a material keeps beside those in its nodes, so that it can be rebuilt when its bundle is gone."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bake.bundle import MATERIAL, Bundle, read_bundle, require
from ..bake.errors import BakeError
from ..bake.image_io import write_image
from ..bake.storage import Storage
from ..nodes.group import HASH_KEY, content_hash
from ..nodes.material import BUNDLE_KEY, load_data_image, safe_name
from .cli_bake_arc import is_bundle

# With the name of a bundle's image behind it: the texture.
TEXTURE_KEY = "measured_materials_texture_"
_NOTHING = np.zeros((1, 1, 3), np.float32)


def keep_textures(material: bpy.types.Material, bundle: Bundle, *, pack: bool, others: Collection[str] = ()) -> None:
    """Note which texture in its nodes is which image of the bundle just built; older ones go.

    `others` are images of the bundle to load and keep although no node uses them now. Cycles loads none of those.
    """
    files = {file_name(node.image): node.image for node in image_nodes(material.node_tree)}
    names = {entry["file"]: name for name, entry in bundle.material["images"].items()}
    found = {names[file]: image for file, image in files.items() if file in names}
    source = bundle.material.get("source")
    title = safe_name(str(source.get("name") if isinstance(source, dict) else material.name))
    for name in others:
        if name not in found and bundle.has(name):
            half = bundle.material["images"][name]["storage"] == Storage.HALF
            label = f"{title} {name.replace('_', ' ')}"
            found[name] = load_data_image(bundle.image_path(name), label, half=half, pack=pack)
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
    """Nodes with an image, those inside groups too."""
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
            yield from image_nodes(node.node_tree)
        elif node.bl_idname == "ShaderNodeTexImage" and node.image:
            yield node


def file_name(image: bpy.types.Image) -> str:
    """Of the file it was loaded from, without the folder."""
    return re.split(r"[/\\]", image.filepath)[-1]


@dataclass(frozen=True)
class LoadedBundle(Bundle):
    """A bundle whose images are those of a material; its files, in `folder`, hold nothing."""

    textures: Mapping[str, bpy.types.Image] = field(default_factory=dict)
    folder: Path = Path()

    def image_path(self, name: str) -> Path:
        return self.folder / super().image_path(name).name

    def load(self, name: str) -> NDArray[np.float32]:
        image = self.textures[name]
        values = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
        image.pixels.foreach_get(values)
        channels = require(self.material["images"][name], "channels", int, self.path / MATERIAL)
        return values.reshape(image.size[1], image.size[0], -1)[::-1, :, :channels]


def bundle_path(material: bpy.types.Material) -> Path:
    """The folder that the material was built from; it may be gone."""
    return Path(str(material.get(BUNDLE_KEY) or material.name))


def rebuild(
    material: bpy.types.Material, facts: Mapping[str, Any], needed: Collection[str], build: Callable[[Bundle], object]
) -> None:
    """Call `build` with a bundle of these facts and of the material's own textures, or of its files if one is missing.

    Parameters
    ----------
    needed : names of the images that the material is to be built of
    build : builds the material in place from the bundle it is given

    Raises
    ------
    BakeError : a texture is missing and the bundle is gone, or is another one now; and whatever `build` raises
    """
    if why := missing_texture(material, facts, needed):
        bundle = _read_again(material, facts, why)
        build(bundle)
        keep_textures(material, bundle, pack=facts.get("packed") is True, others={*needed, *textures_of(material)})
    images = require(facts, "images", dict, material.name)
    with tempfile.TemporaryDirectory() as folder:
        loaded = LoadedBundle(bundle_path(material), dict(facts), textures_of(material), Path(folder))
        for name, entry in images.items():
            write_image(loaded.image_path(name), _NOTHING, Storage(require(entry, "storage", str, loaded.path)))
        build(loaded)
    _put_textures_back(material, loaded)


def missing_texture(material: bpy.types.Material, facts: Mapping[str, Any], needed: Collection[str]) -> str:
    """Words on a texture that is needed and not there with all its pixels; empty if there is none."""
    images, there = require(facts, "images", dict, material.name), textures_of(material)
    for name in (name for name in images if name in needed):
        entry, image = require(images, name, dict, material.name), there.get(name)
        size = tuple(require(entry, key, int, material.name, minimum=1) for key in ("width", "height"))
        if image is None or tuple(image.size) != size:
            return f"The texture {name} is missing"
    return ""


def _read_again(material: bpy.types.Material, facts: Mapping[str, Any], why: str) -> Bundle:
    """The material's bundle, if it still is the one that was baked for it."""
    path = bundle_path(material)
    if not is_bundle(path):
        raise BakeError(path, f"{why[:1].lower()}{why[1:]}, and the folder {path.name} is gone", "bake again")
    bundle = read_bundle(path)
    if any(
        bundle.material["images"].get(name, {}).get("sha256") != entry.get("sha256")
        for name, entry in facts["images"].items()
    ):
        raise BakeError(path, f"the folder {path.name} holds another bake now", "bake again")
    return replace(bundle, material=dict(facts))


def _put_textures_back(material: bpy.types.Material, bundle: LoadedBundle) -> None:
    """Exchange what the builder has loaded, which holds nothing, for the material's textures."""
    names = {entry["file"]: name for name, entry in bundle.material["images"].items()}
    textures = set(bundle.textures.values())
    nodes = [node for node in image_nodes(material.node_tree) if node.image not in textures]
    # Beside a saved .blend the path is relative, and Blender makes it absolute with every ".." left in it.
    folder = bundle.folder.resolve()
    loaded = [n.image for n in nodes if Path(bpy.path.abspath(n.image.filepath)).resolve().parent == folder]
    for node in nodes:
        if node.image in loaded:
            node.image = bundle.textures[names[file_name(node.image)]]
    for image in dict.fromkeys(loaded):
        bpy.data.images.remove(image)
    _hash_again(material.node_tree)


def _hash_again(tree: bpy.types.NodeTree) -> None:
    """Note in the groups inside that their content is ours, the textures' names being part of it."""
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree and HASH_KEY in node.node_tree:
            _hash_again(node.node_tree)
            node.node_tree[HASH_KEY] = content_hash(node.node_tree)
