"""A material's textures as files, which is all that OSL can read: its bundle's or, where that is gone, copies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy

from ....bake.atomic_write import replacing_file
from ....bake.brdf.record import BrdfRecord
from ....bake.bundle.bundle import read_bundle
from ....bake.errors import BakeError
from ....nodes.data_image import LoadedBundle
from ....nodes.texture_content import file_content, file_of

# In Blender's folder for what extensions write. Files there are called by their content: materials share them, and none
# is ever written over.
_FOLDER = "measured_materials/osl"


def texture_files(record: BrdfRecord) -> Callable[[str], Path]:
    """Where OSL finds each image of a record, by its name.

    That is the bundle's own file or the one the material's texture was loaded from, as long as they hold what was
    baked; a texture that is packed into the .blend is copied to Blender's own folder on this machine. Asking raises
    BakeError.
    """
    bundle = record.files()
    if not isinstance(bundle, LoadedBundle):
        return bundle.image_path
    own = _own_files(bundle)

    def find(name: str) -> Path:
        image, sha256 = bundle.texture(name), str(bundle.material["images"][name]["sha256"])
        there = [path for path in (own(name), file_of(image)) if path is not None and file_content(path) == sha256]
        if there:
            return there[0]
        if image.packed_file is None:
            raise BakeError(file_of(image), "is gone, and OSL reads textures from files only", "bake again")
        return _copied(image.packed_file.data, sha256, Path(file_of(image)).suffix or ".exr")

    return find


def _own_files(loaded: LoadedBundle) -> Callable[[str], Path | None]:
    """Files of the folder that the material was built from, if it still is a bundle."""
    try:
        bundle = read_bundle(loaded.path)
    except BakeError:
        return lambda _name: None
    return lambda name: bundle.image_path(name) if bundle.has(name) else None


def _copied(data: bytes, sha256: str, suffix: str) -> Path:
    """A file of these bytes. Raises BakeError where it cannot be written."""
    folder = Path(bpy.utils.user_resource("DATAFILES", path=_FOLDER))
    path = folder / f"{sha256}{suffix}"
    if file_content(path) == sha256:
        return path
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing_file(path) as temporary:
            temporary.write_bytes(data)
    except OSError as error:
        cause = f"cannot be written ({error.strerror}), and OSL reads textures from files only"
        raise BakeError(path, cause, "make room there, or build the material of nodes") from error
    return path
