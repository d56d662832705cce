"""Which files are the photographs of a stack."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ..errors import BakeError
from .photograph import IMAGE_SUFFIXES

MAX_PHOTOGRAPHS = 4096
_DIGITS = re.compile(r"(\d+)")
_COMPANION_SUFFIXES = {
    ".lp",
    ".csv",
    ".txt",
    ".tsv",
    ".dat",
    ".lst",
    ".md",
    ".json",
    ".xmp",
    ".ini",
    ".db",
    ".log",
    ".pp3",
    ".rst",
    ".pdf",
}
_COMPANION_STEMS = {"license", "licence", "readme", "copying", "makefile"}
_RAW_SUFFIXES = {".cr2", ".cr3", ".nef", ".arw", ".dng", ".raf", ".orf", ".rw2", ".pef", ".srw"}
_SHOWN = 3


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sorting key by which image2 comes before image10."""
    parts = _DIGITS.split(name.casefold())
    return tuple((1, int(part[:300]), part) if k % 2 else (0, 0, part) for k, part in enumerate(parts))


def find_photographs(
    source: Path | str | Sequence[Path | str], beside: Sequence[Path | None]
) -> tuple[list[Path], list[str]]:
    """Photographs of a folder in natural order, or the given ones, and warnings about what was left out.

    `beside` are files that may lie in the folder without belonging to the stack. Folders inside are not entered.
    Raises BakeError where there is none, a file is given twice, or one photograph lies there in two formats.
    """
    if isinstance(source, str | Path):
        folder = Path(source)
        paths, warnings = _in_folder(folder, beside)
    else:
        paths, warnings = [Path(entry) for entry in source], []
        folder = paths[0].parent if paths else Path("photographs")
        resolved = [str(path.absolute()) for path in paths]
        for path, key in zip(paths, resolved):
            if resolved.count(key) > 1:
                raise BakeError(path, "is given twice", "give each photograph once")
        paths.sort(key=lambda path: natural_key(path.name))
    if not paths:
        raise BakeError(folder, "holds no photograph", _where_else(folder))
    if len(paths) > MAX_PHOTOGRAPHS:
        raise BakeError(folder, f"holds {len(paths)} images, more than {MAX_PHOTOGRAPHS}", "give one stack")
    stems: dict[tuple[Path, str], Path] = {}
    for path in paths:
        other = stems.setdefault((path.parent, path.stem.casefold()), path)
        if other is not path:
            raise BakeError(folder, f"holds {other.name} and {path.name}", "keep each photograph in one format")
    return paths, warnings


def _in_folder(folder: Path, beside: Sequence[Path | None]) -> tuple[list[Path], list[str]]:
    try:
        if not folder.is_dir():
            cause = "is a file, not a folder" if folder.exists() else "does not exist"
            raise BakeError(folder, cause, "give the folder of the photographs")
        entries = sorted(folder.iterdir(), key=lambda path: natural_key(path.name))
        known = {path.resolve() for path in beside if path is not None}
        files = [e for e in entries if not e.name.startswith(".") and not e.is_dir() and e.resolve() not in known]
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: a loop of links
        reason = getattr(error, "strerror", None) or error
        raise BakeError(folder, f"cannot be read ({reason})", "check the folder and its permissions") from error
    photographs = [path for path in files if path.suffix.lower() in IMAGE_SUFFIXES]
    others = [path for path in files if path.suffix.lower() not in IMAGE_SUFFIXES and not _is_companion(path)]
    raw = [path for path in others if path.suffix.lower() in _RAW_SUFFIXES]
    if raw and not photographs:
        raise BakeError(folder, f"holds RAW files only ({raw[0].name})", "develop them to linear 16-bit TIFF")
    warnings = []
    if others:
        warnings.append(f"skipped, no photograph that can be read: {list_names([path.name for path in others])}")
    return photographs, warnings


def list_names(names: Sequence[str]) -> str:
    """The first few of many names."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _is_companion(path: Path) -> bool:
    return (
        path.suffix.lower() in _COMPANION_SUFFIXES or path.stem.lower() in _COMPANION_STEMS or path.name == "Thumbs.db"
    )


def _where_else(folder: Path) -> str:
    try:
        inside = sorted(path.name for path in folder.iterdir() if path.is_dir())
    except OSError:
        inside = []
    if inside:
        return f"folders inside are not entered: give {list_names(inside)}"
    return "give a folder of JPEG, PNG, TIFF, EXR or HDR files"
