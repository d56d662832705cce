"""Whether an image holds the very file that its material was built with.

Blender exchanges files without a word: *Find Missing Files* takes the first one of that name, *Unpack Resources* writes
or finds one in a folder that other materials use too.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy

from ...nodes.data_image import content_of

# By image: what distinguished its file from another at the last look, and the file's SHA-256.
_known: dict[int, tuple[Any, str]] = {}
_MOST = 4096


def is_of_content(image: bpy.types.Image, sha256: str, *, anew: bool = False) -> bool:
    """Whether the image's file, packed or not, has this SHA-256; so also where there is none, which others report.

    A file is hashed once, until its size, time or place changes: panels ask at every redraw.

    Parameters
    ----------
    anew : hash it in any case: whatever changed the file may have kept all that
    """
    found = _content(image, anew)
    return found is None or found == sha256


def forget() -> None:
    """Another .blend has its own images."""
    _known.clear()


def file_of(image: bpy.types.Image) -> Path:
    """Whole path of the image's file."""
    return Path(bpy.path.abspath(image.filepath, library=image.library))


def _content(image: bpy.types.Image, anew: bool) -> str | None:
    """SHA-256 of the image's file; None where there is none, or none to be read."""
    packed = image.packed_file
    try:
        state: Any
        if packed is not None:
            state = packed.as_pointer(), packed.size, image.filepath
        else:
            path = file_of(image)
            status = os.stat(path)
            state = str(path), status.st_size, status.st_mtime_ns, status.st_ino
        known = _known.get(image.session_uid)
        if anew or known is None or known[0] != state:
            known = state, content_of(packed.data if packed is not None else path.read_bytes())
            if len(_known) >= _MOST:
                _known.clear()
            _known[image.session_uid] = known
    except (OSError, ValueError):
        return None
    return known[1]
