"""The "table" and "sampler" parts of a bundle's material.json: read back with every number checked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from . import xp_numpy
from .alias_sampler import AliasSampler, SamplerLayout
from .bundle import Bundle, require
from .envelope import EnvelopeFit, PreviewFit, checked_shares, fit_from_image, preview_from_image
from .errors import BakeError
from .parameterization import NARROWEST_END, PARAMETERIZATIONS, WIDEST_END, LogWarp
from .source import Array
from .storage import TABLE_STORAGES, Storage
from .tables.atlas import AtlasLayout, unpack
from .tables.grid import Grid
from .tables.half_vector_grid import HalfVectorGrid
from .tables.log_codes import LEAST_RANGE, MOST_PEAK, MOST_RANGE, LogCodes
from .tables.normal_grid import MAX_RESOLUTION, NormalVectorGrid
from .tables.table import Table

# Along one axis of a table in the half-vector basis, which has four times as many elevations of h.
_MAX_SAMPLES = 4 * MAX_RESOLUTION


def grid_of(bundle: Bundle) -> Grid:
    """The table's grid. Raises BakeError where it is not described, or the image has another size."""
    where = bundle.path / "material.json"
    grid = _grid(require(bundle.material, "table", dict, where), where)
    _check_size(bundle, "table", AtlasLayout(grid.shape).size)
    return grid


def residual_grid_of(bundle: Bundle) -> Grid:
    """The grid of the residual's table. Raises BakeError where it is not described, or the image has another size."""
    where = bundle.path / "material.json"
    residual = require(bundle.material, "residual", dict, where)
    # Older bundles have the table's.
    grid = _grid(require(residual, "grid", dict, where), where) if "grid" in residual else grid_of(bundle)
    _check_size(bundle, "residual", AtlasLayout(grid.shape).size)
    return grid


def _grid(facts: dict[str, Any], where: Path) -> Grid:
    basis = require(facts, "basis", str, where, choices=("normal", "half"))
    kind: Any = require(facts, "parameterization", str, where, choices=PARAMETERIZATIONS)
    horizon = float(require(facts, "horizon_share", float, where, minimum=0, maximum=1))
    warps: Any = warps_of(facts, 2 if basis == "normal" else 3, where) if kind == "fitted" else None
    if basis == "normal":
        n = require(facts, "n", int, where, minimum=4, maximum=MAX_RESOLUTION)
        theta, phi = (float(require(facts, f"alpha_{g}", float, where, minimum=0, maximum=1)) for g in ("theta", "phi"))
        grid = NormalVectorGrid(n, kind, theta, phi, horizon)
        return replace(grid, warps=warps) if warps else grid
    sizes: Any = tuple(_numbers(facts, "sizes", 3, int, 4, _MAX_SAMPLES, where))
    half = HalfVectorGrid(sizes, kind, reciprocal=require(facts, "reciprocal", bool, where), horizon_share=horizon)
    if kind == "bezier":
        alphas: Any = tuple(_numbers(facts, "alphas", 3, float, 0, 1, where))
        half = replace(half, alphas=alphas)
    return replace(half, warps=warps) if warps else half


def warps_of(facts: dict[str, Any], count: int, where: Path) -> tuple[LogWarp, ...]:
    """The fitted warps of a table's axes. Raises BakeError."""
    rows = require(facts, "warps", list, where, minimum=count, maximum=count)
    ends = [_numbers({"warps": row}, "warps", 2, float, NARROWEST_END, WIDEST_END, where) for row in rows]
    return tuple(LogWarp(near, far) for near, far in ends)


def _numbers(facts: dict[str, Any], key: str, count: int, kind: Any, low: float, high: float, where: Path) -> list[Any]:
    values = require(facts, key, list, where, minimum=count, maximum=count)
    return [kind(require({key: value}, key, kind, where, minimum=low, maximum=high)) for value in values]


def scale_of(bundle: Bundle, part: str = "table") -> float:
    """What values of the table or the "residual" were multiplied by before they were stored."""
    where = bundle.path / "material.json"
    facts = require(bundle.material, part, dict, where)
    return float(require(facts, "scale", float, where, minimum=2.0**-126, maximum=2.0**126))


def offset_of(bundle: Bundle, part: str = "table") -> float:
    """What scaled values of the table or the "residual" were raised by; nothing in older bundles."""
    where = bundle.path / "material.json"
    facts = require(bundle.material, part, dict, where)
    return float(require(facts, "offset", float, where, minimum=0, maximum=1)) if "offset" in facts else 0.0


def log_of(bundle: Bundle, part: str = "table") -> LogCodes | None:
    """What codes of the table or the "residual" stand for; None where they are values. Raises BakeError."""
    where = bundle.path / "material.json"
    images, table = (require(bundle.material, key, dict, where) for key in ("images", "table"))
    stored = require(require(images, part, dict, where), "storage", str, where)
    named = require(table, "storage", str, where, choices=TABLE_STORAGES)
    if stored != Storage(named).image:
        raise BakeError(where, f"'{part}' is stored as {stored}, and the table as {named}", "bake it again")
    if named != Storage.LOG:
        return None
    facts = require(require(bundle.material, part, dict, where), "log", dict, where)
    ranges: Any = tuple(_numbers(facts, "range", 3, float, LEAST_RANGE, MOST_RANGE, where))
    gains: Any = tuple(_numbers(facts, "gain", 3, float, 0, MOST_PEAK, where))
    codes = LogCodes(ranges, gains)
    if max(codes.peaks) > 1.01 * MOST_PEAK:
        raise BakeError(where, f"'{part}.log' stands for values above {MOST_PEAK:g}", "bake it again")
    return codes


def decoded(bundle: Bundle, part: str, texels: Array) -> Array:
    """Values of the table or the "residual", from what its file holds."""
    codes = log_of(bundle, part)
    if codes is not None:
        return np.asarray(codes.decode(xp_numpy, texels.astype(np.float64)), np.float32)
    values: Array = (texels - offset_of(bundle, part)) / scale_of(bundle, part)
    return values


def table_of(bundle: Bundle) -> Table:
    """The stored values, unscaled."""
    grid = grid_of(bundle)
    return Table(grid, decoded(bundle, "table", unpack(grid, bundle.load("table"))), log_of(bundle))


def residual_table_of(bundle: Bundle) -> Table:
    """The stored values of the residual, unscaled."""
    grid = residual_grid_of(bundle)
    values = decoded(bundle, "residual", unpack(grid, bundle.load("residual")))
    return Table(grid, values, log_of(bundle, "residual"))


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
