"""The "table" and "sampler" parts of a bundle's material.json: read back with every number checked."""

from __future__ import annotations

from typing import Any

from .alias_sampler import AliasSampler, SamplerLayout
from .atlas import AtlasLayout, unpack
from .bundle import Bundle, require
from .envelope import EnvelopeFit, PreviewFit, checked_shares, fit_from_image, preview_from_image
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


def residual_scale_of(bundle: Bundle) -> float:
    """What stored values of the residual were multiplied by. Raises BakeError where its image has another size."""
    where = bundle.path / "material.json"
    _check_size(bundle, "residual", AtlasLayout(grid_of(bundle).n).size)
    residual = require(bundle.material, "residual", dict, where)
    return float(require(residual, "scale", float, where, minimum=2.0**-126, maximum=2.0**126))


def envelope_of(bundle: Bundle) -> EnvelopeFit:
    """The stored envelope. Raises BakeError."""
    where = bundle.path / "material.json"
    return fit_from_image(require(bundle.material, "envelope", dict, where), bundle.load("envelope"), where)


def check_shares(bundle: Bundle) -> None:
    """Raises BakeError where the bundle's "residual_share" is not what `bake.envelope.lamp_shares` gives."""
    checked_shares(bundle.load("residual_share"), bundle.image_path("residual_share"))


def preview_of(bundle: Bundle) -> PreviewFit:
    """The stored closures of mode Preview. Raises BakeError."""
    where = bundle.path / "material.json"
    return preview_from_image(require(bundle.material, "preview", dict, where), bundle.load("preview_weights"), where)


def sampler_layout_of(bundle: Bundle, name: str = "sampler") -> SamplerLayout:
    """The sampler's sizes. Raises BakeError where they are not described, or the image has another size."""
    where = bundle.path / "material.json"
    facts = require(bundle.material, "sampler", dict, where)
    sizes = {
        key: require(facts, key, int, where, minimum=1, maximum=most)
        for key, most in (("n_o", 1024), ("n_h", 1024), ("n_phi", 1024), ("warp_power", 4))
    }
    layout = SamplerLayout(**sizes)
    _check_size(bundle, name, (layout.cells, layout.n_o))
    return layout


def sampler_of(bundle: Bundle, name: str = "sampler") -> AliasSampler:
    """The stored alias tables, of the whole or "residual_sampler". Raises BakeError where a number would lead out."""
    layout, texels = sampler_layout_of(bundle, name), bundle.load(name)
    if texels.shape[2] != 4 or (texels < 0).any() or (texels[..., 1] >= layout.cells).any():
        raise BakeError(bundle.image_path(name), "is no alias table", "bake it again")
    return AliasSampler(layout, texels)


def _check_size(bundle: Bundle, name: str, size: tuple[int, int]) -> None:
    where = bundle.path / "material.json"
    images = require(bundle.material, "images", dict, where)
    entry = require(images, name, dict, where)
    found = (entry.get("width"), entry.get("height"))
    if found != size:
        raise BakeError(where, f"{name} is {found[0]} x {found[1]} texels, not {size[0]} x {size[1]}", "bake it again")
