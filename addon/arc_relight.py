"""A shading-map material under another light: rebuilt at once of the textures it has, without a bake.

The bundle's folder may be gone by then: what the builder asks of a bundle is answered by the material itself.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bake.bake_brdf import TableSource
from ..bake.bundle import MATERIAL, Bundle, read_bundle, require
from ..bake.errors import BakeError
from ..bake.image_io import write_image
from ..bake.shading.map_albedo import map_albedo_facts
from ..bake.shading.map_facts import map_facts_of
from ..bake.shading.render_settings import RenderSettings
from ..bake.shading.render_settings import render_settings_of as settings_from_facts
from ..bake.shading.shading_map import ShadingMap
from ..bake.storage import Storage
from ..bake.table import FILTERS
from ..bake.table_facts import table_of
from ..nodes.group import HASH_KEY, content_hash
from ..nodes.material import BUNDLE_KEY
from ..nodes.shading_map_material import build_shading_map
from .arc_material import file_name, image_nodes, keep_textures, textures_of
from .cli_bake_arc import is_bundle
from .cli_result import one_line
from .lamps import lamp_image
from .lighting_properties import lighting_of, show_lighting
from .measured_material import facts_of, is_shading_map, keep_facts

_NOTHING = np.zeros((1, 1, 3), np.float32)


@dataclass(frozen=True)
class _LoadedBundle(Bundle):
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


def relight_or_say(material: bpy.types.Material) -> None:
    """Rebuild the material as its lighting properties say; where that fails, say so there and set them back."""
    properties = material.measured_lighting
    properties.problem = ""
    if not is_shading_map(material):
        return
    try:
        relight(material, lighting_of(properties))
    except BakeError as error:
        properties.problem = one_line(f"{error.cause}; {error.remedy}")
        # Foreign facts cannot be shown; the panel tells of them.
        with contextlib.suppress(BakeError):
            show_lighting(properties, current_lighting(material))


def current_lighting(material: bpy.types.Material) -> RenderSettings:
    """How the material is lit. Raises BakeError."""
    return settings_from_facts(require(facts_of(material), "render", dict, material.name), material.name)


def relight(material: bpy.types.Material, settings: RenderSettings) -> None:
    """Rebuild the material under another light, of the textures it has, else of its bundle's. Raises BakeError."""
    facts = {**facts_of(material), "render": settings.facts()}
    images = require(facts, "images", dict, material.name)
    if settings.lobe is None and "table" not in images:
        raise BakeError(material.name, "holds no measured BRDF to use as f_r", "choose a bundle below and bake again")
    if why := _missing_texture(material, facts, settings):
        _load_again(material, facts, settings, why)
    with tempfile.TemporaryDirectory() as folder:
        bundle = _LoadedBundle(_bundle_path(material), facts, textures_of(material), Path(folder))
        for name, entry in images.items():
            write_image(bundle.image_path(name), _NOTHING, Storage(require(entry, "storage", str, bundle.path)))
        facts["albedo"] = _albedo(bundle, settings)
        build_shading_map(bundle, material, settings=settings, lamps=lamp_image())
    _put_textures_back(material, bundle)
    keep_facts(material, facts)


def why_not_relightable(material: bpy.types.Material) -> str:
    """Why nothing can be rebuilt; empty if it can."""
    path = _bundle_path(material)
    try:
        missing = _missing_texture(material, facts_of(material), current_lighting(material))
    except BakeError as error:
        return one_line(str(error))
    return f"{missing}, and so is {path}" if missing and not is_bundle(path) else ""


def _bundle_path(material: bpy.types.Material) -> Path:
    return Path(str(material.get(BUNDLE_KEY) or material.name))


def _missing_texture(material: bpy.types.Material, facts: Mapping[str, Any], settings: RenderSettings) -> str:
    """Words on a texture that is needed and not there with all its pixels; empty if there is none."""
    images, there = require(facts, "images", dict, material.name), textures_of(material)
    for name in images:
        if name in ("table", "sampler") and settings.lobe is not None:
            continue
        entry, image = require(images, name, dict, material.name), there.get(name)
        size = tuple(require(entry, key, int, material.name, minimum=1) for key in ("width", "height"))
        if image is None or tuple(image.size) != size:
            return f"The texture {name} is missing"
    return ""


def _load_again(material: bpy.types.Material, facts: Mapping[str, Any], settings: RenderSettings, why: str) -> None:
    """Take the textures from the bundle, if it still is the one that was baked for the material."""
    path = _bundle_path(material)
    if not is_bundle(path):
        raise BakeError(path, f"{why[:1].lower()}{why[1:]}, and the folder {path.name} is gone", "bake again")
    bundle = read_bundle(path)
    if any(
        bundle.material["images"].get(name, {}).get("sha256") != entry.get("sha256")
        for name, entry in facts["images"].items()
    ):
        raise BakeError(path, f"the folder {path.name} holds another bake now", "bake again")
    pack = facts.get("packed") is True
    build_shading_map(bundle, material, settings=settings, pack=pack, lamps=lamp_image())
    keep_textures(material, bundle)


def _put_textures_back(material: bpy.types.Material, bundle: _LoadedBundle) -> None:
    """Exchange what the builder has loaded, which holds nothing, for the material's textures."""
    names = {entry["file"]: name for name, entry in bundle.material["images"].items()}
    textures = set(bundle.textures.values())
    nodes = [node for node in image_nodes(material.node_tree) if node.image not in textures]
    loaded = [node.image for node in nodes if Path(bpy.path.abspath(node.image.filepath)).parent == bundle.folder]
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


def _albedo(bundle: Bundle, settings: RenderSettings) -> dict[str, Any]:
    """Of the new light, by the slices' mean colours."""
    where, found = bundle.path / MATERIAL, map_facts_of(bundle)
    rows = require(require(bundle.material, "map", dict, where), "means", list, where)
    try:
        means = np.array(rows, np.float32).reshape(found.slices, 1, 1, 3)
    except (ValueError, TypeError) as error:
        raise BakeError(where, "does not say the slices' mean colours", "bake it again") from error
    f_r = None
    if settings.lobe is None:
        table = require(bundle.material, "table", dict, where)
        filter: Any = require(table, "filter", str, where, choices=FILTERS)
        f_r = TableSource(table_of(bundle), filter)
    return map_albedo_facts(ShadingMap(means), settings, found.a_max, f_r)
