"""Suede: a brushed nap of short fibres in tufts on a mottled hide."""

from __future__ import annotations

import bpy
import numpy as np

from .fibres import nap
from .periodic import Array, Generator, fractal_noise, grid, sample, smooth_noise, voronoi
from .stock import coloured
from .surfaces import Surface, add_object, height_field, join, visible_height
from .swatch import Swatch

_FIBRES = 215  # along an edge
_TUFTS = 44
_SIDE = 128
_TAN = np.array((0.56, 0.30, 0.135))


def suede(seed: int = 0) -> Swatch:
    """Tan suede, its nap laid towards +u and disturbed here and there."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        rng = np.random.default_rng(seed)
        ground = 0.003 * smooth_noise(rng, _SIDE, 0.2) + 0.001 * fractal_noise(rng, _SIDE, 0.1, 1.5)
        hide = height_field(ground, 0.4 * _TAN)
        surface = join(hide, _fibres(rng, ground))
        return [add_object(scene, "Swatch suede", surface, coloured("Swatch suede"), visible_height(surface))]

    return Swatch("suede", build, 0.06, "tan suede with a brushed nap", "oren_nayar", {"roughness": 0.5})


def _fibres(rng: Generator, ground: Array) -> Surface:
    u, v = (axis.ravel() + rng.random(_FIBRES**2) / _FIBRES for axis in grid(_FIBRES))
    roots = np.stack([u, v, sample(ground, u, v)], -1)
    lay = 0.5 * sample(smooth_noise(rng, _SIDE, 0.3), u, v) + 0.45 * rng.standard_normal(len(u))
    lift = 0.6 + 0.15 * sample(smooth_noise(rng, _SIDE, 0.22), u, v) + 0.2 * rng.standard_normal(len(u))
    lift = np.clip(lift, 0.15, 1.4)
    end = np.stack([np.cos(lay) * np.cos(lift), np.sin(lay) * np.cos(lift), np.sin(lift)], -1)
    length = 0.019 * np.exp(0.25 * rng.standard_normal(len(u))) * (1 + 0.15 * sample(smooth_noise(rng, 64, 0.2), u, v))
    # The tips of a tuft lean together.
    tuft = voronoi(rng, _TUFTS, u % 1, v % 1)
    end[:, :2] -= 16 * tuft.offset
    end /= np.linalg.norm(end, axis=-1, keepdims=True)
    start = np.stack([0.3 * np.cos(lay), 0.3 * np.sin(lay), np.ones_like(lay)], -1)
    start /= np.linalg.norm(start, axis=-1, keepdims=True)
    mottle = 1 + 0.13 * sample(fractal_noise(rng, _SIDE, 0.4, 1.6), u, v) + 0.12 * rng.standard_normal(len(u))
    tint = 1 + 0.1 * (rng.random(_TUFTS**2) - 0.5)[tuft.index]
    colour = np.clip(_TAN * (mottle * tint)[:, None], 0.01, 0.9)
    return nap(roots, start, end, length, 0.0015, colour)
