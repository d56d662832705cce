"""Images whose numbers reach the shader as they are in the file, and that know which content that was."""

from __future__ import annotations

import contextlib
import functools
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bake.bundle.bundle import Bundle
from ..bake.bundle.image_names import common_name, title_of, unique_name
from ..bake.errors import BakeError
from ..bake.images.storage import Storage
from . import portions
from .texture_content import content_of, file_of, image_content

# A material's textures, by the names of the bundle's images.
Images = Callable[[str], bpy.types.Image]
# Custom properties of an image: which of the bundle's it is, and the SHA-256 of its file.
PART_KEY, CONTENT_KEY = "measured_materials_part", "measured_materials_sha256"
# And of one that was computed: what it was made of.
MADE_KEY = "measured_materials_made_of"


@dataclass(frozen=True)
class LoadedBundle(Bundle):
    """A bundle whose images are those that a material has already; its files may be gone."""

    textures: Mapping[str, bpy.types.Image] = field(default_factory=dict)

    def texture(self, name: str) -> bpy.types.Image:
        """The material's image. Raises BakeError where it has none of that name."""
        if name not in self.textures:
            raise BakeError(self.path, f"the material has lost its texture {name}", "bake again")
        return self.textures[name]

    def part(self, name: str, material: dict[str, Any]) -> LoadedBundle:
        """See `Bundle.part`."""
        front = f"{name}_"
        textures = {key.removeprefix(front): image for key, image in self.textures.items() if key.startswith(front)}
        return replace(self, material=material, textures=textures)

    def load(self, name: str) -> NDArray[np.float32]:
        """Pixels (H, W, C) of a texture of the material, top row first. Raises BakeError where it has none."""
        image = self.texture(name)
        if 0 in image.size:
            raise BakeError(self.path, f"the file of the material's texture {name} is gone or damaged", "bake again")
        values = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
        image.pixels.foreach_get(values)
        channels = self.material["images"][name]["channels"]
        return values.reshape(image.size[1], image.size[0], -1)[::-1, :, :channels]


def bundle_image(bundle: Bundle, name: str, label: str, *, pack: bool = False) -> bpy.types.Image:
    """Image `name` of a bundle: the one that is there already, else loaded under this label. Raises BakeError."""
    path, entry = bundle.image_path(name), bundle.material["images"][name]
    half = entry["storage"] == Storage.HALF
    there = shared_image(path, name, entry["sha256"], half=half, pack=pack)
    if there is not None:
        return there
    portions.rest()
    image = load_data_image(path, label, half=half, pack=pack)
    image[PART_KEY], image[CONTENT_KEY] = name, entry["sha256"]
    if pack:
        rename_packed(image, title_of(bundle.material, bundle.path.stem), name, entry["sha256"])
    return image


def shared_image(path: Path, part: str, sha256: str, *, half: bool, pack: bool) -> bpy.types.Image | None:
    """The image that an earlier build loaded of this file and that still is as it was loaded; None if there is none.

    Not one of a linked library, which would be lost with the library; none that somebody has painted on, set otherwise
    or given another file; packed and unpacked ones are not mixed, and an unpacked one reads the very file asked for.
    """
    for image in bpy.data.images:
        if image.get(CONTENT_KEY) != sha256 or image.get(PART_KEY) != part or image.library is not None:
            continue
        as_loaded = (image.source, image.colorspace_settings.name, image.alpha_mode, image.use_half_precision)
        if as_loaded != ("FILE", "Non-Color", "CHANNEL_PACKED", half) or image.is_dirty:
            continue
        if (image.packed_file is not None) != pack or not (pack or _is_same_place(file_of(image), path)):
            continue
        if image_content(image) == sha256:
            return image
    return None


def _is_same_place(one: Path, other: Path) -> bool:
    try:
        return one == other or os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


def of_part(images: Images, part: str) -> Images:
    """Textures of a part, by the names that they have in its own record."""
    return (lambda name: images(f"{part}_{name}")) if part else images


