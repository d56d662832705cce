"""The grid of a table as a material.json describes it, of any of the four kinds, and its size as a texture."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..anisotropic import atlas as anisotropic_atlas
from ..anisotropic.grid import NORMAL_KINDS, NormalGrid
from ..anisotropic.grid import HalfGrid as SlopeGrid
from ..atlas import AtlasLayout, unpack
from ..errors import BakeError
from ..half_grid import HalfGrid
from ..material_json import Fields
from ..parameterization import NARROWEST_END, PARAMETERIZATIONS, WIDEST_END, LogWarp
from ..source import Array
from ..table import TableGrid

MAX_RESOLUTION = 256
# Along one axis of a table in the half-vector basis, which has four times as many elevations of h.
_MAX_SAMPLES = 4 * MAX_RESOLUTION

IsotropicGrid = TableGrid | HalfGrid
AnisotropicGrid = NormalGrid | SlopeGrid
Grid = IsotropicGrid | AnisotropicGrid


def is_anisotropic(grid: Grid) -> bool:
    """Whether the grid has four dimensions."""
    return isinstance(grid, AnisotropicGrid)


def basis_of(grid: Grid) -> str:
    """ "normal" or "half", the vectors that its axes are angles of."""
    return "normal" if isinstance(grid, TableGrid | NormalGrid) else "half"


def texture_size(grid: Grid) -> tuple[int, int]:
    """(width, height) of the texture that holds a table on this grid. Raises BakeError where none is large enough."""
    if isinstance(grid, AnisotropicGrid):
        return anisotropic_atlas.SliceLayout.of(grid).size
    return AtlasLayout(grid.shape).size


def unpacked(grid: Grid, texels: Array) -> Array:
    """The samples, grid.shape + (3,), of a texture (height, width, 3)."""
    if isinstance(grid, AnisotropicGrid):
        return anisotropic_atlas.unpack(grid, texels)
    return unpack(texels, grid.shape)


def grid_of(fields: Fields, anisotropic: bool) -> Grid:
    """What `facts()` of the grid gave. Raises BakeError."""
    return _anisotropic(fields) if anisotropic else _isotropic(fields)


def _isotropic(fields: Fields) -> IsotropicGrid:
    basis = fields.text("basis", choices=("normal", "half"))
    kind: Any = fields.text("parameterization", choices=PARAMETERIZATIONS)
    horizon = fields.number("horizon_share", 0, 1)
    warps: Any = _warps(fields, 2 if basis == "normal" else 3) if kind == "fitted" else None
    if basis == "normal":
        n = fields.whole("n", 4, MAX_RESOLUTION)
        grid = TableGrid(n, kind, fields.number("alpha_theta", 0, 1), fields.number("alpha_phi", 0, 1), horizon)
        return replace(grid, warps=warps) if warps else grid
    sizes: Any = fields.wholes("sizes", (3, 3), 4, _MAX_SAMPLES)
    half = HalfGrid(sizes, kind, reciprocal=fields.flag("reciprocal"), horizon_share=horizon)
    if kind == "bezier":
        alphas: Any = fields.numbers("alphas", (3, 3), 0, 1)
        half = replace(half, alphas=alphas)
    return replace(half, warps=warps) if warps else half


def _anisotropic(fields: Fields) -> AnisotropicGrid:
    basis = fields.text("basis", choices=("half", "normal"))
    shape: Any = fields.wholes("shape", (4, 4), 4, 1024)
    folded = fields.flag("folded")
    if basis == "half":
        x, y = (fields.number(f"width_{k}", 1e-4, 1e3) for k in "xy")
        return SlopeGrid(shape, x, y, folded)
    # Beyond the pole azimuths go on half a turn further, which has to be a sample.
    if shape[3] % 2 or (not folded and shape[0] % 2):
        raise BakeError(fields.where, "'table.shape' has an odd azimuth", "bake it again")
    # Bundles of before version 2 do not name their parameterisation: it is Bezier.
    kind = fields.text("parameterization", choices=NORMAL_KINDS) if "parameterization" in fields.entries else "bezier"
    if kind == "fitted":
        near, far = _warps(fields, 2)
        return NormalGrid(shape, folded=folded, parameterization=kind, warps=(near, far))
    if kind != "bezier":
        return NormalGrid(shape, folded=folded, parameterization=kind)
    return NormalGrid(shape, fields.number("alpha_theta", 0, 1), fields.number("alpha_phi", 0, 1), folded)


def _warps(fields: Fields, count: int) -> tuple[LogWarp, ...]:
    ends = fields.rows("warps", (count, count), 2, NARROWEST_END, WIDEST_END)
    return tuple(LogWarp(near, far) for near, far in ends)
