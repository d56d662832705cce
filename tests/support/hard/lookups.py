"""Cases of table lookups in both bases, isotropic and anisotropic, and of the samplers that draw from such tables."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.cell_sampler import build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.slope_cells import SlopeLayout
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.table import Table, tabulate
from measured_materials.nodes import expr
from measured_materials.nodes.alias_sampler_group import alias_sampler_group
from measured_materials.nodes.group import call
from measured_materials.nodes.table_lookup_group import table_lookup_group

from ..cards import data_image
from ..osl import declared_table
from .angles import AROUND, HALF, NORMAL, NORMAL_FITTED, SLOPES
from .case import Array, Case, Osl
from .points import DIRECTIONS, pairs_above

# The bright texel lies inside, where a tent of unit width is what linear reconstruction must give.
BRIGHT = 1e4
ALL_EQUAL, FAR = 0.25, 1e30


@dataclass(frozen=True)
class Kind:
    """A grid and the place of its bright texel; `four` axes or three."""

    name: str
    grid: Any
    texel: tuple[int, ...]
    filter: str = "trilinear"

    @property
    def four(self) -> bool:
        """Anisotropic."""
        return len(self.texel) == 4


KINDS = (
    Kind("normal-vector basis, Bezier", NORMAL, (9, 10, 20)),
    Kind("normal-vector basis, fitted", NORMAL_FITTED, (9, 10, 20)),
    Kind("half-vector basis, fitted", HALF, (5, 9, 4)),
    Kind("normal-vector basis, Bezier, B-spline", NORMAL, (9, 10, 20), "bspline"),
    Kind("anisotropic, normal-vector basis", AROUND, (4, 3, 4, 9)),
    Kind("anisotropic, half-vector basis", SLOPES, (4, 3, 7, 9)),
)
GLOSSY = analytic.Ggx(alpha=0.1)


def cases() -> list[Case]:
    """Of this module."""
    return [*(_lookup(kind) for kind in KINDS), _reciprocal(), _alias(), _slopes()]


def _values(kind: Kind) -> Array:
    """Red all equal, green one bright texel among zeros, blue 1e30 everywhere."""
    values = np.zeros((*kind.grid.shape, 3), np.float32)
    values[..., 0], values[..., 2] = ALL_EQUAL, FAR
    values[(*kind.texel, 1)] = BRIGHT
    return values


def _table(kind: Kind) -> Any:
    return Table(kind.grid, _values(kind))


def _probes(kind: Kind) -> tuple[Array, Array]:
    """Hard directions, and those of the bright texel itself with 200 within half a sample of it."""
    wi, wo = pairs_above()
    places = ([np.array([i + d]) for i, d in zip(kind.texel, step)] for step in _steps(len(kind.texel)))
    near = [np.stack(kind.grid.directions(*place), 0)[:, 0] for place in places]
    rng = np.random.default_rng(2)
    close = [np.stack(a) for a in zip(*near)]
    shares = rng.random((200, 1))
    mixed = [(w[0] * (1 - 0.5 * shares) + w[rng.integers(1, len(w), 200)] * 0.5 * shares) for w in close]
    mixed = [m / np.linalg.norm(m, axis=-1, keepdims=True) for m in mixed]
    return tuple(  # type: ignore[return-value]
        np.concatenate([w, c, m]).astype(np.float32) for w, c, m in zip((wi, wo), close, mixed)
    )


def _steps(axes: int) -> list[tuple[int, ...]]:
    """No step, and one along each axis either way."""
    return [(0,) * axes, *(tuple(s * (k == j) for j in range(axes)) for k in range(axes) for s in (-1, 1))]


def _tent(kind: Kind, wi: Array, wo: Array) -> Array:
    """Weight of the bright texel from the distance to it along every axis, in samples."""
    grid = kind.grid
    position = grid.coordinates(xp_numpy, wi, wo)
    weight = np.ones(len(wi))
    for axis, (p, i) in enumerate(zip(position, kind.texel)):
        distance = np.abs(p - i)
        if kind.four and axis == 0:
            distance = np.minimum(distance, grid.shape[0] - distance)
        weight *= np.maximum(1 - distance, 0)
    return weight


def _lookup(kind: Kind) -> Case:
    def truth(wi: Array, wo: Array) -> Array:
        if kind.filter == "bspline":
            bright = _table(kind).evaluate(wi, wo, "bspline")[:, 1]
        else:
            bright = BRIGHT * _tent(kind, wi, wo)
        factor = kind.grid.factor(xp_numpy, wi, wo) if kind.four else 1.0
        ones = np.ones(len(wi))
        bright = bright if kind.filter == "bspline" else bright / factor
        return np.stack([ALL_EQUAL * ones / factor, bright, FAR * ones / factor], -1)

    def error(found: Array, true: Array, wi: Array, wo: Array) -> Array:
        factor = kind.grid.factor(xp_numpy, wi, wo) if kind.four else np.ones(len(wi))
        scale = np.stack([true[:, 0], BRIGHT / np.broadcast_to(factor, len(wi)), true[:, 2]], -1)
        return np.abs(found - true) / scale

    bound = 1e-4 if kind.four else 5e-5
    return Case(
        "lookups",
        kind.name,
        "all equal; one texel of 1e4 among zeros; 1e30 everywhere; to 89.99 degrees, poles, the texel itself",
        "of the largest",
        "texture coordinates of 2^-24 of up to 200 texels, 1e-5 of a texel each; GPUs round them to 1/256",
        {"float64": 2e-7, "nodes": bound, "osl": bound},
        partial(_probes, kind),
        truth,
        numpy=lambda folder, wi, wo: _table(kind).evaluate(wi, wo, kind.filter),
        nodes=lambda folder, wi, wo: call(_lookup_group(kind), wi, wo, 0.5),
        osl=partial(_osl_lookup, kind),
        error=error,
        low=0,
    )


def _lookup_group(kind: Kind) -> Any:
    image = data_image(kind.name, pack(kind.grid, _values(kind)))
    return table_lookup_group(f"hard {kind.name}", image, kind.grid, kind.filter)


def _osl_lookup(kind: Kind, folder: Path) -> Osl:
    file = folder / f"{kind.name.replace(' ', '_')}.exr"
    packed = pack(kind.grid, _values(kind))
    write_image(file, packed, Storage.FLOAT32)
    table = declared_table(kind.grid, file, kind.filter)
    body = f"{table}\ncolor c = mm_lookup(table, g, wi, wo, 0.5); for (int k = 0; k < 3; ++k) y[k] = c[k];"
    return Osl(body, 3, ("wi", "wo"))


@cache
def _glossy() -> Table:
    return tabulate(GLOSSY, HALF)


def _reciprocal() -> Case:
    """f(wi, wo) - f(wo, wi) of a table of half vectors, whose phi_d is folded."""

    def osl(folder: Path) -> Osl:
        file = folder / "reciprocal.exr"
        write_image(file, pack(_glossy().grid, _glossy().values), Storage.FLOAT32)
        body = declared_table(HALF, file, "trilinear")
        body += "color c = mm_lookup(table, g, wi, wo, 0.5) - mm_lookup(table, g, wo, wi, 0.5);"
        return Osl(body + "for (int k = 0; k < 3; ++k) y[k] = c[k];", 3, ("wi", "wo"))

    def nodes(folder: Path, wi: Any, wo: Any) -> Any:
        group = table_lookup_group(
            "hard reciprocal", data_image("reciprocal", pack(_glossy().grid, _glossy().values)), HALF, "trilinear"
        )
        return call(group, wi, wo, 0.5) - call(group, wo, wi, 0.5)

    def numpy(folder: Path, wi: Array, wo: Array) -> Array:
        return _glossy().evaluate(wi, wo) - _glossy().evaluate(wo, wi)

    return Case(
        "lookups",
        "reciprocity, half-vector basis, GGX of alpha 0.1",
        DIRECTIONS,
        "1/sr, per value above 1",
        "the exchange changes no bit of any coordinate",
        {"float64": 0, "nodes": 1e-6, "osl": 1e-6},
        pairs_above,
        lambda wi, wo: np.zeros((len(wi), 3)),
        numpy=numpy,
        nodes=nodes,
        osl=osl,
        error=lambda found, true, wi, wo: np.abs(found) / np.maximum(_glossy().evaluate(wi, wo), 1),
    )


def _draws() -> tuple[Array, ...]:
    """Viewers from the normal to 89.99 degrees, and random numbers of which many are exactly 0 or 1."""
    rng = np.random.default_rng(5)
    theta = np.concatenate([[0, 1e-7, 1e-4, np.radians(89), np.radians(89.99)], np.arccos(rng.random(59))])
    u = rng.choice([0.0, 1.0, np.nextafter(np.float32(1), np.float32(0)), 0.37, 0.5], (16, 4))
    wo, u = np.repeat(spherical(theta, 0.0), 16, 0), np.tile(u, (len(theta), 1))
    u[8::16] = rng.random((len(theta), 4))
    return (wo.astype(np.float32), *u.astype(np.float32).T)


def _sampler_case(name: str, points: str, numpy: Any, nodes: Any, osl: Any) -> Case:
    """Length of the drawn direction, 1 where its density is positive, and whether it is finite."""

    def checked(xp: Any, wi: Any, pdf: Any) -> tuple[Any, Any]:
        return xp.length(wi), (pdf > 0) * 1.0

    return Case(
        "samplers",
        name,
        points,
        "length of wi",
        "a reflection about a unit vector; density positive for every draw, all finite",
        {"float64": 1e-6, "nodes": 2e-6, "osl": 2e-6},
        _draws,
        lambda wo, *u: np.ones((len(wo), 2)),
        numpy=lambda folder, wo, *u: checked(xp_numpy, *numpy(wo, np.stack(u, -1))),
        nodes=lambda folder, wo, *u: checked(expr, *call(nodes(), wo, *u)),
        osl=osl,
        low=0,
    )


_ENDS = "random numbers exactly 0 and 1; viewers from the normal to 89.99 degrees; "


def _alias() -> Case:
    layout = SamplerLayout(16, 24, 16)
    sampler = build_sampler(_table(KINDS[2]), layout)

    def osl(folder: Path) -> Osl:
        file = folder / "cells.exr"
        write_image(file, sampler.texels, Storage.FLOAT32)
        body = f'MMSampler s = {{"{file}", 16, 0, 24, 16, 2, 0, 0, 0, 0, 1}}; float pdf;'
        body += "vector wi = mm_draw(s, wo, a, b, c, d, pdf);"
        return Osl(body + "y[0] = length(wi); y[1] = pdf > 0;", 2, ("wo", "a", "b", "c", "d"))

    return _sampler_case(
        "alias tables of half vectors",
        _ENDS + "a table of 1e30, one bright texel",
        sampler.sample,
        lambda: alias_sampler_group("hard alias", data_image("hard alias", sampler.texels), layout),
        osl,
    )


def _slopes() -> Case:
    layout = SlopeLayout(6, 8, 14, 12, 0.1, 0.4, True)
    sampler = build_sampler(analytic.Ggx(alpha=0.01, alpha_y=0.4), layout)

    def osl(folder: Path) -> Osl:
        file = folder / "slopes.exr"
        write_image(file, sampler.texels, Storage.FLOAT32)
        body = f'MMSampler s = {{"{file}", 6, 8, 12, 14, 0, 0.1, 0.4, 1, 0, 1}}; float pdf;'
        body += "vector wi = mm_draw(s, wo, a, b, c, d, pdf); y[0] = length(wi); y[1] = pdf > 0;"
        return Osl(body, 2, ("wo", "a", "b", "c", "d"))

    return _sampler_case(
        "alias tables of slopes, anisotropic",
        _ENDS + "GGX of alpha 0.01 and 0.4",
        sampler.sample,
        lambda: alias_sampler_group("hard slopes", data_image("hard slopes", sampler.texels), layout),
        osl,
    )
