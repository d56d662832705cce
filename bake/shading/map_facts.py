"""The "map" and "render" parts of a shading map's material.json: read back with every number checked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..bundle import MATERIAL, Bundle, require
from ..errors import BakeError
from ..material_json import Fields
from . import power_law, slice_basis
from .light_angle import ANGLE_KNOTS
from .record_parts import render_settings_of
from .render_settings import RenderSettings
from .shading_map import MAX_SLICES, ShadingMap
from .slice_atlas import GUTTER, SliceLayout, unpack_slices

MODELS = ("slices", "power", "basis")
_IMAGE = {"slices": "slices", "power": "power", "basis": "coefficients"}


@dataclass(frozen=True)
class MapFacts:
    """What a bundle says of its shading map.

    Parameters
    ----------
    model : "slices", "power" or "basis"
    slices : N, the black one included
    layout : of the image named `image`
    scale, envelope_scale : what stored values were multiplied by
    a_max : in 1/sr; None where the photographs are not calibrated
    level_by_cosine : x of the photograph at cosines of the light's angle from 0 to 1
    curves : (rank, N) of model "basis"
    """

    model: str
    slices: int
    layout: SliceLayout
    scale: float
    envelope_scale: float
    a_max: float | None
    level_by_cosine: tuple[float, ...]
    curves: tuple[tuple[float, ...], ...]

    @property
    def image(self) -> str:
        """Name of the bundle's image that holds the model."""
        return _IMAGE[self.model]


def map_facts_of(bundle: Bundle) -> MapFacts:
    """The checked facts. Raises BakeError where they are not complete or the images have other sizes."""
    where = bundle.path / MATERIAL
    facts = require(bundle.material, "map", dict, where)
    model = require(facts, "model", str, where, choices=MODELS)
    slices = require(facts, "slices", int, where, minimum=2, maximum=MAX_SLICES)
    height, width = (require(facts, key, int, where, minimum=1, maximum=1 << 14) for key in ("height", "width"))
    require(facts, "gutter", int, where, minimum=GUTTER, maximum=GUTTER)
    curves = _curves(facts, slices, where) if model == "basis" else ()
    tiles = {"slices": slices - 1, "power": 2, "basis": len(curves)}[model]
    found = MapFacts(
        model,
        slices,
        SliceLayout(tiles, height, width),
        _positive(facts, "scale", where),
        1.0 if model == "power" else _positive(facts, "envelope_scale", where),
        None if facts.get("a_max") is None else _positive(facts, "a_max", where),
        _numbers(facts, "level_by_cosine", ANGLE_KNOTS, where),
        curves,
    )
    _check_size(bundle, found.image, (found.layout.width, found.layout.rows))
    if model != "power":
        _check_size(bundle, "envelope", (width, height))
    return found


def render_of(bundle: Bundle) -> RenderSettings:
    """How the bundle asks to be lit. Raises BakeError."""
    where = bundle.path / MATERIAL
    return render_settings_of(Fields(bundle.material, where).part("render"))


def shading_map_of(bundle: Bundle) -> ShadingMap:
    """The map as stored, for numpy. Raises BakeError."""
    facts = map_facts_of(bundle)
    tiles = unpack_slices(bundle.load(facts.image), facts.layout)[..., :3] * np.float32(1 / facts.scale)
    levels = np.linspace(0, 1, facts.slices)
    if facts.model == "slices":
        m = bundle.load("envelope")[..., :3] * np.float32(1 / facts.envelope_scale)
        rest = np.concatenate([np.zeros_like(tiles[:1]), tiles])
        return ShadingMap(rest + levels[:, None, None, None].astype(np.float32) * m)
    model: Any
    if facts.model == "power":
        model = power_law.PowerLaw(tiles[0], tiles[1])
    else:
        model = slice_basis.SliceBasis(np.moveaxis(tiles, 0, -1), np.array(facts.curves))
    return ShadingMap(np.stack([np.maximum(model.evaluate(x), 0).astype(np.float32) for x in levels]))


def _curves(facts: dict[str, Any], slices: int, where: Any) -> tuple[tuple[float, ...], ...]:
    rows = require(facts, "curves", list, where, minimum=1, maximum=3)
    return tuple(_numbers({"curves": row}, "curves", slices, where) for row in rows)


def _numbers(facts: dict[str, Any], key: str, count: int, where: Any) -> tuple[float, ...]:
    values = require(facts, key, list, where, minimum=count, maximum=count)
    if not all(isinstance(v, int | float) and math.isfinite(v) and abs(v) < 1e6 for v in values):
        raise BakeError(where, f"{key!r} holds something other than numbers", "bake it again")
    return tuple(float(v) for v in values)


def _positive(facts: dict[str, Any], key: str, where: Any) -> float:
    return float(require(facts, key, float, where, minimum=1e-30, maximum=1e30))


def _check_size(bundle: Bundle, name: str, size: tuple[int, int]) -> None:
    entry = require(bundle.material["images"], name, dict, bundle.path / MATERIAL)
    found = (entry["width"], entry["height"])
    if found != size or entry["channels"] not in (3, 4):
        cause = f"{name} is {found[0]} x {found[1]} texels, not {size[0]} x {size[1]}"
        raise BakeError(bundle.path / MATERIAL, cause, "bake it again")
