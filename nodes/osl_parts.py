"""Parameters of the OSL shaders that describe a bundle: a whole BRDF's, or those of a part of a sheet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..bake.brdf.baked_table import BakedTable
from ..bake.brdf.modes import TABLE_OF
from ..bake.brdf.record import BrdfRecord
from ..bake.envelope.viewers import ViewerGrid
from ..bake.errors import BakeError
from ..bake.tables.table import FILTERS, Filter
from .checked_pixels import check_table, concentration_of
from .osl_parameters import cell_constants, grid_constants, share_constants, texel_constants, texture_file

# What stands before the parameters of what is reflected, and of a sheet of what comes through.
PREFIXES = ("", "Through")
# Parameters that name files.
_FILES = {f"{prefix}{name}" for prefix in PREFIXES for name in ("Table", "Sampler", "Shares", "Envelope", "Preview")}
# Where the images of a bundle are as files, by their names.
Files = Callable[[str], Path]


def part_constants(
    record: BrdfRecord,
    mode: str,
    filter: Filter | None,
    stochastic: bool,
    files: Files,
    *,
    mirror: bool = True,
    through: bool = False,
) -> dict[str, Any]:
    """Of a BRDF, or of one part of a sheet, in a mode, its pixels read and checked. Raises BakeError.

    Parameters
    ----------
    mirror : whether it has one beside native closures; in mode Preview there is none
    through : of a sheet's transmission: what is Lambertian is Translucent BSDF
    """
    constants: dict[str, Any] = {}
    if mode in TABLE_OF and mirror:
        table = record.baked(TABLE_OF[mode])
        constants |= table_constants(table, filter, stochastic, files) | sampler_constants(table, files)
    if mode in ("exact", "balanced"):
        constants |= _closure_constants(record, "Envelope", "envelope", files, through)
        if mirror and record.has("residual_share"):
            record.check_shares()
            constants["Shares"] = texture_file(files("residual_share"))
            constants |= share_constants(record.share_layout)
    if mode in ("preview", "balanced") or record.has("preview_weights"):
        constants |= _closure_constants(record, "Preview", "preview_weights", files, through)
    return constants


def table_constants(
    table: BakedTable, filter: Filter | None = None, stochastic: bool = True, files: Files | None = None
) -> dict[str, Any]:
    """Those of `measured_lookup.osl`. Raises BakeError."""
    table.bundle.load(table.part)
    chosen = table.read_by(filter)
    if chosen not in FILTERS:
        raise BakeError(table.bundle.path, f"filter cannot be {chosen[:40]!r}", f"choose from {', '.join(FILTERS)}")
    return {
        "Table": texture_file((files or table.bundle.image_path)(table.part)),
        **texel_constants(table.stored),
        **grid_constants(table.stored.grid),
        "Filter": chosen,
        "Stochastic": int(stochastic),
    }


def sampler_constants(table: BakedTable, files: Files | None = None) -> dict[str, Any]:
    """Those of `measured_sampler.osl`. Raises BakeError."""
    check_table(table)
    return {
        "Sampler": texture_file((files or table.bundle.image_path)(table.sampler)),
        "Concentration": concentration_of(table),
        **cell_constants(table.layout),
    }


def files_of(node: bpy.types.Node) -> list[str]:
    """Paths of the images that a Script node of a material reads; none of any other node."""
    if node.bl_idname != "ShaderNodeScript":
        return []
    return [socket.default_value for socket in node.inputs if socket.identifier in _FILES and socket.type == "STRING"]


def _closure_constants(record: BrdfRecord, name: str, image: str, files: Files, through: bool) -> dict[str, Any]:
    """Of the closures of one texture of weights: names, widths, and at which viewers weights are known."""
    fit = record.load_envelope() if image == "envelope" else record.load_preview()
    constants = {name: texture_file(files(image))}
    if isinstance(fit.viewers, ViewerGrid):
        widths = [(lobe.name, lobe.alpha_x, lobe.alpha_y) for lobe in fit.closures]
        azimuths, half_turn = fit.viewers.n_phi, fit.viewers.folded
    else:
        widths = [(lobe.name, lobe.p1, lobe.p1) for lobe in fit.closures]
        azimuths, half_turn = 0, False
    if through:
        widths = [("translucent", 0.0, 0.0) for _ in widths]
    words = " ".join(f"{lobe} {along:.9g} {across:.9g}" for lobe, along, across in widths)
    told = {"Nodes": fit.viewers.shape[0], "Azimuths": azimuths, "HalfTurn": int(half_turn), "Closures": words}
    return constants | {f"{name}{key}": value for key, value in told.items()}
