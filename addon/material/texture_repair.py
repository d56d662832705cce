"""Textures that are not those of the bake: how they are reported and replaced, and names under which they stay right.

Until schema 2 every bundle's images were called alike. A .blend with such images packed gets names of their own when it
is opened; what lies in files cannot be renamed, because other .blend files read them, and is only reported.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ...bake.bundle.image_names import common_name, is_unique_name, title_of
from ...nodes.data_image import (
    CONTENT_KEY,
    PART_KEY,
    file_name,
    has_common_name,
    movable_path,
    rename_packed,
)
from ...nodes.texture_content import content_of, forget, is_of_content
from ..events import listen, stop_listening
from .facts import facts_of, images_of, is_measured
from .textures.kept import bundle_path, textures_of


def expected(image: bpy.types.Image, material: bpy.types.Material) -> tuple[str, str] | None:
    """Name and SHA-256 of the bundle's image that this one is in a material; None where neither says so."""
    part, sha256 = image.get(PART_KEY), image.get(CONTENT_KEY)
    if isinstance(part, str) and isinstance(sha256, str):
        return part, sha256
    if not is_measured(material):
        return None
    images = images_of(material)
    for name, texture in textures_of(material).items():
        if texture == image and name in images:
            return name, images[name].sha256
    return None


def is_another(image: bpy.types.Image, material: bpy.types.Material, *, anew: bool = False) -> bool:
    """Whether the image's file is there, and not the one that the material was built with."""
    wanted = expected(image, material)
    return wanted is not None and not is_of_content(image, wanted[1], anew=anew)


def wrong_textures(material: bpy.types.Material) -> list[str]:
    """Names of the textures whose files are others than the material was built with."""
    return [name for name, image in textures_of(material).items() if is_another(image, material)]


def right_file(image: bpy.types.Image, material: bpy.types.Material) -> Path | None:
    """The file that the material was built with, in its bundle, or in one of that name beside the .blend."""
    wanted = expected(image, material)
    for place in _places(image, material, wanted[0] if wanted else None):
        with contextlib.suppress(OSError, ValueError):
            if place.is_file() and (wanted is None or content_of(place.read_bytes()) == wanted[1]):
                return place
    return None


def _places(image: bpy.types.Image, material: bpy.types.Material, part: str | None) -> Iterator[Path]:
    bundle, suffix = bundle_path(material), Path(file_name(image)).suffix
    beside = Path(bpy.path.abspath("//")) if bpy.data.filepath else None
    for folder in (bundle, *([beside / bundle.name] if beside and bundle.name else [])):
        with contextlib.suppress(OSError, ValueError):
            for name in sorted(os.listdir(folder)):
                own = part is not None and (is_unique_name(name, part, suffix) or name == common_name(part, suffix))
                if own or name == file_name(image):
                    yield folder / name


def load_right(image: bpy.types.Image, place: Path) -> None:
    """Let the image have this file, packed if it was."""
    if image.packed_file is not None:
        data = place.read_bytes()
        image.pack(data=data, data_len=len(data))
        image.buffers_free()  # not `reload`, which would pack whatever lies at the image's path
        image.update_tag()
    else:
        image.filepath = movable_path(place)
        image.reload()


def give_names() -> None:
    """Give packed images of older bundles names of their own; no datablock is made or removed."""
    for material in bpy.data.materials:
        if is_measured(material):
            for part, image in textures_of(material).items():
                if image.is_editable and image.packed_file is not None and has_common_name(image, part):
                    if (wanted := expected(image, material)) is not None:
                        rename_packed(image, title_of(facts_of(material), material.name), *wanted)


@persistent
def _after_loading(*_: Any) -> None:
    forget()
    give_names()


@persistent
def _after_appending(*_: Any) -> None:
    give_names()


# What is appended comes by no load; the event is one since Blender 4.3.
_HANDLERS = {"load_post": _after_loading, "blend_import_post": _after_appending}


def register() -> None:
    """Called by `addon.register`."""
    listen(_HANDLERS)


def unregister() -> None:
    """Called by `addon.unregister`."""
    stop_listening(_HANDLERS)
