"""Node group: light reflected by a shading map at level x, and its split into envelope and residual."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import bpy

from ..bake.shading_maps.reduced_map import DetailLayout
from ..bake.shading_maps.slice_atlas import SliceLayout, level_position, tile_v
from . import expr
from .group import node_group

Tap = Callable[[Any], Any]


@dataclass(frozen=True)
class Detail:
    """Means of texels for what is far away, which follow the texels in both images.

    Parameters
    ----------
    residual, envelope : how the images are laid out
    texels : that a pixel is across, at a distance of 1
    """

    residual: DetailLayout
    envelope: DetailLayout
    texels: float

    @property
    def in_a_pixel(self) -> Any:
        """Texels that a pixel is across at the end of this ray. Of a ray that has met a mirror before, the last part of
        its way alone counts, which leaves more detail than a pixel can show."""
        path = expr.node("ShaderNodeLightPath", {}, {})
        return expr.Scalar(path.outputs["Ray Length"]) * self.texels


@dataclass(frozen=True)
class SliceImages:
    """Textures of a shading map, loaded.

    Parameters
    ----------
    residual : slices 1 to N - 1 without the envelope, as `bake.shading_maps.slice_atlas.pack_slices` lays them out
    envelope : m in the colours, the residual's share in alpha
    layout : of `residual`
    residual_scale, envelope_scale : what stored values are multiplied by
    detail : where the images hold means of texels too; for tiling "repeat" only
    """

    residual: bpy.types.Image
    envelope: bpy.types.Image
    layout: SliceLayout
    residual_scale: float = 1.0
    envelope_scale: float = 1.0
    detail: Detail | None = field(default=None, kw_only=True)

    @property
    def slices(self) -> int:
        """N, the black one included."""
        return self.layout.tiles + 1


@dataclass(frozen=True)
class SliceOptions:
    """Options of the slices' lookup that a material needs.

    Parameters
    ----------
    above : "clamp" or "scale"
    peak : f_r reaches beyond x = 1, so that with "clamp" the envelope must stay under the last slice too
    coloured : x is a colour, each channel at its own level
    stochastic : choose one of the two slices by the random number with the weights of the blend. Unbiased, since
        slices enter linearly; x itself must never be chosen so
    tiling : "repeat" or "extend"
    interpolation : of the texels, "Linear", "Cubic" or "Closest"; "Fetched" is "Linear" by four taps of "Closest",
        which EEVEE needs: it chooses a mip level by how far apart neighbouring pixels read, and they may read other
        slices
    """

    above: str = "clamp"
    peak: bool = False
    coloured: bool = False
    stochastic: bool = False
    tiling: str = "repeat"
    interpolation: str = "Linear"


def slices_group(name: str, images: SliceImages, options: SliceOptions) -> bpy.types.ShaderNodeTree:
    """(UV, x, Peak, Random) to (Reflected, Residual, Envelope, Share), relative to a_max.

    Peak is the largest x that f_r reaches from this viewer. Reflected = Residual + Envelope x; Residual >= 0 for
    every x up to Peak.
    """

    def lookup(uv: Any, x: Any, peak: Any, random: Any) -> tuple[Any, ...]:
        u, v = inside(uv, images.layout, options.tiling)
        tap = tapper(images, u, v, options.interpolation)
        m, share = texel_tap(images, u, v, options)
        rest = _at_levels(tap, images.slices, x, random if options.stochastic else None, options.coloured)
        last = tap(float(images.slices - 2)) if options.above == "clamp" and options.peak else None
        return *split(x, m, rest, last, peak, options), share

    return node_group(name, *interface(options), lookup, {"Peak": 1.0, "Random": 0.5})


def interface(options: SliceOptions) -> tuple[dict[str, str], dict[str, str]]:
    """Inputs and outputs of the group of any model."""
    kinds = {"UV": "vector", "x": "vector" if options.coloured else "float", "Peak": "float", "Random": "float"}
    return kinds, {"Reflected": "vector", "Residual": "vector", "Envelope": "vector", "Share": "float"}


def inside(uv: Any, layout: SliceLayout, tiling: str) -> tuple[Any, Any]:
    """(u, v) inside the swatch: v in [0, 1], and u as well unless the image's own repetition serves it."""
    u, v, _ = expr.components(uv)
    if tiling == "repeat":
        # Across, the image repeats by itself; a fraction taken here would show as a line in real-time viewports.
        return u, v - expr.floor(v)
    half_u, half_v = 0.5 / layout.width, 0.5 / layout.height
    return tuple(expr.minimum(expr.maximum(c, half), 1 - half) for c, half in ((u, half_u), (v, half_v)))


