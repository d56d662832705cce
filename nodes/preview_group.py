"""Node group: what EEVEE and the viewport show of a material whose Cycles output they cannot, as one of OSL."""

from __future__ import annotations

import bpy

from ..bake.brdf.record import BrdfRecord
from .brdf_group import BrdfParts, brdf_group
from .data_image import Images
from .sheet_build import SheetBuild, closures_of


def preview_group(record: BrdfRecord, name: str, images: Images) -> bpy.types.ShaderNodeTree | None:
    """The group of mode Preview, of the inputs of `brdf_group.brdf_inputs`; None where the bundle holds no preview.

    Raises BakeError where that cannot be read.
    """
    if not all(part.has("preview_weights") for part in record.tables):
        return None
    if record.sheet is not None:
        build = SheetBuild("preview", None, stochastic=False, residual=False, lamps=None)
        return build.group(record, f"{name} Preview", images, normals=False)
    preview = closures_of(record, "preview_weights", images)
    return brdf_group(f"Measured {name} Preview", "preview", BrdfParts(preview=preview, anisotropic=record.anisotropic))
