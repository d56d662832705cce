"""The bundle: a folder NAME.mmat that holds a baked material.

    NAME_HASH_IMAGE.exr, .hdr or .png
                     images, those that the material has: table, sampler, envelope, residual, residual_sampler,
                     residual_share, preview_weights, slices, power, coefficients, curves; of a sheet's other parts, and
                     of a swatch against the light, the same behind the part's name, as through_table; see `image_names`
    material.json    all parameters, errors and facts, and the images' names
    preview.png      for people

A bundle appears under its name whole or not at all, and reading one trusts nothing in it: no code, no paths,
no size that was not checked.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..atomic_write import publish_folder, recover, replacing_folder, staging_folder
from ..errors import BakeError
from ..images.image_io import MAX_IMAGE_BYTES, read_header, read_image, write_image, write_png
from ..images.storage import IMAGE_STORAGES, Storage
from ..source import SHEET_PARTS
from .checked_json import dump_json, load_json, require
from .image_names import common_name, is_unique_name, title_of, unique_name

__all__ = [
    "SUFFIX",
    "Bundle",
    "Kind",
    "StoredImage",
    "is_bundle",
    "move_bundle",
    "read_bundle",
    "require",
    "staging",
    "write_bundle",
]

Kind = Literal["brdf", "shading_map"]
KINDS: tuple[str, ...] = get_args(Kind)
# 2: half vectors, four dimensions, codes, raised half floats, all of which readers of 1 would take for plain tables.
# 3: images are called as no other material's are.
# 4: samplers may be warps, which readers of 3 would take for alias tables.
# 5: what lets light through, of which readers of 4 would show reflection alone, and isotropic tables stored times
#    cosines, which they would take for the BRDF itself; everything else is still written as 4.
# 6, 7: shading maps over azimuth, in 7 of curves that are parts of a level.
SCHEMA = 7
_SCHEMA_OF_NEW = 5
_SCHEMA_OF_OTHERS = 4
_LETS_THROUGH = {"sheet", "through"}
SUFFIX = ".mmat"
_OF_TABLES = "table", "sampler", "envelope", "residual", "residual_sampler", "residual_share", "preview_weights"
_OF_MAPS = "slices", "power", "coefficients", "curves"
IMAGES = (
    *_OF_TABLES,
    *_OF_MAPS,
    *(f"{part}_{name}" for part in SHEET_PARTS for name in _OF_TABLES),
    *(f"through_{name}" for name in _OF_MAPS),
)
MATERIAL, PREVIEW = "material.json", "preview.png"
_COMMON = frozenset(common_name(name, storage.suffix) for name in IMAGES for storage in Storage)
_OF_THE_SYSTEM = {".DS_Store", "Thumbs.db", "desktop.ini"}  # what file browsers leave in any folder
_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, eq=False)
class StoredImage:
    """An image to write: (H, W, C) values, top row first, and how to store them."""

    pixels: NDArray[Any]
    storage: Storage


@dataclass(frozen=True)
class Bundle:
    """A checked bundle: where it is, the whole of its material.json, and what its images' names lack of a part."""

    path: Path
    material: dict[str, Any]
    front: str = field(default="", kw_only=True)

    def has(self, name: str) -> bool:
        """Whether the bundle holds the image `name`."""
        return name in self.material["images"]

    def image_path(self, name: str) -> Path:
        """File of an image. Raises BakeError where the bundle has none of that name."""
        return self.path / require(self._entry(name), "file", str, self.path / MATERIAL)

    def load(self, name: str) -> NDArray[np.float32]:
        """Pixels (H, W, C), finite, top row first. Raises BakeError where the file is not the one baked."""
        pixels = read_image(file := self._checked(name))
        if not np.isfinite(pixels).all():
            raise BakeError(file, "holds values that are not finite", "bake it again")
        return pixels

    def check(self) -> None:
        """Raise BakeError where an image is not the one baked; no pixels are read."""
        for name in self.material["images"]:
            self._checked(name)

    def part(self, name: str, material: dict[str, Any]) -> Bundle:
        """A part of a sheet by itself, whose document lists its images of this folder without the part's name.

        Errors of it name the images as this bundle does.
        """
        return replace(self, material=material, front=f"{name}_")

    @property
    def preview(self) -> Path | None:
        """File of the preview picture, if there is one."""
        file = self.path / PREVIEW
        return file if file.is_file() and not file.is_symlink() else None

    def _checked(self, name: str) -> Path:
        """File of an image, whose content is the one baked. Raises BakeError."""
        entry, file = self._entry(name), self.image_path(name)
        _check_image(file, entry)
        if _sha256(file) != entry["sha256"]:
            raise BakeError(file, "was changed after it was baked", "bake it again")
        return file

    def _entry(self, name: str) -> dict[str, Any]:
        if not self.has(name):
            raise BakeError(self.path, f"has no image '{self.front}{name}'", "bake it again")
        return require(self.material["images"], name, dict, self.path / MATERIAL)


