"""Node group: a shading map lit by f_r, by envelope and residual, by mirror, or as in Kautz et al. 2004, figure 6."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import bpy

from ..bake.lobes.lobes import Lobe
from ..bake.shading_maps.render_settings import PREVIEW_LEVEL
from ..bake.source import LUMINANCE
from . import expr
from .adjustments import LIMITS, NEUTRAL, SOCKETS, Adjustments
from .brdf_group import after_diffuse
from .drawn_direction import DrawnDirection
from .exclusive_closures import all_of, one_of
from .feature_passes import clamped, write_features
from .group import call, node_group
from .map_lighting import TEXTURED, Lighting, MapGroups, Parts, Place, times
from .map_models import piecewise_linear
from .native_closure import add_closures, choose_closure, native_closure, translucent_closure, viewport_closures
from .sampled_map import MIN_CHOICE, MapSide, sampled_map, sampled_swatch
from .surface_marker import MATTE, roughness_of, with_marker
from .swatch_frame_group import ALONG_U, ALONG_V

# In an order that leaves those of older files in their places, by whose numbers they are animated.
MAP_INPUTS = {"Normal": "vector", "Tint": SOCKETS["Tint"], "UV": "vector", "Light Level": "float"} | SOCKETS


@dataclass(frozen=True)
class Transmitted:
    """What a swatch lets through.

    Parameters
    ----------
    groups : of its map
    lighting : of it
    share : of the light under a white sky that is reflected instead, by which one of two mirrors is chosen
    """

    groups: MapGroups
    lighting: Lighting
    share: float


def shading_map_group(
    name: str, groups: MapGroups, lighting: Lighting, transmitted: Transmitted | None = None
) -> bpy.types.ShaderNodeTree:
    """(Normal, Tint, UV, Light Level, the other `Adjustments`) to (BSDF, EEVEE).

    A map over azimuth also takes how the swatch lies on the surface, as `swatch_frame_group` finds it.

    Parameters
    ----------
    transmitted : of a swatch that was photographed against the light too
    """
    technique = lighting.settings.technique
    turned = groups.turned or (transmitted is not None and transmitted.groups.turned)
    inputs = MAP_INPUTS | (dict.fromkeys((ALONG_U, ALONG_V), "vector") if turned else {})
    builders = dict(zip(TEXTURED, (_lit_texture, _angular), strict=True))

    def build(*values: Any) -> tuple[Any, Any]:
        named = dict(zip(inputs, values, strict=True))
        normal, adjustments = named["Normal"], Adjustments.among(named)
        place = Place(named["UV"], named.get(ALONG_U), named.get(ALONG_V))
        if transmitted is None or technique in builders:
            closure = builders.get(technique, _in_mode)(groups, lighting, normal, adjustments, place)
        else:
            closure = _both_in_mode(groups, lighting, transmitted, normal, adjustments, place)
        behind = None if transmitted is None else (transmitted.groups, transmitted.lighting)
        if behind is not None and technique in builders:
            closure = add_closures([closure, _preview(*behind, normal, adjustments, place)])
        if not lighting.preview:
            roughness = MATTE if lighting.measured else (roughness_of(lighting.lobe) or MATTE)
            closure = with_marker(closure, normal, roughness, always=lighting.normals)
            if lighting.features:
                albedo = lighting.measured.albedo if lighting.measured else 1.0
                texture = expr.scale(_texture(groups, lighting, adjustments, place), albedo)
                if behind is not None:
                    texture = texture + _texture(*behind, adjustments, place)
                write_features(normal, clamped(texture))
        shown = [(groups, lighting)] if behind is None else [(groups, lighting), behind]
        seen = [_viewport(*side, normal, adjustments, place, named["Light Level"]) for side in shown]
        return closure, add_closures(seen)

    outputs = {"BSDF": "shader", "EEVEE": "shader"}
    return node_group(name, inputs, outputs, build, {"Light Level": 1.0, **NEUTRAL}, limits=LIMITS)


# Radians that EEVEE's normals lean towards u and v: little, for few lights to be faced by one of them alone, and enough
# for the difference to stand out of its half floats.
_LEAN = 0.1
# Of two mirrors that exclude each other neither is drawn more rarely than this part of what it would be alone.
_LEAST = 0.1


def _mirror(
    drawn: DrawnDirection, reflected: Any, lighting: Lighting, adjustments: Adjustments, share: Any = 1.0
) -> Any:
    gain = expr.divide(lighting.a_max, drawn.pdf * share)
    return drawn.mirror(adjustments.apply(expr.scale(reflected, gain)))


def _in_mode(groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place) -> Any:
    mode = lighting.settings.mode
    if mode == "preview":
        return _preview(groups, lighting, normal, adjustments, place)
    traced = (sampled_map if lighting.sampled else _lookup)(groups, lighting, normal, adjustments, place)
    if mode == "balanced":
        return choose_closure(after_diffuse(), traced, _preview(groups, lighting, normal, adjustments, place))
    return traced


def _both_in_mode(
    groups: MapGroups,
    lighting: Lighting,
    transmitted: Transmitted,
    normal: Any,
    adjustments: Adjustments,
    place: Place,
) -> Any:
    """`_in_mode` of reflected and transmitted light together, whose mirrors exclude each other where they are aimed."""
    mode = lighting.settings.mode
    sides = [(groups, lighting), (transmitted.groups, transmitted.lighting)]
    preview = add_closures([_preview(*side, normal, adjustments, place) for side in sides])
    if mode == "preview":
        return preview
    if lighting.sampled:
        traced = sampled_swatch(
            MapSide(groups, lighting),
            MapSide(transmitted.groups, transmitted.lighting),
            transmitted.share,
            normal,
            adjustments,
            place,
        )
        return choose_closure(after_diffuse(), traced, preview) if mode == "balanced" else traced
    added = all(light.lamps is None for _, light in sides)
    share = min(max(transmitted.share, _LEAST), 1 - _LEAST)
    drawn, native = [], []
    for (found, light), part in zip(sides, (1.0, 1.0) if added else (share, 1 - share), strict=True):
        one, f_cos = light.draw(normal)
        split = light.split(found, place, one.wo, one.wi_world, f_cos, one.cosine, one.random[0])
        chance = part
        if light.exact:
            if not added:
                chance = _mirror_chance(split, light) * part
            native.append(partial(_native, light, split, normal, adjustments))
        drawn.append((one, chance, _mirror(one, split.traced, light, adjustments, chance)))
    traced = (all_of if added else one_of)(drawn, native)
    return choose_closure(after_diffuse(), traced, preview) if mode == "balanced" else traced


def _native(lighting: Lighting, parts: Parts, normal: Any, adjustments: Adjustments, factor: Any) -> Any:
    """The closure under a map, by the factor of its weight."""
    return lighting.closure(parts, normal, adjustments, factor * lighting.native_sigma)


def _preview(groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place) -> Any:
    """One photograph, relative to its mean, as a texture on closures that look like f_r."""
    return add_closures(_like_f_r(lighting, normal, _texture(groups, lighting, adjustments, place)))


def _texture(groups: MapGroups, lighting: Lighting, adjustments: Adjustments, place: Place) -> Any:
    """The photograph, at a level at which it reflects as much light as the lookup: the mean over the texels is the
    level itself."""
    level = expr.vec(*[PREVIEW_LEVEL] * 3) if lighting.measured is not None else PREVIEW_LEVEL
    return expr.scale(
        adjustments.apply(call(groups.still, place.uv, level, 1.0, 0.5)[0]), lighting.sigma / PREVIEW_LEVEL
    )


def _like_f_r(lighting: Lighting, normal: Any, colour: Any) -> list[Any]:
    """Closures that look like f_r, times a colour."""
    if lighting.measured is not None:
        return [native_closure(Lobe("lambert"), expr.scale(colour, lighting.measured.albedo), normal)]
    if lighting.through:
        return [translucent_closure(colour, normal)]
    return viewport_closures(lighting.lobe, normal, colour)


def _lookup(groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place) -> Any:
    drawn, f_cos = lighting.draw(normal)
    parts = lighting.split(groups, place, drawn.wo, drawn.wi_world, f_cos, drawn.cosine, drawn.random[0])
    if not lighting.exact:
        return _mirror(drawn, parts.traced, lighting, adjustments)
    chance = _mirror_chance(parts, lighting)
    mirror = _mirror(drawn, parts.traced, lighting, adjustments, chance)
    closure = lighting.closure(parts, normal, adjustments, expr.divide(lighting.native_sigma, 1 - chance))
    return choose_closure(drawn.random[1] < chance, closure, mirror)


def _mirror_chance(parts: Parts, lighting: Lighting) -> Any:
    """Probability of the mirror; whatever it is, the closure's weight and the mirror's allow for it.

    A mirror that aims at the lamps is worth as much as the closure where it is chosen in proportion to the residual in
    the direction drawn (tried on a canvas: 0.82 of the noise of the texel's mean share). One that does not is noisier
    than the closure of equal energy (tried: the root of the share has 8 to 21 % less noise than the share).
    """
    if lighting.lamps is None:
        part = expr.sqrt(parts.share)
    else:
        one = expr.vec(1.0, 1.0, 1.0)
        part = expr.divide(expr.dot(parts.traced, one), expr.dot(parts.reflected, one))
    return part * (1 - 2 * MIN_CHOICE) + MIN_CHOICE


def _lit_texture(groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place) -> Any:
    """The brightest photograph as a texture on f_r."""
    level = expr.vec(1.0, 1.0, 1.0) if lighting.measured is not None else 1.0
    # Any number below 1 draws the last slice.
    texture = adjustments.apply(call(groups.still, place.uv, level, 1.0, 0.0)[0])
    if lighting.native and lighting.lobe.native_share == 1:
        return native_closure(lighting.lobe, expr.scale(texture, lighting.sigma), normal)
    return _proportional(*lighting.draw(normal), lighting, texture)


def _angular(groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place) -> Any:
    """The photograph taken at the light's elevation, relative to its mean, as a texture on f_r."""
    drawn, f_cos = lighting.draw(normal)
    level = expr.maximum(piecewise_linear((lighting.level_by_cosine,), drawn.cosine)[0], 1e-4)
    x = expr.vec(level, level, level) if lighting.measured is not None else level
    texture = groups.look_up(place, x, 1.0, drawn.random[0], drawn.wi_world)[0]
    return _proportional(drawn, f_cos, lighting, adjustments.apply(expr.scale(texture, 1 / level)))


def _proportional(drawn: DrawnDirection, f_cos: Any, lighting: Lighting, texture: Any) -> Any:
    weight = times(f_cos, expr.divide(lighting.sigma, drawn.pdf))
    colour = texture * weight if isinstance(weight, expr.Vector) else expr.scale(texture, weight)
    return drawn.mirror(colour)


def _viewport(
    groups: MapGroups, lighting: Lighting, normal: Any, adjustments: Adjustments, place: Place, light_level: Any
) -> Any:
    """EEVEE: what the flat material would send out, by Shader to RGB, is the level; its hue stays with the light.

    A level of 1 is what the brightest photograph shows under light of unit irradiance, so "Light Level" is the
    irradiance that the scene's key light stands for. A map over azimuth shows the shadows of where light comes from on
    the whole.
    """
    radiance = expr.Vector(_sum_shader_to_rgb(lighting, normal))
    luminance = expr.dot(radiance, expr.vec(*LUMINANCE))
    scale = light_level * (lighting.a_max / lighting.sigma)
    x = expr.divide(luminance, scale)
    level = 1.0 if lighting.settings.technique == "lit_texture" else x
    light = (_light_at(lighting, normal, place),) if groups.turned else ()
    texel = adjustments.saturated(call(groups.viewport, place.uv, level, 1.0, 1.0, *light)[0])
    hue = expr.scale(radiance, expr.divide(1.0, luminance))
    if lighting.settings.technique == "lit_texture":
        colour = texel * expr.scale(radiance, lighting.sigma)
    else:
        colour = expr.scale(texel * hue, scale * lighting.sigma)
    return expr.Scalar(expr.node("ShaderNodeEmission", {}, {"Color": colour * adjustments.gain}).outputs[0])


def _light_at(lighting: Lighting, normal: Any, place: Place) -> Any:
    """Parts along u and v of the direction that light comes from on the whole, in any unit, for EEVEE.

    Irradiance E(n) is the sum over the lights of their strength times n . l. Of a normal that is leant by `_LEAN`
    towards u it is cos(lean) E + sin(lean) times the sum of strength times u . l, which is what is sought. Lights that
    only one of the normals faces are counted in part.
    """
    if lighting.through:
        normal = expr.scale(normal, -1.0)
    straight = _irradiance(normal)

    def along(axis: Any) -> Any:
        leant = expr.scale(normal, math.cos(_LEAN)) + expr.scale(axis, math.sin(_LEAN))
        return _irradiance(leant) - straight * math.cos(_LEAN)

    return expr.vec(along(place.along_u), along(place.along_v), 0.0)


def _irradiance(normal: Any) -> Any:
    """Luminance of what a white matte surface of this normal sends out."""
    matte = native_closure(Lobe("lambert"), expr.vec(1.0, 1.0, 1.0), normal)
    colour = expr.node("ShaderNodeShaderToRGB", {}, {0: matte}).outputs["Color"]
    return expr.dot(expr.Vector(colour), expr.vec(*LUMINANCE))


def _sum_shader_to_rgb(lighting: Lighting, normal: Any) -> Any:
    """Radiance of white f_r."""
    closures = _like_f_r(lighting, normal, expr.vec(1.0, 1.0, 1.0))
    return expr.node("ShaderNodeShaderToRGB", {}, {0: add_closures(closures)}).outputs["Color"]
