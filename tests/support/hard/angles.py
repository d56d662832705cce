"""Cases of the parameterisations and of the coordinates of direction pairs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
from measured_materials.bake.tables.grids import parameterization as par
from measured_materials.bake.tables.grids.anisotropic_grids import AnisotropicHalfGrid, AnisotropicNormalGrid
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import NARROWEST_END, WIDEST_END, LogWarp
from measured_materials.nodes.group import call
from measured_materials.nodes.table_lookup_group import coordinates_group

from ..osl import osl_grid
from . import truth
from .case import Array, Case, Osl
from .points import DIRECTIONS, EPS, pairs, ulps_around, unit_interval

ALPHAS = (0.0, float(np.nextafter(np.float32(0), np.float32(1))), *map(float, ulps_around(0.5)))
ALPHAS += (float(np.nextafter(np.float32(1), np.float32(0))), 1.0)
WARPS = (
    LogWarp(NARROWEST_END, WIDEST_END),
    LogWarp(WIDEST_END, NARROWEST_END),
    LogWarp(NARROWEST_END, NARROWEST_END),
    LogWarp(),
)
SHAPES: dict[str, tuple[Any, ...]] = {
    "identity": (None,),
    "uniform": (None,),
    "squared": (None,),
    "bezier": ALPHAS,
    "fitted": WARPS,
}
NORMAL = NormalVectorGrid(16, "bezier", 0.3, 0.15)
NORMAL_FITTED = NormalVectorGrid(16, "fitted", warps=(LogWarp(0.003, 0.4), LogWarp(0.01, 0.1)))
HALF = HalfVectorGrid((12, 20, 9), "fitted", warps=(LogWarp(4.0, 0.1), LogWarp(0.003, 4.0), LogWarp(0.1, 0.4)))
SLOPES = AnisotropicHalfGrid((12, 6, 15, 17), 0.2, 0.6)
AROUND = AnisotropicNormalGrid((12, 7, 8, 20), 0.4, 0.3)
_TINY = "0, 1, 0.5, an ulp beside each, 1e-7 to 1e-45"


def cases() -> list[Case]:
    """Of this module."""
    return [
        *(_forward(kind) for kind in SHAPES),
        *(_inverse(kind) for kind in SHAPES),
        _normal("Bezier", NORMAL),
        _normal("fitted", NORMAL_FITTED),
        _half(),
    ]


def osl_vector(shape: Any) -> str:
    """A shape as `mm_forward` takes it."""
    numbers = shape.constants if isinstance(shape, LogWarp) else (shape or 0.0,) * 3
    return f"vector({', '.join(f'{x:.9g}' for x in numbers)})"


def _title(kind: str) -> str:
    more = {"bezier": "Bezier, 7 alphas at 0, 0.5, 1 and an ulp beside", "fitted": "fitted, 4 warps with ends of 3e-4"}
    return more.get(kind, kind)


def _forward(kind: str) -> Case:
    shapes = SHAPES[kind]
    loose = 6e-7 if kind == "fitted" else 3e-7
    lines = [f'y[{k}] = mm_forward("{kind}", x, {osl_vector(s)});' for k, s in enumerate(shapes)]
    return Case(
        "parameterisations",
        f"parameter of a chord, {_title(kind)}",
        _TINY,
        "s, per slope above 1",
        "a handful of roundings of numbers up to 2; sines and logarithms to 4 ulp",
        {"float64": 1e-14, "float32": loose, "nodes": loose, "osl": loose},
        unit_interval,
        truth.each(lambda v: tuple(truth.parameter(kind, s, v) for s in shapes)),
        lambda xp, v: tuple(par.forward(xp, kind, v, s) for s in shapes),
        osl=lambda folder: Osl("\n".join(lines), len(shapes), ("x",)),
        error=lambda found, true, v: np.abs(found - true) / np.stack([steep(kind, s, v) for s in shapes], -1),
        low=-4 * EPS,
        high=1 + 4 * EPS,
    )


def steep(kind: str, shape: Any, v: Array) -> Array:
    """|ds / dv|, at least 1: what a chord's own last bit is worth."""
    if kind == "fitted":
        slope = shape.constants[2] * (1 / (v + shape.near) + 1 / (1 + shape.far - v))
    elif kind == "squared":
        # d sqrt(theta): infinite at 0, where the chord is known no better than to the smallest normal number.
        slope = 0.6 / np.sqrt(np.maximum(v, 1e-38))
    else:
        slope = np.full(np.shape(v), 2.0)
    return np.maximum(slope, 1)


def _inverse(kind: str) -> Case:
    shapes = SHAPES[kind]
    bound = 3e-6 if kind == "fitted" else 5e-7
    return Case(
        "parameterisations",
        f"angle of a parameter, {_title(kind)}",
        _TINY,
        "rad",
        "the chord to one rounding per operation, the angle grows at most twice as fast",
        {"float64": 1e-13 if kind == "fitted" else 1e-14, "float32": bound, "nodes": bound},
        unit_interval,
        truth.each(lambda s: tuple(truth.angle(kind, shape, s) for shape in shapes)),
        lambda xp, s: tuple(par.inverse(xp, kind, s, shape) for shape in shapes),
        error=lambda found, true, s: np.abs(2 * np.arcsin(np.minimum(found, 1) / np.sqrt(2)) - true),
        low=0,
        high=1 + 4 * EPS,
    )


