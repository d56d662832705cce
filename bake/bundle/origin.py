"""What a bundle was baked from, so that one of another source is not replaced by it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import BakeError
from ..photographs.folder import find_photographs
from .checked_json import dump_json, load_json

Origin = Mapping[str, Any]
_DOCUMENT = "material.json"


def file_origin(file: str | Path, material: str = "") -> dict[str, str]:
    """Name and SHA-256 of a measurement; its folder is nobody else's business. Raises OSError.

    `material` is the file's own name of the one that was chosen among several in it.
    """
    with open(file, "rb") as stream:
        found = {"file": Path(file).name, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}
    return found | ({"material": material} if material else {})


def photographs_origin(source: str | Path | Sequence[Path]) -> dict[str, str]:
    """SHA-256 of a stack: of the names and contents of all photographs there; none where they cannot be read.

    Bundles had none before schema 3.
    """
    digest = hashlib.sha256()
    try:
        for path in sorted(find_photographs(source, ())[0], key=lambda path: path.name):
            digest.update(json.dumps([path.name, file_origin(path)["sha256"]]).encode())
    except (BakeError, OSError, ValueError):
        return {}
    return {"sha256": digest.hexdigest()}


def model_origin(name: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Origin of a formula: its name and its parameters, as a bundle holds them. Raises BakeError."""
    plain: dict[str, Any] = json.loads(dump_json({"name": name, "facts": dict(facts)}, name))
    return plain


def refuse_another(target: Path, origin: Callable[[], Origin]) -> None:
    """Raise BakeError where a bundle of another source has this name; whatever is no bundle is left to the writer.

    `origin` is asked only where there is a bundle: gigabytes of photographs take a while to read.
    """
    try:
        source = load_json(target / _DOCUMENT).get("source")
    except (BakeError, OSError, ValueError):
        return
    if isinstance(source, dict) and not is_same(source, origin()):
        kept = source.get("file", source.get("name"))
        what = f"holds a bake of another {str(kept)[:60]!r}" if isinstance(kept, str) else "holds another bake"
        raise BakeError(
            target, f"{what} and is not replaced", "give another --out NAME.mmat, or --replace to replace it"
        )


def is_same(kept: Origin, given: Origin) -> bool:
    """Whether two bundles' sources are one: by content where both state it, else by name and parameters."""
    if "sha256" in kept and "sha256" in given:
        return bool(kept["sha256"] == given["sha256"]) and kept.get("material") == given.get("material")
    told = [key for key in ("name", "facts") if key in given]
    return bool(told) and all(kept.get(key) == given[key] for key in told)


def mark_of(source: Origin) -> str:
    """A short ASCII text for what a picture shows: the same for all bakes of one source."""
    keys = ("sha256", *(["material"] if "material" in source else ())) if "sha256" in source else ("name", "facts")
    told = {key: source.get(key) for key in keys}
    return "measured_materials " + hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:32]
