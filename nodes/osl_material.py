"""A bundle as a Cycles material of one OSL shader: the twin of `nodes.material`, on the CPU.

Its textures are files, named by their whole path, for OSL cannot read what is packed into a .blend: where they are
moved the material must be built again. The tables of lamps and world alone come through image nodes. They live in the
.blend and change with edits and frames; OSL's texture system would show a file as it was when first read. The world's is
asked at directions that scripts draw: where materials aim, two more scripts stand before the shader, and an image node
after each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from ..bake.sampling.lamp_light import LIGHT_TEXELS
from ..bake.sampling.lamps import TEXELS
from ..bake.tables.table import FILTERS
from . import expr
from .aimed_light_group import MAX_SLOTS, world_texel
from .group import call, node_group
from .lens_group import lens_numbers
from .light_images import world_table
from .material import usual_mode
from .material_tree import build_from, lit_by_emission
from .osl_parameters import CELLS, cell_constants, grid_constants, share_constants, texel_constants, texture_file
from .osl_script import output, script_node, shader_source

SHADER, AIM_SHADER, WORLD_SHADER = "measured_material.osl", "measured_aim.osl", "measured_world.osl"
# Where the images of a bundle are as files, by their names.
Files = Callable[[str], Path]
_TEXELS = ("Centre", "U", "V", "Axis")
_SCENE = ("Sky", "World", "Strongest")
# Of the shader's parameters, those that `AIM_SHADER` has too.
_OF_AIM = ("Normal", "Tangent", "Anisotropic", "Lens", "Sampler", *CELLS)


def build_osl_material(
    source: Bundle | BrdfRecord,
    material: bpy.types.Material | None = None,
    *,
    mode: str | None = None,
    lamps: bpy.types.Image | None = None,
    lights: bpy.types.Image | None = None,
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
    interface = {"Normal": "vector", "Tint": "vector"} | ({"Tangent": "vector"} if record.anisotropic else {})

    def build(*values: Any) -> Any:
        inputs = dict(zip(interface, values)) | constants | {"Normals": int(normals)}
        if mode != "preview":
            inputs["Lens"] = expr.vec(*lens_numbers())
        if lamps is not None and mode != "preview":
            inputs |= aimed_inputs(inputs, lamps, lights) | {"Points": points if lights is not None else 0}
        return output(script_node(SHADER, shader_source(SHADER), inputs), "BSDF")

    built = build_from(
        record, material, lambda name: node_group(f"Measured {name} OSL", interface, {"BSDF": "shader"}, build)
    )
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
    chosen = table.filter if filter is None else filter
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


def aimed_inputs(
    inputs: Mapping[str, Any], lamps: bpy.types.Image, lights: bpy.types.Image | None
) -> dict[str, Any]:
    """The direction that `AIM_SHADER` draws, and the lamps of the table as far as the shader itself asks for them.

    Parameters
    ----------
    inputs : of the shader, among which are those of the sampler
    lights : where the shader samples lamps; it then aims at the world alone
    """
    count = min(lamps.size[1], MAX_SLOTS)
    told = dict(zip(_lamp_parameters(count), call(_lamps_group(lamps, count))))
    sky, towards, strongest = (told.pop(name) for name in _SCENE)
    world, seen = world_table(), {name: inputs[name] for name in _OF_AIM if name in inputs}
    place = output(script_node(WORLD_SHADER, shader_source(WORLD_SHADER), {"Lens": inputs["Lens"]}), "Place")
    alias, acceptance = call(_world_group(world), place)
    seen |= {"Sky": sky, "World": towards, "Alias": alias, "Acceptance": acceptance}
    seen |= {"Lamps": count} | told if lights is None else {}
    aim = script_node(AIM_SHADER, shader_source(AIM_SHADER), seen)
    texel, _ = call(_world_group(world), output(aim, "Place"))
    drawn = {name: output(aim, name) for name in ("Direction", "Densities")} | {"WorldTexel": texel}
    if lights is None:
        told = {"Centre1": told["Centre1"]}  # of the mirror's share under one lamp
    else:
        told |= dict(zip(_light_parameters(count), call(_lights_group(lights, count))))
    return {"Lamps": count, "Sky": sky, "Strongest": strongest} | drawn | told


def _world_group(world: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(texture coordinates) to the world's texel there, as colour and alpha."""
    outputs = {"Texel": "vector", "Acceptance": "float"}
    return node_group(
        "MM OSL World", {"Place": "vector"}, outputs, lambda at: world_texel(world, at), switched="extension"
    )


def _lamp_parameters(count: int) -> list[str]:
    return [*_SCENE, *(f"{texel}{k}" for k in range(1, count + 1) for texel in (*_TEXELS, "Facts"))]


def _light_parameters(count: int) -> list[str]:
    return [f"{texel}{k}" for k in range(1, count + 1) for texel in ("Radiance", "Beam", "Facing")]


def _lights_group(lights: bpy.types.Image, count: int) -> bpy.types.ShaderNodeTree:
    """No input to the parameters of the shader that say what lamps emit."""
    rows = lights.size[1]

    def build() -> tuple[Any, ...]:
        values = []
        for row in range(count):
            (radiance, facing), (beam, _) = (
                expr.image_tap(lights, (column + 0.5) / LIGHT_TEXELS, 1 - (row + 0.5) / rows, "Closest")
                for column in range(LIGHT_TEXELS)
            )
            values += [radiance, beam, facing]
        return tuple(values)

    kinds = {name: "float" if name.startswith("Facing") else "vector" for name in _light_parameters(count)}
    return node_group("MM OSL Lamp Light", {}, kinds, build, switched="extension")


def _lamps_group(lamps: bpy.types.Image, count: int) -> bpy.types.ShaderNodeTree:
    """No input to the parameters of the shader that describe lamps."""
    rows = lamps.size[1]
    if lamps.size[0] != TEXELS:
        raise ValueError(f"{lamps.size[0]} texels a row; a lamp has {TEXELS}")

    def texel(row: int, column: int) -> tuple[Any, Any]:
        return expr.image_tap(lamps, (column + 0.5) / TEXELS, 1 - (row + 0.5) / rows, "Closest")

    def build() -> tuple[Any, ...]:
        scene, strength = texel(0, 4)
        sky, largest, in_scene = expr.components(scene)
        world, flux = texel(1, 4) if rows > 1 else (expr.vec(0.0, 0.0, 0.0), 0.0)
        values = [expr.vec(sky, largest, flux), world, expr.vec(in_scene, strength, 0.0)]
        for row in range(count):
            vectors, numbers = zip(*(texel(row, column) for column in range(len(_TEXELS))))
            kind, power, _, fourth = numbers
            values += [*vectors, expr.vec(kind, power, fourth)]
        return tuple(values)

    return node_group("MM OSL Lamps", {}, dict.fromkeys(_lamp_parameters(count), "vector"), build, switched="extension")
