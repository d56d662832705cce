"""Cases of shading maps: light at every level, by slices and by the power law."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
from measured_materials.bake.shading_maps.envelope_split import split
from measured_materials.bake.shading_maps.power_law import PowerLaw
from measured_materials.bake.shading_maps.shading_map import ShadingMap
from measured_materials.bake.shading_maps.slice_atlas import SliceLayout, pack_slices
from measured_materials.nodes.group import call
from measured_materials.nodes.map_models import power_group
from measured_materials.nodes.slices_group import SliceImages, SliceOptions, slices_group

from ..cards import data_image
from . import truth
from .case import Array, Case
from .points import ulps_around

HEIGHT, WIDTH, SLICES = 4, 4, 6
HOT = 1e4
LEVELS = "x = r / a_max at 0, 1e-40, 1e-20, each slice and 1 with an ulp beside, 2, 1e4"


def cases() -> list[Case]:
    """Of this module."""
    return [_slices("clamp"), _slices("scale"), _power("clamp"), _power("scale")]


def _levels() -> Array:
    slices = [k / (SLICES - 1) for k in range(1, SLICES)]
    return np.array([0, 1e-40, 1e-20, 1e-6, *ulps_around(*slices), 0.1, 0.33, 0.77, 1.5, 2, 1e4], np.float32)


def _points() -> tuple[Array, Array]:
    """uv at the centre of every texel, v upwards, and levels."""
    rows, columns, x = (a.ravel() for a in np.meshgrid(range(HEIGHT), range(WIDTH), _levels(), indexing="ij"))
    uv = np.stack([(columns + 0.5) / WIDTH, 1 - (rows + 0.5) / HEIGHT, np.zeros(len(x))], -1)
    return uv.astype(np.float32), x.astype(np.float32)


def _texel(uv: Array) -> tuple[Array, Array]:
    return (HEIGHT * (1 - uv[:, 1])).astype(int), (WIDTH * uv[:, 0]).astype(int)


@cache
def _map() -> ShadingMap:
    """Texels in proportion to light, black ones, random ones, and one of 1e4 at the last slice."""
    rng = np.random.default_rng(3)
    slices = np.cumsum(rng.random((SLICES, HEIGHT, WIDTH, 3)), 0).astype(np.float32)
    levels = np.linspace(0, 1, SLICES, dtype=np.float32)[:, None, None]
    slices[:, 0] = levels * np.float32(0.7)
    slices[:, 1] = 0
    slices[-1, 2, 1], slices[0] = HOT, 0
    return ShadingMap(slices)


def _error(found: Array, true: Array, uv: Array, x: Array) -> Array:
    """Of the texel's brightest slice, and of its excess beyond the last."""
    at = _texel(uv)
    largest = _map().slices[:, at[0], at[1]].max(0) * np.maximum(x, 1)[:, None]
    return np.abs(found - true) / np.maximum(np.concatenate([largest] * (found.shape[1] // 3), -1), 1e-3)


def _slices(above: str) -> Case:
    def true(uv: Array, x: Array) -> Array:
        slices, (row, column) = _map().slices, _texel(uv)
        out = np.empty((len(x), 3))
        for i, level in enumerate(x):
            position = min(Fraction(float(level)), Fraction(1)) * (SLICES - 1)
            base = min(int(position), SLICES - 2)
            t = position - base
            for channel in range(3):
                low, high = (Fraction(float(slices[k, row[i], column[i], channel])) for k in (base, base + 1))
                value = low + t * (high - low)
                out[i, channel] = float(value * max(Fraction(float(level)), 1) if above == "scale" else value)
        return out

    def both(uv: Array, x: Array) -> Array:
        # The residual has no truth of its own: it must be finite and >= 0.
        return np.concatenate([true(uv, x), np.full((len(x), 3), np.nan)], -1)

    def numpy(folder: Path, uv: Array, x: Array) -> Array:
        value = _map().evaluate(uv[:, :2], x, above)  # type: ignore[arg-type]
        return np.concatenate([value, np.zeros_like(value)], -1)

    def nodes(folder: Path, uv: Any, x: Any) -> tuple[Any, Any]:
        parts = split(_map())
        envelope = np.concatenate([parts.envelope, parts.share[..., None]], -1)
        images = SliceImages(
            data_image("hard residual", pack_slices(parts.residual[1:])),
            data_image("hard envelope", envelope),
            SliceLayout(SLICES - 1, HEIGHT, WIDTH),
        )
        return call(slices_group("hard slices", images, SliceOptions(above, interpolation="Closest")), uv, x, 1.0, 0.5)[
            :2
        ]

    return Case(
        "shading maps",
        f"slices, {above} above a_max; residual >= 0",
        LEVELS + "; texels black, in proportion to light, one of 1e4",
        "of the texel's brightest slice",
        "residual and envelope are each rounded once, the place between two slices to 2^-22 of a step",
        {"float64": 1e-6, "nodes": 2e-6},
        _points,
        both,
        numpy=numpy,
        nodes=nodes,
        error=_error,
        low=0,
    )


@cache
def _law() -> PowerLaw:
    """Exponents at both bounds and between, k at 0, tiny and 1e4."""
    exponents = np.array([0.05, 0.3, 0.999, 1, 1.001, 2, 7, 20], np.float32)
    k = np.array([0, 1e-20, 1, HOT], np.float32)
    size = (HEIGHT, WIDTH, 3)
    return PowerLaw(np.resize(np.repeat(k, 8), size), np.resize(exponents, size))


def _power(above: str) -> Case:
    def numbers() -> tuple[Array, ...]:
        uv, x = _points()
        row, column = _texel(uv)
        return uv, x, _law().k[row, column], _law().exponent[row, column]

    def row(uv: Any, x: Any, k: Any, exponent: Any) -> tuple[Any, ...]:
        held = min(x, mp.mpf(1))
        beyond = max(x, mp.mpf(1)) if above == "scale" else 1
        return tuple(a * held**b * beyond if held else mp.mpf(0) for a, b in zip(k, exponent))

    def nodes(folder: Path, uv: Any, x: Any, k: Any, exponent: Any) -> Any:
        image = data_image("hard power", pack_slices(np.stack([_law().k, _law().exponent])))
        images = SliceImages(image, image, SliceLayout(2, HEIGHT, WIDTH))
        group = power_group("hard power", images, SliceOptions(above, interpolation="Closest"))
        return call(group, uv, x, 1.0, 0.5)[0]

    def numpy(folder: Path, uv: Array, x: Array, k: Array, exponent: Array) -> Array:
        value = PowerLaw(k, exponent).evaluate(np.minimum(x, 1)[:, None])
        return value * (np.maximum(x, 1)[:, None] if above == "scale" else np.ones((len(x), 1), x.dtype))

    return Case(
        "shading maps",
        f"power law, {above} above a_max",
        LEVELS + "; K from 0.05 to 20; k = 0, 1e-20, 1e4",
        "of k",
        "the logarithm of x in float32, K times",
        {"float32": 1e-6, "nodes": 1e-6},
        numbers,
        truth.each(row),
        numpy=numpy,
        nodes=nodes,
        error=lambda found, true, uv, x, k, exponent: (
            np.abs(found - true) / np.maximum(k * np.maximum(x, 1)[:, None], 1e-20)
        ),
        low=0,
    )
