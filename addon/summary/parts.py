"""What is told of a baked material, part by part: in this order by the panel and by `inspect`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...bake.brdf.record import BrdfRecord
from ...bake.shading_maps.record import Record
from . import brdf_rows, shading_map_rows
from .brdf_rows import Rows
from .sheet_rows import sheet_rows

_BRDF: tuple[Callable[[Any], Rows], ...] = (
    brdf_rows.source_rows,
    brdf_rows.error_rows,
    brdf_rows.envelope_rows,
    brdf_rows.table_rows,
    brdf_rows.albedo_rows,
    sheet_rows,
    brdf_rows.size_rows,
)
_SHADING_MAP: tuple[Callable[[Any], Rows], ...] = (
    brdf_rows.source_rows,
    shading_map_rows.photograph_rows,
    shading_map_rows.map_rows,
    shading_map_rows.energy_rows,
    shading_map_rows.map_error_rows,
    shading_map_rows.lighting_rows,
    shading_map_rows.through_rows,
    brdf_rows.albedo_rows,
    brdf_rows.size_rows,
    shading_map_rows.warning_rows,
)


def parts_of(record: Record) -> list[Rows]:
    """Label and value pairs, in parts that belong together; parts of which nothing is known are left out."""
    kind = _BRDF if isinstance(record, BrdfRecord) else _SHADING_MAP
    return [rows for rows in (part(record) for part in kind) if rows]