def bundle_images(bundle: Bundle, title: str, *, pack: bool = False) -> Images:
    """A bundle's textures: found or loaded when asked for, called after `title`. Asking raises BakeError.

    Materials of one bundle share them.
    """
    return functools.cache(lambda name: bundle_image(bundle, name, f"{title} {name.replace('_', ' ')}", pack=pack))


def load_data_image(path: Path, name: str, *, half: bool = False, pack: bool = False) -> bpy.types.Image:
    """An image whose numbers reach the shader as they are in the file; `half` where they are half floats there."""
    try:
        image = bpy.data.images.load(str(path), check_existing=False)
    except RuntimeError as error:
        raise BakeError(path, "cannot be loaded by Blender", "bake it again") from error
    image.name = name
    if bpy.data.filepath and not pack:
        image.filepath = movable_path(path)
    image.colorspace_settings.name = "Non-Color"
    # RGBA data would otherwise be divided by alpha, and float32 cut to half when it goes to the device.
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = half
    if pack:
        image.pack()
    return image


def new_data_image(name: str, pixels: NDArray[np.float32], *, half: bool = False, made_of: str = "") -> bpy.types.Image:
    """An image of these numbers (H, W, 3 or 4), top row first, packed so that the .blend keeps it.

    By what it is `made_of`, where that is told, `made_image` finds it again.
    """
    height, width, channels = pixels.shape
    full = np.ones((height, width, 4), np.float32)
    full[..., :channels] = pixels[::-1]
    image = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True, alpha=True)
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = half
    image.pixels.foreach_set(full.ravel())
    image.update()
    image.pack()
    name_made(image)
    if made_of:
        image[MADE_KEY], image[CONTENT_KEY] = made_of, image_content(image)
    return image


def made_image(made_of: str, *, half: bool) -> bpy.types.Image | None:
    """The file's own image that `new_data_image` has made of this, if it still is as it was made."""
    for image in bpy.data.images:
        if image.get(MADE_KEY) == made_of and image.library is None and not image.is_dirty:
            as_made = (image.colorspace_settings.name, image.alpha_mode, image.use_half_precision)
            if as_made == ("Non-Color", "CHANNEL_PACKED", half) and image_content(image) == image.get(CONTENT_KEY):
                return image
    return None


def movable_path(path: Path) -> str:
    """The file relative to a saved .blend, so that the two can move together; on another drive there is no such path.

    For images of the file itself: those of a library go by the library's place.
    """
    if bpy.data.filepath:
        with contextlib.suppress(ValueError):
            return str(bpy.path.relpath(str(path)))
    return str(path)


def file_name(image: bpy.types.Image) -> str:
    """Name of the file an image was loaded from, without the folder, whichever system wrote the path."""
    return re.split(r"[/\\]", image.filepath)[-1]


def has_common_name(image: bpy.types.Image, part: str) -> bool:
    """Whether its file is called as that of every bundle up to schema 2."""
    file = file_name(image)
    return file == common_name(part, Path(file).suffix)


def rename_packed(image: bpy.types.Image, title: str, part: str, sha256: str) -> None:
    """Give a packed image of an older bundle the name under which Blender unpacks it; others keep theirs."""
    if not has_common_name(image, part) or not image.packed_files:
        return
    file = file_name(image)
    folder = image.filepath[: len(image.filepath) - len(file)]
    path = folder + unique_name(title, part, sha256, Path(file).suffix)
    for packed in image.packed_files:
        packed.filepath = path
    image.filepath_raw = path  # not `filepath`: Blender would look for the file


def name_made(image: bpy.types.Image) -> None:
    """Give a packed image that came from no file a name of its own to be unpacked under.

    Blender would take the datablock's, of which systems make one file where they differ by a sign or a capital.
    """
    if image.packed_file is not None:
        data = image.packed_file.data
        suffix = ".png" if data.startswith(b"\x89PNG") else ".exr"
        for packed in image.packed_files:
            packed.filepath = "//" + unique_name(image.name, "made", content_of(data), suffix)
        image.filepath_raw = image.packed_files[0].filepath
