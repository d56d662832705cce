"""The "table" and "sampler" parts of a bundle's material.json: read back with every number checked."""

from __future__ import annotations

from typing import Any

from .alias_sampler import AliasSampler, SamplerLayout
from .atlas import AtlasLayout, unpack
from .bundle import Bundle, require
from .errors import BakeError
from .parameterization import PARAMETERIZATIONS
from .table import BrdfTable, TableGrid

MAX_RESOLUTION = 256


def grid_of(bundle: Bundle) -> TableGrid:
    """The table's grid. Raises BakeError where it is not described, or the image has another size."""
    where = bundle.path / "material.json"
    table = require(bundle.material, "table", dict, where)
    require(table, "basis", str, where, choices=("normal",))
    n = require(table, "n", int, where, minimum=4, maximum=MAX_RESOLUTION)
    kind: Any = require(table, "parameterization", str, where, choices=PARAMETERIZATIONS)
    shape = [float(require(table, f"alpha_{g}", float, where, minimum=0, maximum=1)) for g in ("theta", "phi")]
    shape.append(float(require(table, "horizon_share", float, where, minimum=0, maximum=1)))
    _check_size(bundle, "table", AtlasLayout(n).size)
    return TableGrid(n, kind, *shape)


def scale_of(bundle: Bundle) -> float:
    """What stored table values were multiplied by."""
    where = bundle.path / "material.json"
    table = require(bundle.material, "table", dict, where)
    return float(require(table, "scale", float, where, minimum=2.0**-126, maximum=2.0**126))


def table_of(bundle: Bundle) -> BrdfTable:
    """The stored values, unscaled."""
    grid = grid_of(bundle)
    return BrdfTable(grid, unpack(bundle.load("table"), grid.n) / scale_of(bundle))


def sampler_layout_of(bundle: Bundle) -> SamplerLayout:
    """The sampler's sizes. Raises BakeError where they are not described, or the image has another size."""
    where = bundle.path / "material.json"
    facts = require(bundle.material, "sampler", dict, where)
    sizes = {
        key: require(facts, key, int, where, minimum=1, maximum=most)
        for key, most in (("n_o", 1024), ("n_h", 1024), ("n_phi", 1024), ("warp_power", 4))
    }
    layout = SamplerLayout(**sizes)
    _check_size(bundle, "sampler", (layout.cells, layout.n_o))
    return layout


def sampler_of(bundle: Bundle) -> AliasSampler:
    """The stored alias tables. Raises BakeError where a number would lead out of them."""
    layout, texels = sampler_layout_of(bundle), bundle.load("sampler")
    if texels.shape[2] != 4 or (texels < 0).any() or (texels[..., 1] >= layout.cells).any():
        raise BakeError(bundle.image_path("sampler"), "is no alias table", "bake it again")
    return AliasSampler(layout, texels)


def _check_size(bundle: Bundle, name: str, size: tuple[int, int]) -> None:
    where = bundle.path / "material.json"
    images = require(bundle.material, "images", dict, where)
    entry = require(images, name, dict, where)
    found = (entry.get("width"), entry.get("height"))
    if found != size:
        raise BakeError(where, f"{name} is {found[0]} x {found[1]} texels, not {size[0]} x {size[1]}", "bake it again")