def tapper(images: SliceImages, u: Any, v: Any, interpolation: str) -> Tap:
    """Tile k of the atlas at this place of the swatch: of slices, the first that is not black is 0."""
    if images.detail is not None:
        return _detailed_tapper(images, images.detail, u, v, interpolation)
    size = images.layout.width, images.layout.rows

    def tap(index: Any) -> Any:
        at = tile_v(expr, images.layout, index, v)
        colour, _ = image_tap(images.residual, size, u, at, interpolation, "REPEAT")
        return _scaled(colour, images.residual_scale)

    return tap


def _detailed_tapper(images: SliceImages, detail: Detail, u: Any, v: Any, interpolation: str) -> Tap:
    """The tile in the level of detail that this ray can show."""
    layout = detail.residual
    across, top, pitch = layout.place(expr, detail.in_a_pixel, u, v)

    def tap(index: Any) -> Any:
        at = across, layout.image_v(top, pitch, index)
        colour, _ = image_tap(images.residual, (layout.width, layout.rows), *at, interpolation, "REPEAT")
        return _scaled(colour, images.residual_scale)

    return tap


def image_tap(
    image: bpy.types.Image, size: tuple[int, int], u: Any, v: Any, interpolation: str, extension: str
) -> tuple[Any, Any]:
    if interpolation != "Fetched":
        return expr.image_tap(image, u, v, interpolation, extension)
    column, row = u * size[0] - 0.5, v * size[1] - 0.5
    left, below = expr.floor(column), expr.floor(row)
    a, b = column - left, row - below
    colour, alpha = expr.vec(0.0, 0.0, 0.0), 0.0
    for i, across in ((0, 1 - a), (1, a)):
        for j, up in ((0, 1 - b), (1, b)):
            at = (left + (0.5 + i)) * (1 / size[0]), (below + (0.5 + j)) * (1 / size[1])
            texel, opacity = expr.image_tap(image, *at, "Closest", extension)
            colour, alpha = colour + expr.scale(texel, across * up), opacity * (across * up) + alpha
    return colour, alpha


def texel_tap(images: SliceImages, u: Any, v: Any, options: SliceOptions) -> tuple[Any, Any]:
    """Envelope and share at this place of the swatch."""
    size = images.layout.width, images.layout.height
    if images.detail is not None:
        layout = images.detail.envelope
        u, top, pitch = layout.place(expr, images.detail.in_a_pixel, u, v)
        size, v = (layout.width, layout.rows), layout.image_v(top, pitch, 0.0)
    repeat = "REPEAT" if options.tiling == "repeat" else "EXTEND"
    colour, alpha = image_tap(images.envelope, size, u, v, options.interpolation, repeat)
    return _scaled(colour, images.envelope_scale), alpha


def _scaled(colour: Any, factor: float) -> Any:
    return colour if factor == 1.0 else expr.scale(colour, factor)


def _at_levels(tap: Tap, slices: int, x: Any, random: Any, coloured: bool) -> Any:
    if not coloured:
        return _at_level(tap, slices, x, random)
    channels = [_at_level(tap, slices, level, random) for level in expr.components(x)]
    return expr.vec(*(expr.components(colour)[k] for k, colour in enumerate(channels)))


def _at_level(tap: Tap, slices: int, x: Any, random: Any) -> Any:
    """Residual between the slices around x; slice 0 is black and has no texels."""
    base, t = level_position(expr, slices, x)
    if random is not None:
        chosen = base + (random < t)
        return expr.scale(tap(expr.maximum(chosen - 1, 0.0)), chosen > 0.5)
    low = expr.scale(tap(expr.maximum(base - 1, 0.0)), (1 - t) * (base > 0.5))
    return low + expr.scale(tap(base), t)


def split(x: Any, m: Any, rest: Any, last: Any, peak: Any, options: SliceOptions) -> tuple[Any, Any, Any]:
    """(reflected, residual, envelope) beyond the last slice as within."""
    one = expr.vec(1.0, 1.0, 1.0)

    def times(colour: Any, level: Any) -> Any:
        return colour * level if options.coloured else expr.scale(colour, level)

    if options.above == "scale":
        beyond = expr.vector_node("MAXIMUM", x, one) if options.coloured else expr.maximum(x, 1.0)
        residual = times(rest, beyond)
        return residual + times(m, x), residual, m
    held = expr.vector_node("MINIMUM", x, one) if options.coloured else expr.minimum(x, 1.0)
    reflected = rest + times(m, held)
    if last is None:
        return reflected, rest, m
    bounded = expr.vector_node("MINIMUM", m, expr.scale(last + m, 1 / expr.maximum(peak, 1.0)))
    return reflected, reflected - times(bounded, x), bounded