def _schema_of(material: Mapping[str, Any]) -> int:
    """The oldest schema whose readers understand it."""
    stored = material.get("map")
    if isinstance(stored, Mapping) and stored.get("model") == "azimuth":
        return SCHEMA
    return _SCHEMA_OF_NEW if _is_new(material) else _SCHEMA_OF_OTHERS


def _is_new(material: Mapping[str, Any]) -> bool:
    """Whether readers of an older schema would misunderstand it."""
    table, residual = material.get("table"), material.get("residual")
    grids = (table, residual.get("grid") if isinstance(residual, Mapping) else None)
    isotropic = isinstance(table, Mapping) and not table.get("anisotropic")
    times_cosines = any(isinstance(grid, Mapping) and grid.get("cosine_power") for grid in grids)
    patches = isinstance(table, Mapping) and table.get("basis") == "patches"
    return bool(_LETS_THROUGH & set(material)) or (isotropic and times_cosines) or patches


def write_bundle(
    path: str | Path,
    material: Mapping[str, Any],
    images: Mapping[str, StoredImage],
    preview: NDArray[np.uint8] | None = None,
    *,
    kind: Kind = "brdf",
) -> Path:
    """Write a bundle, or replace an older one by it in one step, and return its folder.

    Parameters
    ----------
    path : folder to write; ".mmat" is appended where it is missing; its parent must exist
    material : JSON-ready content; "schema", "kind" and "images" are added here
    images : by the names of `IMAGES`; EXR headers repeat the material
    preview : (H, W, 3) 8-bit display values
    kind : of the material

    Whatever goes wrong, a full disk or KeyboardInterrupt included, an older bundle stays as it was and
    nothing is left beside it. Anything else of that name, and a bundle with foreign files inside, is never
    replaced. Raises BakeError.
    """
    target = Path(path)
    if not target.name:
        raise BakeError(target, "is no name for a bundle", f"give NAME{SUFFIX}")
    if target.suffix.lower() != SUFFIX:
        target = target.with_name(target.name + SUFFIX)
    unknown = sorted(set(images) - set(IMAGES))
    if unknown or kind not in KINDS:
        raise BakeError(target, f"cannot hold {', '.join(unknown) or kind}", f"use {', '.join(IMAGES)}")
    document = {**material, "schema": _schema_of(material), "kind": kind}
    document.pop("images", None)
    # Without indentation, for the headers; also refuses what JSON cannot hold before anything is written.
    parameters = json.dumps(json.loads(dump_json(document, target / MATERIAL)), sort_keys=True)
    title = title_of(document, target.stem)
    with _told_as(target):
        _refuse_foreign_files(target)
        with replacing_folder(target) as folder:
            document["images"] = {
                name: _write_image(folder, name, image, parameters, target, title) for name, image in images.items()
            }
            if preview is not None:
                write_png(folder / PREVIEW, preview)
            text = dump_json(document, target / MATERIAL)
            (folder / MATERIAL).write_text(text, encoding="utf-8", newline="\n")
    return target


@contextlib.contextmanager
def staging(target: Path) -> Iterator[Path]:
    """Give an empty folder beside the bundle `target`, from which `move_bundle` puts a bundle in its place.

    The folder goes with the block. Raises BakeError where nothing can be written there, or where `target` is something
    that is never replaced, before any work is done.
    """
    with contextlib.ExitStack() as stack:
        with _told_as(target):
            _refuse_foreign_files(target)
            folder = stack.enter_context(staging_folder(target))
        yield folder


def move_bundle(whole: Path, target: Path) -> None:
    """Have a whole bundle in a folder of `staging` become `target`, in one step. Raises BakeError as `write_bundle`."""
    with _told_as(target):
        _refuse_foreign_files(target)
        publish_folder(whole, target)


