"""A measured material made an asset of Blender's asset browser, and made an ordinary material again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...bake.bundle.bundle import PREVIEW
from ...bake.errors import BakeError
from ...bake.images.image_io import read_image
from ..material.facts import is_measured, record_of
from ..material.textures.kept import bundle_path
from ..summary.text import one_line
from .catalogue import add_catalogue, library_of
from .words import Rights, rights_of, words_of

_LARGEST_PICTURE = 1 << 24  # bytes


def mark(
    material: bpy.types.Material,
    rights: Rights | None = None,
    *,
    library: Path | None = None,
    picture: NDArray[Any] | None = None,
) -> str:
    """Make the material an asset, or bring one in line with its last bake; words on what could not be done, or none.

    Parameters
    ----------
    rights : to state; by default what is stated already stays, and else what the measurement says of itself
    library : folder whose catalogues list it; by default that of the open .blend
    picture : (H, W, 1 to 4) sRGB in [0, 1] or bytes, row 0 on top; by default that of its bundle

    Raises
    ------
    BakeError : its record cannot be read, and it is no asset
    """
    record = record_of(material)
    words = words_of(record)
    if rights is None:
        rights = stated_rights(material)
    material.asset_mark()
    data = material.asset_data
    data.description = words.description
    data.author, data.license, data.copyright = rights.author, rights.license, rights.copyright
    for tag in words.tags:
        data.tags.new(tag, skip_if_exists=True)
    told = _set_picture(material, picture), _set_catalogue(material, words.catalogue, library or library_folder())
    return "; ".join(filter(None, told))


def refresh(material: bpy.types.Material, before: Rights | None = None) -> str:
    """Bring an asset in line with its last bake; nothing where it is none. Words as `mark`; raises nothing.

    Parameters
    ----------
    before : `known_rights` of another measurement that was baked before: of them the asset states no more
    """
    data = material.asset_data
    if data is None or not is_measured(material):
        return ""
    for name in ("author", "license", "copyright") if before is not None else ():
        if getattr(data, name) == getattr(before, name):
            setattr(data, name, "")
    return mark_or_say(material)


def known_rights(material: bpy.types.Material) -> Rights:
    """What its measurement says of itself, or was stated of it; nothing where that is not to be read."""
    try:
        return rights_of(record_of(material))
    except BakeError:
        return Rights()


def mark_or_say(material: bpy.types.Material) -> str:
    """As `mark`, where the bake must not fail by it: all that went wrong as words."""
    try:
        return mark(material)
    except BakeError as error:
        return one_line(str(error))


def unmark(material: bpy.types.Material) -> None:
    """Make the material an ordinary one. It stays in the .blend even where nothing uses it, and so does its catalogue,
    which other assets may be in."""
    unused = material.users - material.use_fake_user < 1
    material.asset_clear()
    material.use_fake_user = unused


def stated_rights(material: bpy.types.Material) -> Rights:
    """Author, licence and copyright of an asset, and where one is not stated there, as the measurement says.

    Raises BakeError.
    """
    known, data = rights_of(record_of(material)), material.asset_data
    if data is None:
        return known
    return Rights(data.author or known.author, data.license or known.license, data.copyright or known.copyright)


def library_folder(blend: Path | None = None) -> Path | None:
    """Folder of the asset library that a .blend, by default the open one, belongs to; None before that is saved."""
    blend = blend or (Path(bpy.data.filepath) if bpy.data.filepath else None)
    if blend is None:
        return None
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return library_of(blend, [Path(library.path) for library in libraries if library.path])


def _set_catalogue(material: bpy.types.Material, path: str, folder: Path | None) -> str:
    if folder is None:
        return "Save the .blend file and mark again to give it a catalog"
    try:
        material.asset_data.catalog_id = add_catalogue(folder, path)
    except BakeError as error:
        return one_line(str(error))
    return ""


def _set_picture(material: bpy.types.Material, picture: NDArray[Any] | None) -> str:
    """The one that is given, or of its bundle; where that is gone the one that it has, else Blender renders one."""
    if picture is None:
        try:
            picture = read_image(bundle_path(material) / PREVIEW, _LARGEST_PICTURE)
        except (BakeError, ValueError):
            if material.preview is not None and material.preview.is_image_custom:
                return ""
            if bpy.app.background:
                return "Its bundle is gone, and with it the picture"
            material.asset_generate_preview()
            return ""
    if picture.dtype == np.uint8:
        picture = picture.astype(np.float32) / 255
    pixels = np.ones((*picture.shape[:2], 4), np.float32)
    colours = picture.shape[2] - (picture.shape[2] in (2, 4))
    pixels[..., :3] = picture[..., :colours]
    preview = material.preview_ensure()
    preview.image_size = pixels.shape[1], pixels.shape[0]
    preview.image_pixels_float.foreach_set(pixels[::-1].ravel())
    return ""
