"""Folders of maps as a .blend that holds a Principled BSDF material of each, as assets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from ...bake.atomic_write import replacing_file
from ...bake.errors import BakeError
from ...bake.maps.folder import MapsFolder
from ...bake.maps.relief import Relief
from ...nodes.portions import datablocks, remove_unused_blocks
from ...nodes.principled_maps import build_principled
from ..summary.text import one_line


def write_maps_blend(
    folders: Sequence[MapsFolder], target: Path, *, relief: Relief, width: float, pack: bool
) -> list[str]:
    """Write a material of every folder into one .blend, and return their names; what is open stays as it is.

    Parameters
    ----------
    target : .blend; an older one is replaced in one step
    relief, width : as of `build_principled`
    pack : the textures lie in the .blend; otherwise it reads the maps by paths relative to itself

    Raises
    ------
    BakeError : a map cannot be loaded, or the file cannot be written
    """
    before, made = datablocks(), []
    try:
        for folder in folders:
            material = build_principled(folder, relief=relief, width=width, pack=pack)
            material.asset_mark()
            made.append(material)
        names = [material.name for material in made]
        try:
            with replacing_file(target) as temporary:
                bpy.data.libraries.write(
                    str(temporary), set(made), path_remap="RELATIVE_ALL", fake_user=True, compress=True
                )
        except (OSError, RuntimeError) as error:
            cause = getattr(error, "strerror", None) or one_line(str(error))
            raise BakeError(target, f"cannot be written ({cause})", "check its folder and the free space") from error
    finally:
        for material in made:
            bpy.data.materials.remove(material)
        remove_unused_blocks(datablocks() - before)
    return names