@contextlib.contextmanager
def _told_as(target: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        cause = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        remedy = "check the folder, its permissions and the free space, and close programs that use it"
        raise BakeError(target, cause, remedy) from error


def _write_image(
    folder: Path, name: str, image: StoredImage, parameters: str, target: Path, title: str
) -> dict[str, Any]:
    storage = Storage(image.storage)
    file = folder / common_name(name, storage.suffix)
    if np.size(image.pixels) * 4 > MAX_IMAGE_BYTES:
        raise BakeError(target / file.name, f"exceeds {MAX_IMAGE_BYTES >> 20} MiB", "bake fewer samples")
    try:
        write_image(file, image.pixels, storage, {"image": name, "storage": storage, "material": parameters})
    except BakeError as error:  # the temporary folder's name means nothing to anybody
        raise BakeError(target / file.name, error.cause, error.remedy) from error
    height, width, channels = np.shape(image.pixels)
    sha256 = _sha256(file)
    file = file.rename(folder / unique_name(title, name, sha256, storage.suffix))
    return {
        "file": file.name,
        "width": width,
        "height": height,
        "channels": channels,
        "storage": str(storage),
        "sha256": sha256,
    }


def _refuse_foreign_files(target: Path) -> None:
    if not os.path.lexists(target):
        return
    remedy = "choose another name or remove it"
    if target.is_symlink() or not target.is_dir():
        raise BakeError(target, "is not a bundle and is not replaced", remedy)
    foreign = sorted(file for file in os.listdir(target) if not _is_ours(file))
    if foreign:
        raise BakeError(target, f"holds {foreign[0]!r}, a file that is not of a bundle, and is not replaced", remedy)
    try:
        document = load_json(target / MATERIAL)
        require(document, "schema", int, target)
        require(document, "kind", str, target)
    except BakeError as error:
        cause = f"is not a bundle and is not replaced ({MATERIAL}: {error.cause})"
        raise BakeError(target, cause, remedy) from error


def _is_ours(file: str) -> bool:
    """Whether a bundle, of any schema, holds files of this name, or systems leave them in any folder."""
    if file in {MATERIAL, PREVIEW} | _COMMON | _OF_THE_SYSTEM:
        return True
    return any(is_unique_name(file, name, storage.suffix) for name in IMAGES for storage in Storage)


def is_bundle(folder: Path) -> bool:
    """Whether a folder holds a bundle; nothing in it is checked."""
    try:
        return (folder / MATERIAL).is_file()
    except (OSError, ValueError):
        return False


def read_bundle(path: str | Path) -> Bundle:
    """Open a bundle, untrusted: its JSON, image headers and sizes are checked, no pixels are read.

    "schema", "kind" and "images" are validated here, the rest by the modules that use it. Raises BakeError.
    """
    folder = Path(path)
    try:
        recover(folder)
        if not folder.is_dir():
            raise BakeError(folder, "is not a bundle (a folder NAME.mmat)", "check the path")
        file = folder / MATERIAL
        document = load_json(file)
        schema = require(document, "schema", int, file, minimum=1)
        if schema > SCHEMA:
            cause = f"was written by a newer version (schema {schema}, known here: {SCHEMA})"
            raise BakeError(folder, cause, "update Measured Materials")
        require(document, "kind", str, file, choices=KINDS)
        for name, entry in require(document, "images", dict, file).items():
            if name not in IMAGES:
                raise BakeError(file, f"'images' names {name[:40]!r}, which no bundle has", "bake it again")
            _check_entry(name, entry, file, schema)
            _check_image(folder / entry["file"], entry)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise BakeError(folder, f"cannot be read ({error})", "check the path and its permissions") from error
    return Bundle(folder, document)


def _check_entry(name: str, entry: Any, file: Path, schema: int) -> None:
    where = f"{file}: images.{name}"
    if not isinstance(entry, dict):
        raise BakeError(where, "is not an object", "bake it again")
    storage = Storage(require(entry, "storage", str, where, choices=[str(kind) for kind in IMAGE_STORAGES]))
    common = common_name(name, storage.suffix)
    if not (schema > 2 and is_unique_name(require(entry, "file", str, where), name, storage.suffix)):
        require(entry, "file", str, where, choices=[common])
    width = require(entry, "width", int, where, minimum=1, maximum=1 << 24)
    height = require(entry, "height", int, where, minimum=1, maximum=1 << 24)
    channels = require(entry, "channels", int, where, choices=[3] if storage is Storage.RGBE else [1, 3, 4])
    if width * height * channels * 4 > MAX_IMAGE_BYTES:
        raise BakeError(where, f"declares more than {MAX_IMAGE_BYTES >> 20} MiB", "bake fewer samples")
    if not _SHA256.fullmatch(require(entry, "sha256", str, where, minimum=64, maximum=64)):
        raise BakeError(where, "'sha256' is not 64 hexadecimal digits", "bake it again")


def _check_image(file: Path, entry: Mapping[str, Any]) -> None:
    if file.is_symlink() or not file.is_file():
        raise BakeError(file, "is missing or not an ordinary file", "bake it again")
    header = read_header(file)
    for key in ("width", "height", "channels", "storage"):
        if getattr(header, key) != entry[key]:
            cause = f"has {key} {getattr(header, key)}, but {MATERIAL} says {entry[key]}"
            raise BakeError(file, cause, "bake it again")


def _sha256(file: Path) -> str:
    try:
        with open(file, "rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise BakeError(file, f"cannot be read ({error.strerror})", "check its permissions") from error
