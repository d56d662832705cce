"""Materials of bundles that are there already: which folders are meant, and what is made of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import bpy

from ....bake.brdf.common import kind_of as kind_told
from ....bake.bundle.bundle import SUFFIX, is_bundle, read_bundle
from ....bake.bundle.result import BakeResult
from ....bake.errors import BakeError
from ...material.bake_material import material_from
from ...material.bake_photographs import swatch_from


def load_bundle(path: Path, *, pack: bool) -> bpy.types.Material:
    """The material of a bundle, whatever its kind. Raises BakeError."""
    bundle = read_bundle(path)
    result = BakeResult(bundle.path, bundle.material, 0.0)
    if kind_told(bundle.material) == "shading_map":
        return swatch_from(result, None, pack=pack)
    return material_from(result, pack=pack)


def bundles_meant(chosen: Iterable[Path]) -> tuple[list[Path], list[BakeError]]:
    """Bundles that an artist means by these paths, each once, and what is none.

    A path may be a bundle, a file in it, as a file browser cannot choose a folder without entering it, or a folder with
    bundles.
    """
    found: dict[Path, None] = {}
    errors = []
    for path in chosen:
        meant = _meant(path)
        if not meant:
            errors.append(BakeError(path, f"is not a bundle (a folder NAME{SUFFIX})", "choose a baked material"))
        found |= dict.fromkeys(meant)
    return list(found), errors


def _meant(path: Path) -> list[Path]:
    if is_bundle(path):
        return [path]
    try:
        if path.is_dir():
            return sorted(inner for inner in path.iterdir() if inner.suffix.lower() == SUFFIX and is_bundle(inner))
    except (OSError, ValueError):
        return []
    return [path.parent] if is_bundle(path.parent) else []
