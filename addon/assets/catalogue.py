"""The catalogues of an asset library: one file beside its .blend files, which Blender and artists write as well.

Each line is `UUID:path/of/catalogue:simple name`; see "Asset Catalogs" in Blender's manual.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from uuid import NAMESPACE_URL, UUID, uuid5

from ...bake.atomic_write import replacing_file
from ...bake.errors import BakeError

FILE = "blender_assets.cats.txt"
ROOT = "Measured Materials"
_VERSION = "VERSION 1"
_HEAD = (
    "# Catalogues of an asset library of Blender. Empty lines and lines that begin with # are ignored;\n"
    "# the others are UUID:catalogue/path:simple name.\n\n"
    f"{_VERSION}\n\n"
)
_LARGEST = 1 << 24  # bytes; what is larger lists no catalogues


def catalogue_id(path: str) -> str:
    """The number of a catalogue of ours: the same on every machine, so that libraries can be put together."""
    return str(uuid5(NAMESPACE_URL, f"measured_materials:{path}"))


def library_of(blend: Path, libraries: Iterable[Path]) -> Path:
    """The folder whose catalogues Blender reads for a .blend: the asset library that it lies in, else its own.

    Parameters
    ----------
    libraries : folders that the preferences list, in their order
    """
    for library in libraries:
        if os.path.normcase(library) in map(os.path.normcase, blend.parents):
            return library
    return blend.parent


def add_catalogue(folder: Path, path: str) -> str:
    """The number of the catalogue `path` in the library `folder`, made there with those above it if there is none.

    Whatever else is in the file stays as it is, letter for letter; nothing is written where all is there. A catalogue
    of ours that an artist has renamed is known by its number, one of the artist's own by its path. Raises BakeError.
    """
    file = folder / FILE
    try:
        text = _read(file)
        known = _catalogues(text, file)
        above = path.split("/")
        missing = []
        for count in range(1, len(above) + 1):
            name = "/".join(above[:count])
            if catalogue_id(name) not in known and name not in known.values():
                missing.append(f"{catalogue_id(name)}:{name}:{name.replace('/', '-')}")
        if missing:
            _write(file, text, missing)
    except OSError as error:
        raise BakeError(file, f"cannot be written: {error.strerror or error}", "see to its folder") from error
    own = catalogue_id(path)
    return own if own in known else next((uid for uid, name in known.items() if name == path), own)


def _read(file: Path) -> str:
    """All of it as it stands, empty if there is none. Raises OSError, BakeError."""
    try:
        if file.stat().st_size > _LARGEST:
            raise BakeError(file, "is too large to list catalogues", "move it away")
        # Not as lines, which would lose how they end.
        return file.read_bytes().decode()
    except FileNotFoundError:
        return ""
    except UnicodeDecodeError as error:
        raise BakeError(file, "is no text in UTF-8", "move it away, or save it again as UTF-8") from error


def _catalogues(text: str, file: Path) -> dict[str, str]:
    """Paths by number, as far as lines can be read. Raises BakeError where they are of an unknown version."""
    found: dict[str, str] = {}
    for line in (line.strip() for line in text.lstrip("\ufeff").splitlines()):
        if line.startswith("VERSION") and line != _VERSION:
            raise BakeError(file, f"is of {line[:20]}, which is not known here", "make the catalogue in Blender")
        uid, colon, rest = line.partition(":")
        if line.startswith("#") or not colon:
            continue
        try:
            found[str(UUID(uid.strip()))] = "/".join(part.strip() for part in rest.partition(":")[0].split("/"))
        except ValueError:  # a line that Blender ignores as well
            continue
    return found


def _write(file: Path, text: str, lines: list[str]) -> None:
    newline = "\r\n" if "\r\n" in text else "\n"
    text = text or _HEAD
    if not text.endswith("\n"):
        text += newline
    with replacing_file(file) as temporary:
        temporary.write_bytes((text + "".join(line + newline for line in lines)).encode())
