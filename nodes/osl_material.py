"""A bundle as a Cycles material of one OSL shader: the twin of `nodes.material`, on the CPU.

Its textures are files, named by their whole path, for OSL cannot read what is packed into a .blend: where they are
moved the material must be built again. The tables of lamps and world alone come through image nodes (`nodes.osl_aim`).
They live in the .blend and change with edits and frames; OSL's texture system would show a file as it was when first
read.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..bake.brdf.common import kind_of
from ..bake.brdf.modes import MODES
from ..bake.brdf.record import BrdfRecord
from ..bake.bundle.bundle import MATERIAL, Bundle
from ..bake.errors import BakeError
from ..bake.tables.table import Filter
from . import expr
from .adjustments import LIMITS, NEUTRAL
from .brdf_group import brdf_inputs
from .data_image import Images, bundle_images
from .group import call, node_group
from .lens_group import lens_numbers
from .material import usual_mode
from .material_tree import build_from, lit_by_emission
from .osl_aim import Lights, aimed_inputs
from .osl_parts import Files, part_constants
from .osl_script import output, script_node, shader_source
from .osl_sheet import sheet_shader
from .preview_group import preview_group
from .world_picture import Surroundings

SHADER = "measured_material.osl"


def build_osl_material(
    source: Bundle | BrdfRecord,
    material: bpy.types.Material | None = None,
    *,
    mode: str | None = None,
    lamps: bpy.types.Image | None = None,
    lights: bpy.types.Image | None = None,
    surroundings: Surroundings | None = None,
    points: int = 1,
    filter: Filter | None = None,
    stochastic: bool = True,
    files: Files | None = None,
    images: Images | None = None,
    normals: bool = False,
) -> bpy.types.Material:
    """Build or rebuild a material from a bundle, as `nodes.material.build_material` does, of OSL.

    Cycles shows it in scenes that `osl_script.use_osl` has prepared, and black in others; EEVEE shows its preview.

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
    images : textures of the preview, which is nodes; by default those of the bundle, loaded into the .blend
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
    interface = brdf_inputs(record.anisotropic)
    seen = None if mode == "preview" else Lights.of(lamps, lights, surroundings, points)
    if record.sheet is not None:
        shown = sheet_shader(record, mode, filter, files, seen)
    else:
        shown = _shader(shader_constants(record, mode, filter, stochastic, files), seen)

    def build(*values: Any) -> Any:
        inputs = dict(zip(interface, values)) | {"Normals": int(normals)}
        if mode != "preview":
            inputs["Lens"] = expr.vec(*lens_numbers())
        return shown(inputs)

    def make(name: str) -> bpy.types.ShaderNodeTree:
        # Packed: where OSL is on, textures of nodes that are files are told of, see `addon.scene_check`.
        preview = preview_group(record, name, images or bundle_images(record.files(), name, pack=True))
        outputs = {"BSDF": "shader"} | ({} if preview is None else {"EEVEE": "shader"})

        def both(*values: Any) -> Any:
            traced = build(*values)
            return traced if preview is None else (traced, call(preview, *values)[0])

        return node_group(f"Measured {name} OSL", interface, outputs, both, NEUTRAL, limits=LIMITS)

    built = build_from(record, material, make)
    # Cycles takes any shader that may emit for a lamp, whether it does or not.
    lit_by_emission(built, True)
    return built


def _shader(constants: dict[str, Any], lights: Lights | None) -> Callable[[dict[str, Any]], Any]:
    """What makes the shader of a BRDF, of what else it is given."""

    def make(inputs: dict[str, Any]) -> Any:
        inputs = inputs | constants
        if lights is not None:
            inputs |= aimed_inputs(inputs, lights)
        return output(script_node(SHADER, shader_source(SHADER), inputs), "BSDF")

    return make


def shader_constants(
    record: BrdfRecord, mode: str, filter: Filter | None = None, stochastic: bool = True, files: Files | None = None
) -> dict[str, Any]:
    """Parameters of the shader that describe the bundle, its pixels read and checked. Raises BakeError."""
    files = files or record.files().image_path
    return {
        "Mode": mode,
        "Anisotropic": int(record.anisotropic),
        **part_constants(record, mode, filter, stochastic, files),
    }
