"""The parts of an anisotropic bundle's material.json: read back with every number checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from ..bundle import Bundle, require
from ..envelope import EnvelopeFit, ViewerGrid, fit_from_image
from ..envelope.anisotropic_lobes import AnisotropicLobe
from ..envelope.viewers import MOST_EACH_WAY
from ..errors import BakeError
from ..sampling.cell_sampler import CellSampler
from ..sampling.slope_cells import SlopeLayout
from ..table import FILTERS, Filter
from ..table_facts import decoded, log_of, warps_of
from .atlas import SliceLayout, unpack
from .grid import NORMAL_KINDS, Grid, HalfGrid, NormalGrid
from .table import AnisotropicTable


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
    if basis == "half":
        x, y = (float(require(table, f"width_{k}", float, where, minimum=1e-4, maximum=1e3)) for k in "xy")
        grid = HalfGrid(shape, x, y, folded)
    else:
        grid = _normal_grid(table, shape, folded, where)
        # Beyond the pole azimuths go on half a turn further, which has to be a sample.
        if shape[3] % 2 or (not folded and shape[0] % 2):
            raise BakeError(where, "'table.shape' has an odd azimuth", "bake it again")
    _check_size(bundle, name, SliceLayout.of(grid).size)
    return grid


def _normal_grid(table: dict[str, Any], shape: tuple[int, int, int, int], folded: bool, where: Path) -> NormalGrid:
    """Bundles of before version 2 do not name their parameterisation: it is Bezier."""
    kind = "bezier"
    if "parameterization" in table:
        kind = require(table, "parameterization", str, where, choices=NORMAL_KINDS)
    if kind == "fitted":
        near, far = warps_of(table, 2, where)
        return NormalGrid(shape, folded=folded, parameterization=kind, warps=(near, far))
    if kind != "bezier":
        return NormalGrid(shape, folded=folded, parameterization=kind)
    theta, phi = (float(require(table, f"alpha_{g}", float, where, minimum=0, maximum=1)) for g in ("theta", "phi"))
    return NormalGrid(shape, theta, phi, folded)


def filter_of(bundle: Bundle) -> Filter:
    """What the table was baked for."""
    where = bundle.path / "material.json"
    table = require(bundle.material, "table", dict, where)
    return cast(Filter, require(table, "filter", str, where, choices=FILTERS))


def table_of(bundle: Bundle, name: str = "table") -> AnisotropicTable:
    """The stored values of "table" or "residual", unscaled."""
    grid = grid_of(bundle, name)
    values = decoded(bundle, name, unpack(grid, bundle.load(name)))
    return AnisotropicTable(grid, values, filter_of(bundle), log_of(bundle, name))


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


def sampler_of(bundle: Bundle, name: str = "sampler") -> CellSampler:
    """The stored alias tables. Raises BakeError where a number would lead out of them."""
    layout, texels = sampler_layout_of(bundle, name), bundle.load(name)
    if texels.shape[2] != 4 or (texels < 0).any() or (texels[..., 1] >= layout.cells).any():
        raise BakeError(bundle.image_path(name), "is no alias table", "bake it again")
    return CellSampler(layout, texels)


def closures_of(bundle: Bundle, name: str = "envelope") -> EnvelopeFit:
    """The stored "envelope", or the closures of mode Preview, "preview_weights". Raises BakeError."""
    where = bundle.path / "material.json"
    key = "envelope" if name == "envelope" else "preview"
    facts = require(bundle.material, key, dict, where)
    n_theta, n_phi = (require(facts, axis, int, where, 2, MOST_EACH_WAY) for axis in ("n_theta", "n_phi"))
    viewers = ViewerGrid(n_theta, n_phi, require(facts, "folded", bool, where))
    closures = tuple(
        AnisotropicLobe.from_facts(entry, where) for entry in require(facts, "closures", list, where, 1, 12)
    )
    measured = {key: value for key, value in facts.items() if key not in {"closures", *viewers.facts()}}
    return fit_from_image(closures, viewers, bundle.load(name), measured, where)


def _check_size(bundle: Bundle, name: str, size: tuple[int, int]) -> None:
    where = bundle.path / "material.json"
    entry = require(require(bundle.material, "images", dict, where), name, dict, where)
    found = (entry.get("width"), entry.get("height"))
    if found != size:
        raise BakeError(where, f"{name} is {found[0]} x {found[1]} texels, not {size[0]} x {size[1]}", "bake it again")
