"""One bundle as a .blend that holds its material as an asset, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import bpy

from ...bake.atomic_write import replacing_file
from ...bake.bundle.bundle import read_bundle
from ...bake.errors import BakeError
from ...bake.shading_maps.record import read_record
from ...nodes.data_image import PART_KEY
from ...nodes.group import trees_below
from ...nodes.portions import datablocks, found, remove_unused_blocks
from ..assets.mark import mark
from ..material.load_bundle import load_bundle
from ..material.textures.kept import image_nodes
from ..studio.shown_bundle import studio_picture
from ..summary.text import one_line
from ..ui.properties.next_bake import show_next_bake

Textures = Literal["packed", "relative"]
Preview = Literal["render", "bundle"]
# What Blender shows of an asset at its largest.
PICTURE = 256


@dataclass(frozen=True)
class AssetSettings:
    """How bundles become assets.

    Parameters
    ----------
    textures : "packed" into the .blend, or "relative": it reads the files of the bundle, by paths relative to itself
    preview : "render" a picture in the studio, or take the one of the "bundle"
    samples : of a rendered picture's pixels
    """

    textures: Textures = "packed"
    preview: Preview = "render"
    samples: int = 32


def write_asset(
    bundle: Path,
    target: Path,
    library: Path,
    settings: AssetSettings,
    progress: Callable[[str, float], None] = lambda *_: None,
    ready: Callable[[Path], None] = lambda _: None,
) -> str:
    """Write a bundle's material as an asset to the .blend `target`, or replace an older one by it in one step.

    It is called as the file is. The extension must be registered; what is open stays as it is.

    Parameters
    ----------
    library : folder in which Blender looks for the catalogues
    progress : called with "rendering" or "building" and the share of it that is done
    ready : called with the file, whole, before it takes its place

    Returns
    -------
    Words on what could not be done for it, or none

    Raises
    ------
    BakeError : the bundle cannot be built or the file not be written; an older file stays as it was
    """
    before = datablocks()
    with _empty_scene(), _removed(before) as made:
        record = read_record(read_bundle(bundle))
        picture = None
        if settings.preview == "render":
            progress("rendering", 0.0)
            picture = studio_picture(record, PICTURE, settings.samples, lambda share: progress("rendering", share))
        progress("building", 0.0)
        material = load_bundle(bundle, pack=settings.textures == "packed")
        made.append(material)
        material.name = target.stem
        show_next_bake(material, settings.textures == "packed")
        told = mark(material, library=library, picture=picture)
        _write(material, target, ready)
    return told


def _write(material: bpy.types.Material, target: Path, ready: Callable[[Path], None]) -> None:
    """The material and what it uses, once it has been read again. Raises BakeError."""
    try:
        with replacing_file(target) as temporary:
            bpy.data.libraries.write(
                str(temporary), {material}, path_remap="RELATIVE_ALL", fake_user=True, compress=True
            )
            with bpy.data.libraries.load(str(temporary), assets_only=True) as (there, _):
                if there.materials != [material.name]:
                    raise OSError("what Blender wrote does not hold it")
            ready(temporary)
    except (OSError, RuntimeError) as error:
        cause = getattr(error, "strerror", None) or one_line(str(error)).rsplit(": ", 1)[-1].rstrip(".")
        raise BakeError(target, f"cannot be written ({cause})", "check its folder and the free space") from error


@contextmanager
def _empty_scene() -> Iterator[None]:
    """Inside, materials are built for no scene in particular: with nothing to aim at, and ready for what comes."""
    scene = bpy.data.scenes.new("Asset library")
    try:
        with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
            yield
    finally:
        bpy.data.scenes.remove(scene)


@contextmanager
def _removed(before: set[tuple[str, int]]) -> Iterator[list[bpy.types.Material]]:
    """Give a list for what is made; afterwards it goes, with the textures and groups that nothing else has.

    Node groups without a bundle's texture stay: the next material is built of them in a fraction of the time.
    """
    made: list[bpy.types.Material] = []
    try:
        yield made
    finally:
        for material in made:
            bpy.data.materials.remove(material)
        remove_unused_blocks({(kind, uid) for kind, uid in datablocks() - before if _is_of_a_bundle(kind, uid)})


def _is_of_a_bundle(kind: str, uid: int) -> bool:
    block = found(kind, uid)
    if kind == "images":
        return PART_KEY in block
    return any(PART_KEY in node.image for tree in trees_below(block) for node in image_nodes(tree))
