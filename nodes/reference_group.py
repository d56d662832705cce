"""Node group: a tabulated BRDF by mirror alone, every sample exact (DESIGN.md section 5)."""

from __future__ import annotations

from typing import Any

import bpy

from . import expr
from .group import call, node_group
from .table_groups import TableGroups


def reference_group(
    name: str,
    table: TableGroups,
    lamps: bpy.types.Image | None = None,
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint) to a shader: the tabulated BRDF, mirror only.

    Parameters
    ----------
    table : of the BRDF; its density is needed with `lamps`
    lamps : table of lamps to aim at
    """

    def build(normal: Any, tint: Any) -> Any:
        drawn = table.draw(normal, lamps)
        gain = expr.divide(drawn.cosine, drawn.pdf)
        weight = expr.scale(call(table.lookup, drawn.wi, drawn.wo, drawn.random[0]), gain) * tint
        return drawn.mirror(weight)

    return node_group(name, {"Normal": "vector", "Tint": "vector"}, {"BSDF": "shader"}, build)
