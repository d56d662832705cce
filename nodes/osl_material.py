"""A bundle as a Cycles material of one OSL shader: the twin of `nodes.material`, on the CPU.

Its textures are files, named by their whole path, for OSL cannot read what is packed into a .blend: where they are
moved the material must be built again. The tables of lamps and world alone come through image nodes (`nodes.osl_aim`).
They live in the .blend and change with edits and frames; OSL's texture system would show a file as it was when first
read.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..bake.brdf.baked_table import BakedTable
from ..bake.brdf.common import kind_of
from ..bake.brdf.modes import MODES
from ..bake.brdf.record import BrdfRecord
from ..bake.bundle.bundle import MATERIAL, Bundle
from ..bake.envelope.viewers import ViewerGrid
from ..bake.errors import BakeError
from ..bake.tables.table import FILTERS
from . import expr
from .adjustments import LIMITS, NEUTRAL
from .brdf_group import brdf_inputs
from .group import node_group
from .lens_group import lens_numbers
from .material import usual_mode
from .material_tree import build_from, lit_by_emission
from .osl_aim import aimed_inputs
from .osl_parameters import cell_constants, grid_constants, share_constants, texel_constants, texture_file
from .osl_script import output, script_node, shader_source
from .world_picture import Surroundings

SHADER = "measured_material.osl"
# Where the images of a bundle are as files, by their names.
Files = Callable[[str], Path]


def build_osl_material(
    source: Bundle | BrdfRecord,
    material: bpy.types.Material | None = None,
    *,
    mode: str | None = None,
    lamps: bpy.types.Image | None = None,
    lights: bpy.types.Image | None = None,
    surroundings: Surroundings | None = None,
    points: int = 1,
    filter: str | None = None,
    stochastic: bool = True,
    files: Files | None = None,
    normals: bool = False,
) -> bpy.types.Material:
    """Build or rebuild a material from a bundle, as `nodes.material.build_material` does, of OSL.

    It shows in scenes that `osl_script.use_osl` has prepared, and is black in others.

    Parameters
    ----------
    source : the bundle's record, or the bundle, which is then read
    material : to rebuild in place, so that objects keep it; a new one by default
    mode : of `bake.brdf.modes.MODES`; by default `nodes.material.usual_mode`
    lamps : table of the scene's lamps to aim at, see `bake.sampling.lamps`
    lights : table of what they emit, see `bake.sampling.lamp_light`: modes "exact" and "balanced" then sample lamps
        themselves. The lamps have to be those that `addon.lights.exact_lamps` finds exact
    surroundings : the world's picture, where the material samples that too; used with `lights` only
    points : of each lamp that are sampled
    filter : "nearest", "trilinear" or "bspline"; by default the bundle's
    stochastic : choose among slices at random instead of blending them
    files : where OSL is to read the bundle's images; by default the bundle's own
    normals : as in `nodes.material.build_material`

    Raises
    ------
    BakeError : this Blender has no OSL, the bundle does not describe a table this version knows, or holds not what the
        mode needs
    """
    if isinstance(source, Bundle) and kind_of(source.material) != "brdf":
        raise BakeError(source.path / MATERIAL, "only BRDFs have an OSL material", "build it of nodes")
    record = BrdfRecord.of(source)
    mode = mode or usual_mode(record)
    if mode not in MODES:
        raise BakeError("mode", f"cannot be {mode!r}", f"choose from {', '.join(MODES)}")
    constants = shader_constants(record, mode, filter, stochastic, files)
    interface = brdf_inputs(record.anisotropic)

    def build(*values: Any) -> Any:
        inputs = dict(zip(interface, values)) | constants | {"Normals": int(normals)}
        if mode != "preview":
            inputs["Lens"] = expr.vec(*lens_numbers())
        if lamps is not None and mode != "preview":
            inputs |= aimed_inputs(inputs, lamps, lights, surroundings) | {
                "Points": points if lights is not None else 0
            }
        return output(script_node(SHADER, shader_source(SHADER), inputs), "BSDF")

    def make(name: str) -> bpy.types.ShaderNodeTree:
        return node_group(f"Measured {name} OSL", interface, {"BSDF": "shader"}, build, NEUTRAL, limits=LIMITS)

    built = build_from(record, material, make)
    # Cycles takes any shader that may emit for a lamp, whether it does or not.
    lit_by_emission(built, True)
    return built


def shader_constants(
    record: BrdfRecord, mode: str, filter: str | None = None, stochastic: bool = True, files: Files | None = None
) -> dict[str, Any]:
    """Parameters of the shader that describe the bundle, its pixels read and checked. Raises BakeError."""
    files = files or record.files().image_path
    constants: dict[str, Any] = {"Mode": mode, "Anisotropic": int(record.anisotropic)}
    if mode != "preview":
        table = record.baked("table" if mode == "reference" else "residual")
        constants |= table_constants(table, filter, stochastic, files) | sampler_constants(table, files)
    if mode in ("exact", "balanced"):
        constants |= _closure_constants(record, "Envelope", "envelope", files)
        if record.has("residual_share"):
            record.check_shares()
            constants["Shares"] = texture_file(files("residual_share"))
            constants |= share_constants(record.share_layout)
    if mode in ("preview", "balanced") or record.has("preview_weights"):
        constants |= _closure_constants(record, "Preview", "preview_weights", files)
    return constants


def table_constants(
    table: BakedTable, filter: str | None = None, stochastic: bool = True, files: Files | None = None
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
    table.load_sampler()
    return {"Sampler": texture_file((files or table.bundle.image_path)(table.sampler)), **cell_constants(table.layout)}


def _closure_constants(record: BrdfRecord, name: str, image: str, files: Files) -> dict[str, Any]:
    """Of the closures of one texture of weights: names, widths, and at which viewers weights are known."""
    fit = record.load_envelope() if image == "envelope" else record.load_preview()
    constants = {name: texture_file(files(image))}
    if isinstance(fit.viewers, ViewerGrid):
        widths = [(lobe.name, lobe.alpha_x, lobe.alpha_y) for lobe in fit.closures]
        azimuths, half_turn = fit.viewers.n_phi, fit.viewers.folded
    else:
        widths = [(lobe.name, lobe.p1, lobe.p1) for lobe in fit.closures]
        azimuths, half_turn = 0, False
    words = " ".join(f"{lobe} {along:.9g} {across:.9g}" for lobe, along, across in widths)
    told = {"Nodes": fit.viewers.shape[0], "Azimuths": azimuths, "HalfTurn": int(half_turn), "Closures": words}
    return constants | {f"{name}{key}": value for key, value in told.items()}
