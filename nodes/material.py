"""A bundle as a Cycles material."""

from __future__ import annotations

import bpy

from ..bake.brdf.modes import TABLE_OF
from ..bake.brdf.record import BrdfRecord
from ..bake.bundle.bundle import Bundle
from ..bake.errors import BakeError
from ..bake.tables.table import Filter
from .brdf_group import BrdfParts, brdf_group
from .checked_pixels import check_shares
from .data_image import Images, bundle_images
from .feature_passes import albedo_polynomial, with_feature_outputs
from .lamp_light_groups import LightTables
from .lamp_share_group import LampShares
from .material_tree import build_from, lit_by_emission
from .osl_script import require_osl
from .sheet_build import SheetBuild, closures_of
from .table_groups import table_groups
from .world_picture import Surroundings


def build_material(
    source: Bundle | BrdfRecord,
    material: bpy.types.Material | None = None,
    *,
    filter: Filter | None = None,
    stochastic: bool = True,
    images: Images | None = None,
    pack: bool = False,
    lamps: bpy.types.Image | None = None,
    mode: str | None = None,
    residual: bool = True,
    features: bool = False,
    normals: bool = False,
    lamp_share: bool = False,
    lights: bpy.types.Image | None = None,
    surroundings: Surroundings | None = None,
    scripted: bool = False,
) -> bpy.types.Material:
    """Build or rebuild a material from a bundle.

    Parameters
    ----------
    source : the bundle's record, or the bundle, which is then read
    material : to rebuild in place, so that objects keep it; a new one by default
    filter : "nearest", "trilinear" or "bspline"; by default the bundle's
    stochastic : choose among slices at random instead of blending them (unbiased, fewer taps)
    images : the textures; by default those of the bundle, loaded
    pack : store the textures that are loaded inside the .blend
    lamps : table of the scene's lamps to aim at, see `bake.sampling.lamps`
    mode : of `bake.brdf.modes.MODES`; by default `usual_mode`
    residual : in modes "exact" and "balanced", whether a mirror carries what the native closures leave
    features : also write the passes of `feature_passes`, for the denoiser
    normals : mark the surface for the Normal pass of a view layer too, see `surface_marker`; bakes need no asking
    lamp_share : let the mirror's probability follow the residual's share of the strongest of `lamps`, where the bundle
        holds it: it pays where hardly any other light arrives
    lights : table of what the lamps emit, see `bake.sampling.lamp_light`, where the shader is to sample them; that
        takes `lamps`, a mirror beside native closures, and Blender 5.1 or `scripted` rays
    surroundings : the world's picture, to be sampled too; used with `lights` only
    scripted : a script of OSL asks what rays meet, in any Blender. All else is nodes, whose textures have to be packed
        where Open Shading Language is on; where it is off no light is sampled

    Raises
    ------
    BakeError : the bundle does not describe a table this version knows, or holds not what the mode needs, or this
        Blender has no OSL for a script
    """
    if scripted:
        require_osl()
    record = BrdfRecord.of(source)
    mode = mode or usual_mode(record)
    missing = [name for name in _NEEDS[mode] if not record.has(name)]
    if missing:
        raise BakeError(record.where, f"mode {mode} needs its {missing[0]}, which it does not hold", "bake it again")

    def make(name: str) -> bpy.types.ShaderNodeTree:
        textures = images or bundle_images(record.files(), name, pack=pack)
        if record.sheet is not None:
            tables = None
            if lights is not None and lamps is not None:
                tables = LightTables(lamps, lights, surroundings, scripted, sheet=True)
            shared = lamp_share and lamps is not None
            build = SheetBuild(mode, filter, stochastic, residual, lamps, shared, tables)
            sheet = build.group(record, name, textures, normals=normals)
            return with_feature_outputs(sheet, albedo_polynomial(record)) if features else sheet
        table = None
        if mode == "reference" or (mode != "preview" and residual):
            part = TABLE_OF[mode]
            # A residual's ridges lie elsewhere in the next slice, and few samples pay for blending.
            chosen = stochastic and part == "table"
            table = table_groups(record.baked(part), name, textures, filter, chosen, aimed=lamps is not None)
        envelope = closures_of(record, "envelope", textures) if mode in ("exact", "balanced") else None
        preview = closures_of(record, "preview_weights", textures) if record.has("preview_weights") else None
        shares = None
        sampled = lights is not None and lamps is not None and envelope is not None and table is not None
        local = lamp_share and not sampled and lamps is not None and envelope is not None and table is not None
        if local and record.has("residual_share"):
            check_shares(record)
            shares = LampShares(textures("residual_share"), record.share_layout)
        direct, around = (lights, surroundings) if sampled else (None, None)
        parts = BrdfParts(
            table, envelope, preview, lamps, shares, direct, around, record.anisotropic, normals, scripted
        )
        group = brdf_group(f"Measured {name}", mode, parts)
        return with_feature_outputs(group, albedo_polynomial(record)) if features else group

    built = build_from(record, material, make)
    samples = lights is not None and lamps is not None
    lit_by_emission(built, samples and mode in ("exact", "balanced") and residual)
    return built


_NEEDS = {
    "preview": ("preview_weights",),
    "balanced": ("envelope", "residual", "preview_weights"),
    "exact": ("envelope", "residual"),
    "reference": ("table",),
}


def usual_mode(record: BrdfRecord) -> str:
    """The mode of a material of which nothing else was said: "exact" where the bundle holds an envelope."""
    return "exact" if record.has("envelope") else "reference"
