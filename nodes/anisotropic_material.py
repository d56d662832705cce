"""Node group: an anisotropic BRDF in the mode chosen (DESIGN.md section 5)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ..bake.brdf.record import BrdfRecord
from .anisotropic_closures import AnisotropicClosures
from .anisotropic_table import AnisotropicGroups, anisotropic_table_groups
from .brdf_group import after_diffuse
from .data_image import bundle_image
from .exact_closure import exact_closure, reference_closure
from .group import node_group
from .native_closure import choose_closure


def anisotropic_group(
    record: BrdfRecord,
    name: str,
    mode: str,
    filter: str | None,
    stochastic: bool,
    pack: bool,
    lamps: bpy.types.Image | None,
    residual: bool,
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint, Tangent) to a shader, and to one for EEVEE where there is a preview.

    Arguments as of `nodes.material.build_material`. Raises BakeError.
    """
    table = None
    if mode == "reference" or (mode != "preview" and residual):
        part = "table" if mode == "reference" else "residual"
        chosen = stochastic and part == "table"
        table = anisotropic_table_groups(record.baked(part), name, filter, chosen, pack, aimed=lamps is not None)
    envelope = _closures(record, name, "envelope", pack) if mode in ("exact", "balanced") else None
    preview = _closures(record, name, "preview_weights", pack) if record.has("preview_weights") else None

    def build(normal: Any, tint: Any, tangent: Any) -> Any:
        shown = None if preview is None else replace(preview, tangent=tangent).alone(normal, tint)
        if mode == "preview":
            return shown, shown
        traced = _traced(table, envelope, normal, tint, tangent, lamps)
        if mode == "balanced":
            traced = choose_closure(after_diffuse(), traced, shown)
        return traced if shown is None else (traced, shown)

    inputs = {"Normal": "vector", "Tint": "vector", "Tangent": "vector"}
    outputs = {"BSDF": "shader"} | ({} if preview is None else {"EEVEE": "shader"})
    return node_group(f"Measured {name}", inputs, outputs, build)


def _traced(
    table: AnisotropicGroups | None,
    envelope: AnisotropicClosures | None,
    normal: Any,
    tint: Any,
    tangent: Any,
    lamps: bpy.types.Image | None,
) -> Any:
    """Closure that is as good as the table."""
    placed = None if table is None else replace(table, tangent=tangent)
    if envelope is None:
        assert placed is not None
        return reference_closure(placed, normal, tint, lamps)
    native = replace(envelope, tangent=tangent)
    if placed is None:
        return native.alone(normal, tint)
    return exact_closure(native, placed, normal, tint, lamps)  # type: ignore[arg-type]


def _closures(record: BrdfRecord, name: str, part: str, pack: bool) -> AnisotropicClosures:
    """The "envelope" or the "preview_weights" of a bundle, read and checked before Blender loads it."""
    fit = record.load_envelope() if part == "envelope" else record.load_preview()
    image = bundle_image(record.files(), part, f"{name} {part.replace('_', ' ')}", pack=pack)
    return AnisotropicClosures(fit.closures, image, fit.viewers)
