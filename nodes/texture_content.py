"""Whether an image holds the very file that its material was built with.

Blender exchanges files without a word: *Find Missing Files* takes the first one of that name, *Unpack Resources* writes
or finds one in a folder that other materials use too.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

# By image or file: what distinguished it from another at the last look, and its SHA-256.
_known: dict[Any, tuple[Any, str]] = {}
_MOST = 4096


def is_of_content(image: bpy.types.Image, sha256: str, *, anew: bool = False) -> bool:
    """Whether the image's file, packed or not, has this SHA-256; so also where there is none, which others report.

    A file is hashed once, until its size, time or place changes: panels ask at every redraw.

    Parameters
    ----------
    anew : hash it in any case: whatever changed the file may have kept all that
    """
    found = image_content(image, anew=anew)
    return found is None or found == sha256


def forget() -> None:
    """Another .blend has its own images."""
    _known.clear()


def file_of(image: bpy.types.Image) -> Path:
    """Whole path of the image's file."""
    return Path(bpy.path.abspath(image.filepath, library=image.library))


def image_content(image: bpy.types.Image, *, anew: bool = False) -> str | None:
    """SHA-256 of the image's file, packed or not; None where there is none, or none to be read."""
    packed = image.packed_file
    if packed is None:
        return file_content(file_of(image), anew=anew)
    state = packed.as_pointer(), packed.size, image.filepath
    return _once(image.session_uid, state, lambda: content_of(packed.data), anew)


def file_content(path: Path, *, anew: bool = False) -> str | None:
    """SHA-256 of a file; None where it is not to be read."""
    try:
        status = os.stat(path)
        state = status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino
        return _once(str(path), state, lambda: content_of(path.read_bytes()), anew)
    except (OSError, ValueError):
        return None


def content_of(data: bytes) -> str:
    """SHA-256 of a file of these bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def _once(key: Any, state: Any, read: Callable[[], str], anew: bool) -> str:
    """What `read` gives, read again only where the state is another."""
    known = _known.get(key)
    if anew or known is None or known[0] != state:
        known = state, read()
        if len(_known) >= _MOST:
            _known.clear()
        _known[key] = known
    return known[1]
