"""What a bundle is made by, as one number: of equal content, settings and version it need not be baked again."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from .. import VERSION
from ..errors import BakeError
from .origin import Origin

RECIPE = "recipe"
"""Its entry in material.json."""


def recipe_of(settings: Any, origin: Origin, beside: Iterable[Path] = ()) -> str:
    """SHA-256 of all that decides what a bake writes, in hexadecimal.

    Parameters
    ----------
    settings : a dataclass; files that it names count by their names and contents, folders by those of their files
    origin : of the source, as `bake.bundle.origin` states it
    beside : further files that are read, such as one of lights

    Raises BakeError where a file cannot be read.
    """
    told = [VERSION, _plain(dict(origin)), _plain(settings), [_plain(path) for path in beside]]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """JSON-ready: dataclasses differ by type and content, files by name and content; a tuple is as its list."""
    if dataclasses.is_dataclass(value):
        entries = {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {"": type(value).__name__, **entries}
    if isinstance(value, Path):
        return [value.name, content_of(value)]
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, enum.Enum) else value


def content_of(path: Path) -> str:
    """SHA-256 of a file, or of names and contents of the files in a folder, not below it. Raises BakeError."""
    try:
        if not path.is_dir():
            with open(path, "rb") as stream:
                return hashlib.file_digest(stream, "sha256").hexdigest()
        digest = hashlib.sha256()
        for file in sorted(path.iterdir(), key=lambda file: file.name):
            if file.is_file() and not file.name.startswith("."):
                digest.update(json.dumps([file.name, content_of(file)]).encode())
        return digest.hexdigest()
    except (OSError, ValueError) as error:
        cause = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise BakeError(path, cause, "check the path and its permissions") from error
