"""The grid of a table as a material.json describes it, of any of the five kinds, and its size as a texture."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..bundle.checked_json import Fields
from ..errors import BakeError
from ..patches import KLEMS
from ..tables.grids.anisotropic_grids import NORMAL_KINDS, AnisotropicHalfGrid, AnisotropicNormalGrid
from ..tables.grids.grid import HORIZON_SHARES, Grid
from ..tables.grids.half_vector_grid import MAX_SAMPLES, HalfVectorGrid
from ..tables.grids.normal_vector_grid import MAX_RESOLUTION, NormalVectorGrid
from ..tables.grids.parameterization import NARROWEST_END, PARAMETERIZATIONS, WIDEST_END, LogWarp
from ..tables.grids.patch_grid import PatchGrid

AnisotropicGrid = AnisotropicNormalGrid | AnisotropicHalfGrid | PatchGrid


def is_anisotropic(grid: Grid) -> bool:
    """Whether the grid has four dimensions."""
    return len(grid.shape) == 4


def grid_of(fields: Fields, anisotropic: bool) -> Grid:
    """What `facts()` of the grid gave. Raises BakeError."""
    return _anisotropic(fields) if anisotropic else _isotropic(fields)


def _isotropic(fields: Fields) -> NormalVectorGrid | HalfVectorGrid:
    basis = fields.text("basis", choices=("normal", "half"))
    kind: Any = fields.text("parameterization", choices=PARAMETERIZATIONS)
    horizon = fields.number("horizon_share", 0, 1)
    warps: Any = _warps(fields, 2 if basis == "normal" else 3) if kind == "fitted" else None
    if basis == "normal":
        n = fields.whole("n", 4, MAX_RESOLUTION)
        grid = NormalVectorGrid(n, kind, fields.number("alpha_theta", 0, 1), fields.number("alpha_phi", 0, 1), horizon)
        return replace(grid, warps=warps) if warps else grid
    sizes: Any = fields.wholes("sizes", (3, 3), 4, MAX_SAMPLES)
    power = fields.whole("cosine_power", 0, 2) if fields.has("cosine_power") else 0
    reciprocal = fields.flag("reciprocal")
    half = HalfVectorGrid(sizes, kind, reciprocal=reciprocal, horizon_share=horizon, cosine_power=power)
    if kind == "bezier":
        alphas: Any = fields.numbers("alphas", (3, 3), 0, 1)
        half = replace(half, alphas=alphas)
    return replace(half, warps=warps) if warps else half


def _anisotropic(fields: Fields) -> AnisotropicGrid:
    basis = fields.text("basis", choices=("half", "normal", "patches"))
    if basis == "patches":
        return PatchGrid(fields.text("parameterization", choices=tuple(KLEMS)))
    shape: Any = fields.wholes("shape", (4, 4), 4, 1024)
    folded = fields.flag("folded")
    # Older bundles have none of these three.
    horizon = fields.number("horizon_share", 0, 1) if fields.has("horizon_share") else HORIZON_SHARES[0]
    if basis == "half":
        x, y = (fields.number(f"width_{k}", 1e-4, 1e3) for k in "xy")
        power = fields.whole("cosine_power", 1, 2) if fields.has("cosine_power") else 1
        falling = fields.flag("falling") if fields.has("falling") else False
        return AnisotropicHalfGrid(shape, x, y, folded, horizon, power, falling)
    # Beyond the pole azimuths go on half a turn further, which has to be a sample.
    if shape[3] % 2 or (not folded and shape[0] % 2):
        raise BakeError(fields.where, "'table.shape' has an odd azimuth", "bake it again")
    # Bundles of before version 2 do not name their parameterisation: it is Bezier.
    kind = fields.text("parameterization", choices=NORMAL_KINDS) if "parameterization" in fields.entries else "bezier"
    grid = AnisotropicNormalGrid(shape, folded=folded, parameterization=kind, horizon_share=horizon)
    if kind == "fitted":
        near, far = _warps(fields, 2)
        return replace(grid, warps=(near, far))
    if kind == "bezier":
        theta, phi = fields.number("alpha_theta", 0, 1), fields.number("alpha_phi", 0, 1)
        return replace(grid, alpha_theta=theta, alpha_phi=phi)
    return grid


def _warps(fields: Fields, count: int) -> tuple[LogWarp, ...]:
    ends = fields.rows("warps", (count, count), 2, NARROWEST_END, WIDEST_END)
    return tuple(LogWarp(near, far) for near, far in ends)
