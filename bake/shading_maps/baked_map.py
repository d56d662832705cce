"""Photographs to the stored maps of a bundle and what is told of them: along one arc, or lit from every side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bundle.bundle import StoredImage
from ..errors import BakeError
from ..images.storage import Storage
from ..photographs.stack import PhotoStack
from ..source import Facts, Json
from ..tiling.tileable import TileSettings, check_tileable, make_tileable
from .azimuth.azimuth_basis import MAX_RANK, MIN_RANK, AzimuthBasis, levels_of, mean_over_azimuth
from .azimuth.azimuth_fit import LEVELS, Prepared, fit_azimuth
from .azimuth.light_stack import LightStack
from .azimuth.light_weights import spacing
from .shading_map import (
    ANGLE_KNOTS,
    MAX_SLICES,
    Linearised,
    ShadingMap,
    averages_of,
    check_values,
    held_out_errors,
    level_by_cosine,
    linearise,
)
from .slice_atlas import GUTTER, MAX_EXTENT, SliceLayout
from .store import Compression, Stored, store_azimuth, store_map

Say = Callable[[str, float], None]
Array = NDArray[np.float64]
MAX_MAP_BYTES = 4 << 30
# Lights farther apart than this (rad) leave gaps that a shadow does not cross in one piece.
_SPARSE = np.radians(32)
# Cosines of lights that are spread evenly over the hemisphere.
_LIGHTS = (np.arange(256) + 0.5) / 256


@dataclass(frozen=True, eq=False)
class BakedMap:
    """A map to write.

    Attributes
    ----------
    told : "map", "averages" and "errors" of a bundle
    images : of the bundle
    stored : the map as it comes back from them, of one over azimuth its mean
    averages : of the photographs as given
    a_max : radiance of level 1 in the unit of the photographs
    warnings : one line each, of the map alone
    """

    told: dict[str, Json]
    images: dict[str, StoredImage]
    stored: ShadingMap
    averages: Any
    a_max: float
    warnings: list[str]


@dataclass(frozen=True)
class Storing:
    """How maps along an arc are kept, as in `bake.ArcSettings`."""

    slices: int
    compression: Compression
    storage: Storage
    rank: int


@dataclass(frozen=True, eq=False)
class _Swatch:
    """A map and its level 1 in the unit of the photographs."""

    map: ShadingMap
    a_max: float


def check_arc_size(stack: PhotoStack, storing: Storing, maps: int) -> None:
    """Raise BakeError, before memory is taken, where no image or no memory would hold the maps of an arc."""
    height, width = stack.images.shape[1:3]
    if storing.compression == "none":
        SliceLayout(storing.slices - 1, height, width)
    _check_bytes(maps * storing.slices, height, width, "slices", "choose a smaller --size or fewer --slices")


def check_size_around(count: int, height: int, width: int, rank: int | None, tiled: bool) -> None:
    """The same of a map over azimuth of `count` photographs.

    Parameters
    ----------
    tiled : whether they are made to tile
    """
    try:
        SliceLayout(rank or MIN_RANK, height, width)
    except BakeError as error:
        remedy = "choose a smaller --size, a lower --azimuth-rank, or --azimuths arc"
        raise BakeError(error.file, error.cause, remedy) from None
    if tiled:
        check_tileable(count, height, width)
    _check_bytes(LEVELS, height, width, "levels", "choose a smaller --size, or --azimuths arc")


def _check_bytes(count: int, height: int, width: int, word: str, remedy: str) -> None:
    if count * height * width * 12 > MAX_MAP_BYTES:
        cause = f"would take more than {MAX_MAP_BYTES >> 30} GiB as {count} {word} of {width} x {height}"
        raise BakeError("shading map", cause, remedy)


def prepare(stack: PhotoStack, name: str) -> Prepared:
    """Photographs of known lights for `over_azimuth`. Raises BakeError where they are black, negative or not finite."""
    assert stack.directions is not None
    check_values(stack.images, averages_of(stack.images), name)
    return Prepared.of(LightStack.of(stack.images, stack.directions))


def along_arc(
    stacks: Sequence[PhotoStack], storing: Storing, tile: TileSettings | None, name: str, say: Say
) -> tuple[list[BakedMap], dict[str, Any] | None]:
    """Maps of photographs sorted by brightness (Kautz et al. 2004), tiled by one set of seams, and the account of that.

    Raises BakeError.
    """
    say("averages and slices", 0.0)
    made = [linearise(one.images, storing.slices, name) for one in stacks]
    say("predicting photographs", 0.0)
    held_out = [held_out_errors(one.images, storing.slices) for one in stacks]
    swatches, tiling = [_Swatch(one.map, one.a_max) for one in made], None
    if tile is not None:
        swatches, tiling = _tiled(swatches, tile, name, lambda share: say("making it tile", share))
    say("compressing", 0.0)
    kept = [store_map(one.map, storing.compression, storing.storage, storing.rank) for one in swatches]
    say("measuring", 0.0)
    found = [_baked(*one) for one in zip(stacks, made, swatches, held_out, kept, strict=True)]
    return found, tiling


def _tiled(
    swatches: list[_Swatch], settings: TileSettings, name: str, say: Callable[[float], None]
) -> tuple[list[_Swatch], dict[str, Any]]:
    """The same made to tile, by one set of seams for the slices of all, and the account of it."""
    slices = np.concatenate([swatches[0].map.slices, *(one.map.slices[1:] for one in swatches[1:])])
    tiled = make_tileable(slices, settings, lambda _, share: say(share))
    parts, found = np.split(tiled.slices[1:], len(swatches)), []
    for one, part in zip(swatches, parts, strict=True):
        # The tile shows a choice of the swatch's texels, whose averages are no longer even.
        again = linearise(part, len(part) + 1, name)
        found.append(_Swatch(again.map, one.a_max * again.a_max))
    return found, tiled.facts


def _baked(
    stack: PhotoStack, made: Linearised, swatch: _Swatch, held_out: list[dict[str, float]], kept: Stored
) -> BakedMap:
    images, facts, stored = kept
    seen = level_by_cosine(stack.directions, made.averages / made.a_max)
    levels = np.interp(_LIGHTS, np.linspace(0, 1, ANGLE_KNOTS), seen)
    squares = [_squares(values) for values in (stored.slices - swatch.map.slices, swatch.map.slices)]
    storage, signal = (seen_rms(each, swatch.map.levels, levels) for each in squares)
    told: dict[str, Json] = {
        "map": {
            **facts,
            **_size_facts(swatch.map, images),
            "a_max": swatch.a_max if stack.calibrated else None,
            "level_by_cosine": seen,
        },
        # For the plot of the linearisation (Kautz et al. 2004).
        "averages": {
            **stack.in_order(made.averages, made.order),
            "after": averages_of(swatch.map.slices).tolist(),
        },
        "errors": _error_facts(storage, signal, held_out),
    }
    return BakedMap(told, images, stored, made.averages, swatch.a_max, _slice_warnings(made))


def over_azimuth(
    stack: PhotoStack, storage: Storage, rank: int | None, tile: TileSettings | None, say: Say, prepared: Prepared
) -> tuple[BakedMap, dict[str, Any] | None]:
    """The map over azimuth of photographs lit from many sides, and the account of its tiling.

    Photographs are tiled before anything is averaged, so that all of them have the same seams. Raises BakeError.

    Parameters
    ----------
    prepared : the photographs, as `prepare` gives them
    """
    directions, tiling = stack.directions, None
    assert directions is not None
    if tile is not None:
        tiled = make_tileable(stack.images, tile, lambda _, share: say("making it tile", share))
        stack, tiling = replace(stack, images=tiled.slices), tiled.facts
    say("averages and slices", 0.0)
    if tile is not None:
        prepared = prepare(stack, "swatch")
    products = prepared.products
    say("predicting photographs", 0.0)
    most = min(MAX_RANK, MAX_EXTENT // SliceLayout(1, *stack.images.shape[1:3]).pitch)
    fit = fit_azimuth(stack.images, directions, rank, prepared=prepared, most=most)
    say("compressing", 0.0)
    images, facts, stored = store_azimuth(fit.basis, storage)
    say("measuring", 0.0)
    mean = ShadingMap(mean_over_azimuth(stored))
    lost, whole = fit.lost
    x, seen = levels_of(len(whole) + 1), fit.curve.level(_LIGHTS)
    loss, signal = (seen_rms(np.insert(each, 0, 0.0), x, seen) for each in (lost + _rounding(fit.basis, stored), whole))
    order = np.argsort(products.averages, kind="stable")
    azimuths = np.degrees(np.arctan2(directions[order, 1], directions[order, 0])) % 360
    told: dict[str, Json] = {
        "map": {
            **facts,
            **_size_facts(mean, images),
            "a_max": fit.curve.a_max if stack.calibrated else None,
            "level_by_cosine": fit.curve.level(np.linspace(0, 1, ANGLE_KNOTS)).tolist(),
            # Which level a light of which angle to the normal stands for, in full.
            "level_curve": {
                "cosines": fit.curve.cosines.tolist(),
                "levels": fit.curve.levels.tolist(),
                "a_max": fit.curve.a_max,
            },
            "interpolation": asdict(fit.choice),
        },
        "averages": {
            **stack.in_order(products.averages, order),
            "azimuths_deg": [round(float(azimuth), 3) for azimuth in azimuths],
            "after": averages_of(mean.slices).tolist(),
        },
        "errors": _error_facts(loss, signal, fit.held_out),
    }
    warnings = _sparse(directions)
    if rank is not None and fit.basis.rank < rank:
        warnings.append(f"{len(directions)} photographs allow an azimuth rank of {fit.basis.rank}, not of {rank}")
    return BakedMap(told, images, mean, products.averages, fit.curve.a_max, warnings), tiling


def _rounding(basis: AzimuthBasis, stored: AzimuthBasis) -> Array:
    """Mean squares (N - 1,) at each level but 0 of what the storage of coefficients and curves loses."""
    # c' B' - c B = c' (B' - B) + (c' - c) B: small numbers, whose squares rounding does not drown.
    off = np.concatenate([stored.coefficients, stored.coefficients - basis.coefficients], -1).reshape(
        -1, 2 * basis.rank
    )
    kept, before = stored.lit_nodes().astype(np.float64), basis.lit_nodes().astype(np.float64)
    nodes = np.concatenate([kept - before, before])
    products = (off.T @ off).astype(np.float64) / len(off)
    squares = np.maximum(np.einsum("ij,ij->j", products @ nodes, nodes), 0)
    means: Array = squares.reshape(basis.curves.shape[1], -1).mean(0)
    return means


def seen_rms(squares: Array, levels: Array, seen: Array) -> float:
    """RMS over lights of all directions, as many at every cosine to the normal, of an error at levels of a map.

    Where a highlight is, most of the levels are those of a few lights near the zenith, and others' fall between two of
    them. Between levels a map is linear, where its squared error is at most what is interpolated here.

    Parameters
    ----------
    squares, levels : (N,) mean squared error at rising levels x
    seen : (k,) levels at even cosines
    """
    return float(np.sqrt(np.interp(seen, levels, squares).mean()))


def _sparse(directions: Any) -> list[str]:
    """A warning where lights stand so far apart that shadows between them are those of both, each half as deep."""
    apart = spacing(directions)
    if apart <= _SPARSE:
        return []
    return [
        f"lights stand {np.degrees(apart):.0f} degrees apart: between two of them both their shadows are seen, each "
        "fainter, rather than one that moves; photograph more azimuths or elevations"
    ]


def _size_facts(shading_map: ShadingMap, images: dict[str, StoredImage]) -> dict[str, Json]:
    count, height, width, _ = shading_map.slices.shape
    return {
        "slices": count,
        "height": int(height),
        "width": int(width),
        "gutter": GUTTER,
        "storage": str(next(iter(images.values())).storage),
    }


def _slice_warnings(made: Linearised) -> list[str]:
    """Warnings where a highlight takes up the slices: most photographs then lie below the first of them."""
    slices = len(made.map.slices)
    below = int((made.averages < made.a_max / (slices - 1)).sum())
    if 2 * below <= len(made.averages):
        return []
    wanted = int(min(np.ceil(made.a_max / max(float(np.median(made.averages)), 1e-30)) * 4, MAX_SLICES))
    return [f"{below} of {len(made.averages)} photographs are darker than the first of {slices} slices; try {wanted}"]


def _squares(values: Any) -> Array:
    """Mean squares (N,) of slices."""
    means: Array = np.array([np.square(one).mean(dtype=np.float64) for one in values])
    return means


def _error_facts(storage: float, signal: float, held_out: list[dict[str, float]]) -> Facts:
    return {
        "storage_rms": storage,
        "signal_rms": signal,
        "held_out": held_out,
        "held_out_rms": float(np.sqrt(np.mean([row["rms"] ** 2 for row in held_out]))) if held_out else None,
        "held_out_relative": float(np.median([row["relative"] for row in held_out])) if held_out else None,
    }
