"""The material of a bundle that was baked before, whatever its kind."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...bake.brdf.common import kind_of
from ...bake.bundle.bundle import read_bundle
from ...bake.bundle.result import BakeResult
from .bake_material import material_from
from .bake_photographs import swatch_from


def load_bundle(path: Path, *, pack: bool) -> bpy.types.Material:
    """The material of a bundle, whatever its kind. Raises BakeError."""
    bundle = read_bundle(path)
    result = BakeResult(bundle.path, bundle.material, 0.0)
    if kind_of(bundle.material) == "shading_map":
        return swatch_from(result, None, pack=pack)
    return material_from(result, pack=pack)
