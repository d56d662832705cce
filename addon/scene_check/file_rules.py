"""Whether the open .blend loaded whole: what is missing takes no part in the picture, and cannot be checked."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

import bpy

from .findings import WRONG, Finding

LIBRARY, LINKED, IMAGE = "missing_library", "missing_linked", "missing_image"
_SHOWN = 3
_TILE = re.compile("<UDIM>|<UVTILE>")


def missing_parts() -> list[Finding]:
    """Libraries, linked datablocks and images that the .blend names and that are not there."""
    return [*_libraries(), *_linked(), *_images()]


def not_whole(findings: Iterable[Finding]) -> list[Finding]:
    """Findings that say the file did not load whole, as of `missing_parts`."""
    return [finding for finding in findings if finding.rule in (LIBRARY, LINKED, IMAGE)]


def with_missing_parts(found: list[Finding] | None) -> list[Finding] | None:
    """The findings of a scene and those of the file, each once; None where there are neither."""
    told = {finding.where for finding in found or ()}
    missing = [finding for finding in missing_parts() if finding.where not in told]
    return found if not missing else [*missing, *(found or ())]


def _libraries() -> list[Finding]:
    why = "what was linked from it is not in the picture, and its materials cannot be checked"
    return [
        Finding(LIBRARY, WRONG, f"library {library.name}", f"file {library.filepath} is not there", "", why)
        for library in bpy.data.libraries
        if library.is_missing
    ]


def _linked() -> list[Finding]:
    """Datablocks that a library no longer holds; a missing library's go without saying."""
    lost: dict[bpy.types.Library, list[str]] = {}
    for block in bpy.data.user_map():
        if block.is_missing and block.library is not None and not block.library.is_missing:
            lost.setdefault(block.library, []).append(f"{block.id_type.replace('_', ' ').lower()} {block.name}")
    found = []
    for library, names in lost.items():
        shown = sorted(names)[:_SHOWN]
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        words = f"{library.filepath} holds no {', '.join(shown)}{more}"
        why = "what was linked is not in the picture, and its materials cannot be checked"
        found.append(Finding(LINKED, WRONG, f"library {library.name}", words, "", why))
    return found


def _images() -> list[Finding]:
    return [
        # Named as the scene check names textures of measured materials, which it can fix.
        Finding(IMAGE, WRONG, f"texture {i.name}", f"file {i.filepath} is not there", "", "whatever shows it is pink")
        for i in bpy.data.images
        if i.users > i.use_fake_user and not i.is_missing and not i.packed_files and _is_lost(i)
    ]


def _is_lost(image: bpy.types.Image) -> bool:
    """Whether a file that the image is read from is not there."""
    path = bpy.path.abspath(image.filepath, library=image.library)
    if image.source == "TILED":
        return not all(os.path.isfile(_TILE.sub(str(tile.number), path)) for tile in image.tiles)
    if image.source == "SEQUENCE":
        return not os.path.isfile(path) and not _is_sequence(Path(path))
    return image.source in ("FILE", "MOVIE") and not os.path.isfile(path)


def _is_sequence(path: Path) -> bool:
    """Whether the folder holds any frame of the sequence that this one would belong to."""
    head, _, tail = re.fullmatch(r"(.*?)(\d*)(\D*)", path.name, re.DOTALL).groups()  # type: ignore[union-attr]
    frame = re.compile(rf"{re.escape(head)}\d+{re.escape(tail)}")
    try:
        return any(frame.fullmatch(name) for name in os.listdir(path.parent))
    except OSError:
        return False
