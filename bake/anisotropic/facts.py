"""The parts of an anisotropic bundle's material.json: read back with every number checked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from ..bundle import Bundle, require
from ..errors import BakeError
from ..table_facts import decoded, log_of, warps_of
from ..tables.anisotropic_grids import NORMAL_KINDS, AnisotropicHalfGrid, AnisotropicNormalGrid
from ..tables.atlas import AtlasLayout, unpack
from ..tables.grid import HORIZON_SHARES, Grid
from ..tables.table import FILTERS, Filter, Table
from .envelope import AnisotropicFit
from .envelope_texture import fit_from_image
from .sampler import SlopeLayout, SlopeSampler


def is_anisotropic(bundle: Bundle) -> bool:
    """Whether the bundle holds a four-dimensional table."""
    table = bundle.material.get("table")
    return isinstance(table, dict) and table.get("anisotropic") is True


def grid_of(bundle: Bundle, name: str = "table") -> Grid:
    """The grid of "table" or "residual". Raises BakeError where it is not described, or the image has another size."""
    where = bundle.path / "material.json"
    table = require(bundle.material, "table", dict, where)
    basis = require(table, "basis", str, where, choices=("half", "normal"))
    sizes = require(table, "shape", list, where, 4, 4)
    if not all(isinstance(n, int) and not isinstance(n, bool) and 4 <= n <= 1024 for n in sizes):
        raise BakeError(where, "'table.shape' does not hold four sizes", "bake it again")
    shape = cast("tuple[int, int, int, int]", tuple(sizes))
    folded = require(table, "folded", bool, where)
    grid: Grid
    # Older bundles have neither.
    horizon, power = HORIZON_SHARES[0], 1
    if "horizon_share" in table:
        horizon = float(require(table, "horizon_share", float, where, minimum=0, maximum=1))
    if "cosine_power" in table:
        power = require(table, "cosine_power", int, where, minimum=1, maximum=2)
    falling = "falling" in table and require(table, "falling", bool, where)
    if basis == "half":
        x, y = (float(require(table, f"width_{k}", float, where, minimum=1e-4, maximum=1e3)) for k in "xy")
        grid = AnisotropicHalfGrid(shape, x, y, folded, horizon, power, falling)
    else:
        grid = replace(_normal_grid(table, shape, folded, where), horizon_share=horizon)
        # Beyond the pole azimuths go on half a turn further, which has to be a sample.
        if shape[3] % 2 or (not folded and shape[0] % 2):
            raise BakeError(where, "'table.shape' has an odd azimuth", "bake it again")
    _check_size(bundle, name, AtlasLayout.of(grid).size)
    return grid


def _normal_grid(
    table: dict[str, Any], shape: tuple[int, int, int, int], folded: bool, where: Path
) -> AnisotropicNormalGrid:
    """Bundles of before version 2 do not name their parameterisation: it is Bezier."""
    kind = "bezier"
    if "parameterization" in table:
        kind = require(table, "parameterization", str, where, choices=NORMAL_KINDS)
    if kind == "fitted":
        near, far = warps_of(table, 2, where)
        return AnisotropicNormalGrid(shape, folded=folded, parameterization=kind, warps=(near, far))
    if kind != "bezier":
        return AnisotropicNormalGrid(shape, folded=folded, parameterization=kind)
    theta, phi = (float(require(table, f"alpha_{g}", float, where, minimum=0, maximum=1)) for g in ("theta", "phi"))
    return AnisotropicNormalGrid(shape, theta, phi, folded)


def filter_of(bundle: Bundle) -> Filter:
    """What the table was baked for."""
    where = bundle.path / "material.json"
    table = require(bundle.material, "table", dict, where)
    return cast(Filter, require(table, "filter", str, where, choices=FILTERS))


def table_of(bundle: Bundle, name: str = "table") -> Table:
    """The stored values of "table" or "residual", unscaled."""
    grid = grid_of(bundle, name)
    values = decoded(bundle, name, unpack(grid, bundle.load(name)))
    return Table(grid, values, log_of(bundle, name), filter_of(bundle))


def sampler_layout_of(bundle: Bundle, name: str = "sampler") -> SlopeLayout:
    """The sizes of "sampler" or "residual_sampler". Raises BakeError."""
    where = bundle.path / "material.json"
    facts = require(bundle.material, "sampler", dict, where)
    values: dict[str, Any] = {
        key: require(facts, key, int, where, minimum=1, maximum=1024) for key in ("n_theta", "n_phi", "n_x", "n_y")
    }
    for key in ("width_x", "width_y"):
        values[key] = float(require(facts, key, float, where, minimum=1e-4, maximum=1e3))
    values["folded"] = require(facts, "folded", bool, where)
    layout = SlopeLayout(**values)
    _check_size(bundle, name, (layout.cells, layout.bins))
    return layout


def sampler_of(bundle: Bundle, name: str = "sampler") -> SlopeSampler:
    """The stored alias tables. Raises BakeError where a number would lead out of them."""
    layout, texels = sampler_layout_of(bundle, name), bundle.load(name)
    if texels.shape[2] != 4 or (texels < 0).any() or (texels[..., 1] >= layout.cells).any():
        raise BakeError(bundle.image_path(name), "is no alias table", "bake it again")
    return SlopeSampler(layout, texels)


def closures_of(bundle: Bundle, name: str = "envelope") -> AnisotropicFit:
    """The stored "envelope", or the closures of mode Preview, "preview_weights". Raises BakeError."""
    where = bundle.path / "material.json"
    key = "envelope" if name == "envelope" else "preview"
    return fit_from_image(require(bundle.material, key, dict, where), bundle.load(name), where)


def _check_size(bundle: Bundle, name: str, size: tuple[int, int]) -> None:
    where = bundle.path / "material.json"
    entry = require(require(bundle.material, "images", dict, where), name, dict, where)
    found = (entry.get("width"), entry.get("height"))
    if found != size:
        raise BakeError(where, f"{name} is {found[0]} x {found[1]} texels, not {size[0]} x {size[1]}", "bake it again")
