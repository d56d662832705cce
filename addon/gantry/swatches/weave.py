"""Woven cloth of twisted yarns after a pattern of crossings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .fibres import curls
from .periodic import Array, Generator, sample, smooth_noise
from .surfaces import Surface, join, tubes


@dataclass(frozen=True)
class YarnStyle:
    """Style of one of the two sets of yarns.

    width, thickness : half axes of the section, in spacings of its own set
    strands : along the outline of the section; twist : turns per tile
    slub : relative deviation of the thickness along a yarn; wander : of the course, in spacings
    colour : linear; uneven : relative deviation of the brightness from yarn to yarn
    """

    width: float
    thickness: float
    strands: int
    twist: int
    slub: float
    wander: float
    colour: tuple[float, float, float]
    uneven: float


def weave(
    rng: Generator,
    over: NDArray[np.bool_],
    repeats: tuple[int, int],
    warp: YarnStyle,
    weft: YarnStyle,
    crimp: float,
    fuzz: int,
) -> Surface:
    """A tile of cloth.

    Parameters
    ----------
    over : (weft, warp) whether the warp, which runs along v, lies on top
    repeats : of the pattern along v and u
    crimp : share of the wave that the warp takes; the weft has the rest
    fuzz : number of loose fibres
    """
    crossings = np.where(np.tile(over, repeats), 1.0, -1.0)
    rows, columns = crossings.shape
    depth = 0.9 * (warp.thickness / columns + weft.thickness / rows)
    along_v = _yarns(rng, warp, crossings.T, depth * crimp)
    along_u = _yarns(rng, weft, -crossings, depth * (1 - crimp))
    along_v = along_v._replace(points=along_v.points[:, [1, 0, 2]], quads=along_v.quads[:, ::-1])
    return join(along_v, along_u, _fuzz(rng, join(along_v, along_u), fuzz, 0.3 / columns))


def _yarns(rng: Generator, style: YarnStyle, levels: Array, amplitude: float) -> Surface:
    """Yarns along u, one for each row of levels (yarns, crossings) in -1 to 1, as strands about a core."""
    yarns, crossings = levels.shape
    t = np.linspace(0, 1, 10 * crossings + 1)
    spacing = 1 / yarns
    centre = amplitude * _interpolated(levels, t)
    noise = [smooth_noise(rng, 256, feature) for feature in (0.06, 0.12)]
    rows = rng.random((yarns, 1))
    size = 1 + style.slub * np.clip(sample(noise[0], t + 0 * rows, rows + 0 * t), -2, 2)
    course = (np.arange(yarns)[:, None] + 0.5 + style.wander * sample(noise[1], t + 0 * rows, rows + 0 * t)) * spacing

    half = np.array((style.width, style.thickness)) * spacing
    phase = 2 * np.pi * np.arange(style.strands) / style.strands + rng.uniform(0, 2 * np.pi, (yarns, 1))
    angle = phase[:, :, None] + 2 * np.pi * style.twist * t
    strand = 1.25 * np.pi * half.mean() / style.strands
    # Strands migrate in and out a little, or the yarn looks machined.
    migrate = 1 + 0.10 * np.sin(2 * np.pi * rng.integers(1, 9, (yarns, style.strands, 1)) * t + 3 * phase[:, :, None])
    section = (half - 0.8 * strand)[:, None, None, None] * np.stack([np.cos(angle), np.sin(angle)]) * migrate
    u = np.broadcast_to(t, angle.shape)
    v = course[:, None] + size[:, None] * section[0]
    z = centre[:, None] + size[:, None] * section[1]
    bright = 1 + style.uneven * rng.standard_normal((yarns, 1)) + 0.5 * style.uneven * rng.standard_normal(phase.shape)
    colour = np.clip(np.array(style.colour) * np.clip(bright, 0.3, 2)[..., None], 0, 0.95)
    outline = tubes(
        np.stack([u, v, z], -1).reshape(-1, len(t), 3),
        (strand * size[:, None] * np.ones_like(angle)).reshape(-1, len(t)),
        colour.reshape(-1, 1, 3),
        sides=5,
    )
    core = tubes(np.stack([t + 0 * centre, course, centre], -1), 0.8 * half.min() * size, colour.mean(1)[:, None], 6)
    return join(outline, core)


def _interpolated(levels: Array, t: Array) -> Array:
    """The wave (yarns, T) through levels (yarns, crossings) at the middles of the crossings."""
    count = levels.shape[1]
    place = t * count - 0.5
    before = np.floor(place).astype(int)
    share = place - before
    share = share * share * (3 - 2 * share)
    return levels[:, before % count] * (1 - share) + levels[:, (before + 1) % count] * share


def _fuzz(rng: Generator, yarns: Surface, count: int, length: float) -> Surface:
    """Loose fibres that stand out from the upper side of the yarns."""
    height = yarns.points[:, 2]
    upper = np.flatnonzero(height > np.median(height))
    chosen = rng.choice(upper, count)
    roots = yarns.points[chosen]
    start = np.stack([*rng.standard_normal((2, count)), rng.uniform(0.1, 1.0, count)], -1)
    start /= np.linalg.norm(start, axis=-1, keepdims=True)
    lengths = length * np.exp(np.clip(0.4 * rng.standard_normal(count), -1, 0.7))
    return curls(rng, roots, start, lengths, 0.03 * length, 1.05 * yarns.colour[chosen])
