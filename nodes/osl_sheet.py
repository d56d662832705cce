"""A sheet's material of OSL: one script for each side that differs, both of them told apart by a third."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..bake.brdf.record import BrdfRecord
from ..bake.source import SheetPart
from ..bake.tables.table import Filter
from .data_image import of_part
from .osl_aim import Lights, aimed_inputs
from .osl_parts import PREFIXES, Files, part_constants
from .osl_script import output, script_node, shader_source
from .sheet_build import needs_mirror, white_sky
from .sheet_group import held_share

SHADER, SIDES = "measured_sheet.osl", "measured_sides.osl"


def sheet_shader(
    record: BrdfRecord, mode: str, filter: Filter | None, files: Files | None, lights: Lights | None
) -> Callable[[dict[str, Any]], Any]:
    """What makes the sheet's closure, of the sockets of its group and what else both sides share. Raises BakeError.

    Parameters
    ----------
    files : where OSL is to read the bundle's images; by default the bundle's own
    lights : to be aimed at or sampled; None where none are
    """
    assert record.sheet is not None
    files = files or record.files().image_path
    sides = [_side(record, record.part("through"), mode, filter, files, ("", "through"))]
    if not record.sheet.alike:
        behind = record.part("behind"), record.part("through_behind")
        sides.append(_side(*behind, mode, filter, files, ("behind", "through_behind")))
    source = shader_source(SHADER)

    def shown(constants: dict[str, Any], inputs: dict[str, Any]) -> Any:
        given = inputs | constants | {"Anisotropic": int(record.anisotropic)}
        if lights is not None and (parts := [part for part in PREFIXES if f"{part}Table" in constants]):
            given |= aimed_inputs(given, lights, parts)
        return output(script_node(SHADER, source, given), "BSDF")

    def make(inputs: dict[str, Any]) -> Any:
        seen = [shown(side, inputs) for side in sides]
        if len(seen) < 2:
            return seen[0]
        return output(script_node(SIDES, shader_source(SIDES), dict(zip(("Front", "Back"), seen, strict=True))), "BSDF")

    return make


def leads_through(node: bpy.types.Node) -> bool:
    """Whether a node is a sheet's script that sends paths on through it."""
    if node.bl_idname != "ShaderNodeScript":
        return False
    return any(socket.identifier == f"{PREFIXES[1]}Table" and socket.default_value for socket in node.inputs)


def _side(
    reflected: BrdfRecord | None,
    through: BrdfRecord | None,
    mode: str,
    filter: Filter | None,
    files: Files,
    names: tuple[SheetPart | str, SheetPart],
) -> dict[str, Any]:
    """Parameters of what is seen of one side."""
    both = [0.0 if record is None else white_sky(record) for record in (reflected, through)]
    side: dict[str, Any] = {"Mode": mode, "Share": held_share(both[0] / max(sum(both), 1e-9))}
    for prefix, record, light, name in zip(PREFIXES, (reflected, through), both, names, strict=True):
        if record is None or not light:
            continue
        of_table = mode == "reference"
        constants = part_constants(
            record,
            mode,
            filter,
            # A residual's ridges lie elsewhere in the next slice, and few samples pay for blending.
            of_table,
            of_part(files, name),
            mirror=of_table or needs_mirror(record),
            through=prefix != "",
        )
        side |= {f"{prefix}{key}": value for key, value in constants.items()}
    return side
