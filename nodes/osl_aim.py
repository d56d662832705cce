"""What OSL materials aim at and sample: tables of lamps and world, by image nodes between our scripts.

The world's table is asked at directions that scripts draw. Where materials aim, two more scripts therefore stand before
the shader, and an image node after each. Where the shader samples the world's picture itself, that comes in by
Environment Textures, which show what Cycles sees behind the scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.sampling.lamp_light import LIGHT_TEXELS
from ..bake.sampling.lamps import TEXELS
from . import expr
from .aimed_light_group import MAX_SLOTS, world_texel
from .group import call, node_group
from .light_images import world_table
from .osl_parameters import CELLS
from .osl_parts import PREFIXES
from .osl_script import output, script_node, shader_source
from .world_picture import LIT, Surroundings, lit_group, picture_group

AIM_SHADER, WORLD_SHADER = "measured_aim.osl", "measured_world.osl"
_TEXELS = ("Centre", "U", "V", "Axis")
_SCENE = ("Sky", "World", "Strongest")
# Of the shader's parameters, those that `AIM_SHADER` has too.
_PLACED = ("Normal", "Tangent", "Anisotropic", "Gloss", "Lens")
_SAMPLER = ("Sampler", "Concentration", *CELLS)


@dataclass(frozen=True)
class Lights:
    """What a material aims at or samples; the parameters of `osl_material.build_osl_material`."""

    lamps: bpy.types.Image
    lights: bpy.types.Image | None
    surroundings: Surroundings | None
    points: int

    @classmethod
    def of(
        cls,
        lamps: bpy.types.Image | None,
        lights: bpy.types.Image | None,
        surroundings: Surroundings | None,
        points: int,
    ) -> Lights | None:
        """None where there are none; without the table of what lamps emit nothing is sampled."""
        if lamps is None:
            return None
        return cls(lamps, lights, surroundings, points) if lights is not None else cls(lamps, None, None, 0)


def aimed_inputs(inputs: Mapping[str, Any], lights: Lights, parts: Sequence[str] | None = None) -> dict[str, Any]:
    """The directions that `AIM_SHADER` draws, and lamps and world as far as the shader itself asks for them.

    Parameters
    ----------
    inputs : of the shader, among which are those of the sampler, or of each part's
    lights : where its shader samples lamps it aims at the world alone
    parts : of a sheet's side, what stands before the names of their parameters, one or two: each draws a direction of
        its own. By default it is a BRDF
    """
    count = min(lights.lamps.size[1], MAX_SLOTS)
    told = dict(zip(_lamp_parameters(count), call(_lamps_group(lights.lamps, count))))
    sky, towards, strongest = (told.pop(name) for name in _SCENE)
    world, around, lit, rays = world_table(), None, {}, None
    if lights.surroundings is not None:
        around, lit = picture_group(lights.surroundings), dict(zip(LIT, call(lit_group(lights.surroundings.table))))
        rays = lit.pop("Rays")
    alias, acceptance = _drawn_cell(world, inputs["Lens"])
    seen = {name: inputs[name] for name in _PLACED if name in inputs} | lit
    seen |= {"Sky": sky, "World": towards, "Alias": alias, "Acceptance": acceptance}
    seen |= {"Lamps": count} | told if lights.lights is None else {}
    source = shader_source(AIM_SHADER)
    drawn: dict[str, Any] = {}
    for part in parts or PREFIXES[:1]:
        sampler = {name: inputs[part + name] for name in _SAMPLER if part + name in inputs}
        aim = script_node(AIM_SHADER, source, seen | sampler | {"Through": int(part != "")})
        texel, _ = call(_world_group(world), output(aim, "Place"))
        drawn |= {f"{part}{name}": output(aim, name) for name in ("Direction", "Densities")}
        drawn[f"{part}WorldTexel"] = texel
        if around is not None:
            drawn[f"{part}Around"] = call(around, output(aim, "Picture"))
    if around is not None:
        # What any of them draws towards the world is the same, whatever the part.
        texel, _ = call(_world_group(world), output(aim, "WorldPlace"))
        drawn |= {"Lit": lit["Lit"], "WorldDirection": output(aim, "WorldDirection"), "WorldDrawn": texel}
        drawn["WorldAround"] = call(around, output(aim, "WorldPicture"))
    if lights.lights is None:
        told = {"Centre1": told["Centre1"]}  # of the mirrors' shares under one lamp
    else:
        names = _light_parameters(count, rays=parts is not None)
        told |= dict(zip(names, call(_lights_group(lights.lights, count, rays=parts is not None))))
    scene = {"Lamps": count, "Points": lights.points, "Sky": sky, "Strongest": strongest}
    if parts is not None:
        scene |= {"World": towards} | ({} if rays is None else {"WorldRays": rays})
    return scene | drawn | told


def _drawn_cell(world: bpy.types.Image, lens: Any) -> tuple[Any, Any]:
    """Texel of the cell of the world's table in which a draw looks first."""
    place = output(script_node(WORLD_SHADER, shader_source(WORLD_SHADER), {"Lens": lens}), "Place")
    alias, acceptance = call(_world_group(world), place)
    return alias, acceptance


def _world_group(world: bpy.types.Image) -> bpy.types.ShaderNodeTree:
    """(texture coordinates) to the world's texel there, as colour and alpha."""
    outputs = {"Texel": "vector", "Acceptance": "float"}
    return node_group(
        "MM OSL World", {"Place": "vector"}, outputs, lambda at: world_texel(world, at), switched="extension"
    )


def _lamp_parameters(count: int) -> list[str]:
    return [*_SCENE, *(f"{texel}{k}" for k in range(1, count + 1) for texel in (*_TEXELS, "Facts"))]


def _light_parameters(count: int, *, rays: bool = False) -> list[str]:
    told = ("Radiance", "Beam", "Facing", *(["Rays"] if rays else []))
    return [f"{texel}{k}" for k in range(1, count + 1) for texel in told]


def _lights_group(lights: bpy.types.Image, count: int, *, rays: bool = False) -> bpy.types.ShaderNodeTree:
    """No input to the parameters of the shader that say what lamps emit, and of a sheet which rays meet them."""
    rows = lights.size[1]

    def build() -> tuple[Any, ...]:
        values = []
        for row in range(count):
            (radiance, facing), (beam, meeting) = (
                expr.image_tap(lights, (column + 0.5) / LIGHT_TEXELS, 1 - (row + 0.5) / rows, "Closest")
                for column in range(LIGHT_TEXELS)
            )
            values += [radiance, beam, facing, *([meeting] if rays else [])]
        return tuple(values)

    names = _light_parameters(count, rays=rays)
    kinds = {name: "float" if name.startswith(("Facing", "Rays")) else "vector" for name in names}
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