def _osl_coordinates(grid: Any, folder: Path) -> Osl:
    body = f"MMGrid g = {osl_grid(grid)};"
    return Osl(
        body + "vector at = mm_coordinates(g, wi, wo); for (int k = 0; k < 3; ++k) y[k] = at[k];", 3, ("wi", "wo")
    )


def _coordinates(name: str, grid: Any, bounds: dict[str, float], reason: str, true: Any, weights: Any) -> Case:
    def error(found: Array, expected: Array, wi: Array, wo: Array) -> Array:
        return np.abs(found - expected) * weights(wi, wo)

    return Case(
        "coordinates",
        name,
        DIRECTIONS,
        "chord; azimuths times their sines",
        reason,
        bounds,
        pairs,
        true,
        lambda xp, wi, wo: grid.unit_coordinates(xp, wi, wo),
        nodes=lambda folder, wi, wo: call(coordinates_group(grid), wi, wo),
        osl=partial(_osl_coordinates, grid),
        error=error,
        low=-4 * EPS,
        high=1 + 4 * EPS,
    )


def _at_angle(kind: str, shape: Any, theta: Any) -> Any:
    """Parameter of an angle, which may have no meaning."""
    return theta if mp.isnan(theta) else truth.parameter(kind, shape, truth.chord(min(theta, mp.pi / 2)))


def _azimuth(kind: str, shape: Any, phi: Any) -> Any:
    """u in [0, 1] of phi in [0, pi], 1 at 0."""
    if mp.isnan(phi):
        return phi
    s = truth.parameter(kind, shape, truth.chord(min(phi, mp.pi - phi)))
    return (1 + s) / 2 if phi < mp.pi / 2 else (1 - s) / 2


def _angles(function: Callable[..., Any]) -> Callable[..., Array]:
    """Angles of pairs in float64, 0 where they are undefined."""
    return lambda wi, wo: np.nan_to_num(truth.each(function)(wi, wo))


def _normal(name: str, grid: NormalVectorGrid) -> Case:
    kind, (theta, phi) = grid.parameterization, grid.axis_shapes

    def row(wi: Any, wo: Any) -> tuple[Any, ...]:
        theta_o, theta_i, phi_delta = truth.normal_angles(wi, wo)
        return _at_angle(kind, theta, theta_o), _at_angle(kind, theta, theta_i), _azimuth(kind, phi, phi_delta)

    def weights(wi: Array, wo: Array) -> Array:
        theta_o, theta_i, phi_delta = _angles(truth.normal_angles)(wi, wo).T
        v = [np.sqrt(2) * np.sin(np.minimum(a, np.pi - a) / 2) for a in (theta_o, theta_i, phi_delta)]
        sine = np.minimum(np.sin(theta_o), np.sin(theta_i))
        factors = [1 / steep(kind, s, x) for s, x in zip((theta, theta, phi), v)]
        return np.stack([factors[0], factors[1], factors[2] * sine], -1)

    bounds = {"float64": 6e-8, "float32": 5e-7, "nodes": 5e-7, "osl": 5e-7}
    reason = "a few roundings of unit vectors; float64 too starts from float32 vectors, whose lengths are 6e-8 off"
    return _coordinates(f"normal-vector basis, {name}", grid, bounds, reason, truth.each(row), weights)


def _half() -> Case:
    grid = HALF

    def row(wi: Any, wo: Any) -> tuple[Any, ...]:
        if min(wi[2], wo[2]) < 0 or wi[2] + wo[2] == 0:
            return (mp.nan,) * 3
        theta_d, theta_h, phi_d = truth.half_angles(wi, wo)
        most = mp.pi / 4 if mp.isnan(phi_d) else truth.largest_theta_d(theta_h, phi_d)
        share = min(truth.chord(theta_d) / truth.chord(most), mp.mpf(1))
        u_d = mp.nan if mp.isnan(phi_d) else truth.parameter("fitted", grid.warps[0], share)
        return u_d, _at_angle("fitted", grid.warps[1], theta_h), _at_angle("fitted", grid.warps[2], phi_d)

    def weights(wi: Array, wo: Array) -> Array:
        def angles(wi: Any, wo: Any) -> tuple[Any, ...]:
            theta_d, theta_h, phi_d = truth.half_angles(wi, wo)
            most = mp.nan if mp.isnan(phi_d) else truth.chord(truth.largest_theta_d(theta_h, phi_d))
            return theta_d, theta_h, phi_d, most

        theta_d, theta_h, phi_d, most = _angles(angles)(wi, wo).T
        share = np.sqrt(2) * np.sin(theta_d / 2) / np.maximum(most, 1e-30)
        v = np.minimum(share, 1), np.sqrt(2) * np.sin(theta_h / 2), np.sqrt(2) * np.sin(phi_d / 2)
        factors = [1 / steep("fitted", warp, x) for warp, x in zip(grid.warps, v)]
        arcs = most * np.cos(theta_d), np.cos(theta_d), np.sin(theta_h) * np.sin(theta_d) * np.cos(theta_d)
        return np.stack([f * a for f, a in zip(factors, arcs)], -1)

    bounds = {"float64": 6e-8, "float32": 5e-7, "nodes": 5e-7, "osl": 5e-7}
    reason = "as in the other basis; h is moved by a rounding over |wi + wo|, theta_d is a share of its largest"
    return _coordinates("half-vector basis, fitted", grid, bounds, reason, truth.each(row), weights)
