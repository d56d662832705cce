"""Node group: an anisotropic BRDF in the mode chosen (DESIGN.md section 5)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ..bake.bundle import Bundle
from .anisotropic_table import anisotropic_table_groups
from .exact_closure import reference_closure
from .group import node_group


def anisotropic_group(
    bundle: Bundle,
    name: str,
    mode: str,
    filter: str | None,
    stochastic: bool,
    pack: bool,
    lamps: bpy.types.Image | None,
    residual: bool,
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint, Tangent) to a shader; arguments as of `nodes.material.build_material`. Raises BakeError."""
    table = anisotropic_table_groups(bundle, name, filter, stochastic, pack, aimed=lamps is not None)

    def build(normal: Any, tint: Any, tangent: Any) -> Any:
        return reference_closure(replace(table, tangent=tangent), normal, tint, lamps)

    inputs = {"Normal": "vector", "Tint": "vector", "Tangent": "vector"}
    return node_group(f"Measured {name}", inputs, {"BSDF": "shader"}, build)
