"""Wool: a knitted stockinette of soft plied yarn with fuzz."""

from __future__ import annotations

import bpy
import numpy as np

from .fibres import curls
from .periodic import Array, Generator, sample, smooth_noise
from .stock import coloured
from .surfaces import Surface, add_object, backing, join, tubes, visible_height
from .swatch import Swatch

_WALES, _COURSES = 6, 7
_STRANDS = 12
_FUZZ = 13000
_CREAM = np.array((0.62, 0.52, 0.38))
_RADIUS = 0.155 / _WALES


def wool(seed: int = 0) -> Swatch:
    """Undyed wool, knitted."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        rng = np.random.default_rng(seed)
        knit = _knit(rng)
        surface = join(knit, _fuzz(rng, knit), backing(knit.points[:, 2].min() - 0.01, (0.2, 0.16, 0.11)))
        return [add_object(scene, "Swatch wool", surface, coloured("Swatch wool"), visible_height(surface))]

    return Swatch("wool", build, 0.15, "knitted wool, stockinette, with fuzz", "oren_nayar", {"roughness": 0.5})


def _knit(rng: Generator) -> Surface:
    """Strands about the course of each row's loops: legs in front, heads and feet behind."""
    t = np.linspace(0, 1, 36 * _WALES + 1)
    theta = 2 * np.pi * _WALES * t
    rows = np.arange(_COURSES)[:, None]
    stray = [0.06 * sample(smooth_noise(rng, 128, 0.1), t + 0 * rows, rows / _COURSES + 0 * t) for _ in range(2)]
    u = t + (0.22 * np.sin(2 * theta) + stray[0]) / _WALES
    v = (rows + 0.5 + 0.74 * np.cos(theta) + stray[1]) / _COURSES
    z = -0.85 * _RADIUS * np.cos(2 * theta) + 0 * rows
    centre = np.stack([u, v, z], -1)
    # Periodic differences: the first and the last point of a row are the same one.
    tangent = np.roll(centre[:, :-1], -1, 1) - np.roll(centre[:, :-1], 1, 1)
    tangent[:, [0, -1], 0] += 1
    tangent = np.concatenate([tangent, tangent[:, :1]], axis=1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    side = np.cross(tangent, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    across = np.cross(side, tangent)
    return _strands(rng, t, centre, side, across)


def _strands(rng: Generator, t: Array, centre: Array, side: Array, across: Array) -> Surface:
    phase = 2 * np.pi * np.arange(_STRANDS)[:, None] / _STRANDS
    angle = phase + 2 * np.pi * 2 * _WALES * t
    migrate = 1 + 0.14 * np.sin(2 * np.pi * rng.integers(2, 30, (_COURSES, _STRANDS, 1)) * t + 5 * phase)
    strand = 1.35 * np.pi * _RADIUS / _STRANDS
    reach = ((_RADIUS - 0.8 * strand) * migrate)[..., None]
    outline = centre[:, None] + reach * (
        np.cos(angle)[None, ..., None] * side[:, None] + np.sin(angle)[None, ..., None] * across[:, None]
    )
    bright = 1 + 0.06 * rng.standard_normal((_COURSES, _STRANDS, 1))
    colour = np.clip(_CREAM * bright, 0, 0.9)
    hull = tubes(outline.reshape(-1, len(t), 3), strand, colour.reshape(-1, 1, 3), sides=5)
    return join(hull, tubes(centre, 0.8 * _RADIUS, 0.8 * _CREAM, sides=7))


def _fuzz(rng: Generator, knit: Surface) -> Surface:
    chosen = rng.choice(np.flatnonzero(knit.points[:, 2] > -0.5 * _RADIUS), _FUZZ)
    start = np.stack([*rng.standard_normal((2, _FUZZ)), rng.uniform(0.1, 0.9, _FUZZ)], -1)
    start /= np.linalg.norm(start, axis=-1, keepdims=True)
    length = 0.035 * np.exp(np.clip(0.5 * rng.standard_normal(_FUZZ), -1, 0.7))
    return curls(rng, knit.points[chosen], start, length, 0.0008, np.minimum(1.2 * knit.colour[chosen], 0.9))
