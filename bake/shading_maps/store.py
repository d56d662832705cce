"""A shading map as the images of a bundle: slices, or the power law of Kautz et al. 2004, or a few fitted curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np

from ..bundle.bundle import StoredImage
from ..errors import BakeError
from ..images.storage import HALF_LARGEST, Storage, quantize, scale_for
from ..source import Facts, Json
from . import power_law, slice_basis
from .azimuth.azimuth_basis import CROWDING, AzimuthBasis, mean_curves
from .azimuth.azimuth_envelope import azimuth_envelope
from .azimuth.curve_layout import pack_curves
from .envelope_split import EnvelopeSplit, split
from .shading_map import ShadingMap
from .slice_atlas import pack_slices

Compression = Literal["none", "power", "basis"]
COMPRESSIONS: tuple[str, ...] = get_args(Compression)
Stored = tuple[dict[str, StoredImage], Mapping[str, Any], ShadingMap]


def store_map(shading_map: ShadingMap, compression: Compression, storage: Storage, rank: int = 2) -> Stored:
    """Images to write, what a bundle has to say of them, and the map as it will come back from them.

    Parameters
    ----------
    compression : "none" keeps the slices; "power" two numbers per texel and channel; "basis" `rank` of them
    """
    check_storage(compression, storage)
    if compression == "power":
        return _store_power(shading_map, storage)
    if compression == "basis":
        return _store_basis(shading_map, storage, rank)
    return _store_slices(shading_map, storage)


def check_storage(compression: str, storage: Storage) -> None:
    """Raise BakeError where the storage cannot hold what the compression makes."""
    if compression != "none" and str(storage) in ("rgbe", "byte"):
        cause = f"is too coarse for the exponents or coefficients of compression {compression}"
        raise BakeError(f"storage {storage}", cause, "choose half or float32")


def check_azimuth_storage(storage: Storage) -> None:
    """Raise BakeError where the storage cannot hold coefficients of either sign."""
    if storage not in (Storage.HALF, Storage.FLOAT32):
        cause = "cannot hold the coefficients of a map over azimuth, which are of either sign"
        raise BakeError(f"storage {storage}", cause, "choose half or float32")


def store_azimuth(basis: AzimuthBasis, storage: Storage) -> tuple[dict[str, StoredImage], Facts, AzimuthBasis]:
    """Images to write, what a bundle has to say of them, and the map as it will come back from them."""
    check_azimuth_storage(storage)
    scale = scale_for(basis.coefficients, storage)
    texels = np.ascontiguousarray(np.moveaxis(basis.coefficients, -1, 0)) * np.float32(scale)
    kept = quantize(texels, storage) * np.float32(1 / scale)
    curves = quantize(basis.curves, storage)
    again = AzimuthBasis(np.ascontiguousarray(np.moveaxis(kept, 0, -1)), curves)
    split = azimuth_envelope(again, storage)
    m = split.envelope * np.float32(split.scale)
    images = {
        "coefficients": StoredImage(pack_slices(texels), storage),
        "curves": StoredImage(pack_curves(curves), storage),
        "envelope": StoredImage(np.concatenate([m, split.share[..., None]], -1), storage),
    }
    facts: dict[str, Json] = {
        "model": "azimuth",
        "rank": basis.rank,
        "azimuths": basis.curves.shape[1],
        "crowding": CROWDING,
        # For what knows no azimuth.
        "mean_curves": mean_curves(curves).tolist(),
        "scale": scale,
        "envelope_scale": split.scale,
        "envelope_energy": split.energy,
        "residual_energy": 1 - split.energy,
    }
    return images, facts, again


def _store_slices(shading_map: ShadingMap, storage: Storage) -> Stored:
    kept = _envelope_storage(storage)
    envelope_scale = scale_for(split(shading_map).envelope, kept)
    parts = split(shading_map, kept, envelope_scale)
    residual_scale = scale_for(parts.residual[1:], storage)
    residual = quantize(parts.residual * np.float32(residual_scale), storage) * np.float32(1 / residual_scale)
    stored = EnvelopeSplit(parts.envelope, residual)
    images = {
        "slices": StoredImage(pack_slices(parts.residual[1:] * np.float32(residual_scale)), storage),
        "envelope": _envelope_image(stored, envelope_scale, storage),
    }
    return images, _split_facts("slices", stored, residual_scale, envelope_scale), stored.map()


def _split_facts(model: str, parts: EnvelopeSplit, scale: float, envelope_scale: float) -> Facts:
    return {
        "model": model,
        "scale": scale,
        "envelope_scale": envelope_scale,
        "envelope_energy": parts.envelope_energy,
        "residual_energy": 1 - parts.envelope_energy,
    }


def _envelope_image(parts: EnvelopeSplit, scale: float, storage: Storage) -> StoredImage:
    """m and, in alpha, the residual's share."""
    m = parts.envelope * np.float32(scale)
    return StoredImage(np.concatenate([m, parts.share[..., None]], -1), _envelope_storage(storage))


def _envelope_storage(storage: Storage) -> Storage:
    """RGBE has no alpha, and would quantise m by its brightest channel."""
    return Storage.HALF if storage is Storage.RGBE else storage


def _store_power(shading_map: ShadingMap, storage: Storage) -> Stored:
    law = power_law.fit(shading_map.slices)
    if storage is Storage.HALF and law.k.max() > HALF_LARGEST:
        cause = f"is {law.k.max():.3g} times as bright as the swatch in one texel, more than half floats hold"
        raise BakeError("shading map", cause, "retouch the hot pixel, crop it away, or choose --storage float32")
    k, exponent = (quantize(part, storage) for part in (law.k, law.exponent))
    stored = power_law.PowerLaw(k, exponent)
    again = _tabulated(stored, len(shading_map.slices))
    images = {"power": StoredImage(pack_slices(np.stack([k, exponent])), storage)}
    parts = EnvelopeSplit(np.where(exponent <= 1, k, 0), again.slices)
    carried = float(parts.envelope.mean(dtype=np.float64)) / 2
    reflected = float((k / (exponent + 1)).mean(dtype=np.float64))
    facts = {"model": "power", "scale": 1.0, "envelope_energy": carried / reflected}
    return images, {**facts, "residual_energy": 1 - carried / reflected}, again


def _store_basis(shading_map: ShadingMap, storage: Storage, rank: int) -> Stored:
    # With nothing negative in it the fit needs no clamping, which the shader's single random tap would not survive.
    basis = slice_basis.fit_basis(shading_map.slices, rank, nonnegative=True)
    scale = scale_for(basis.coefficients, storage)
    texels = np.moveaxis(basis.coefficients, -1, 0) * np.float32(scale)
    kept = np.moveaxis(quantize(texels, storage), 0, -1) * np.float32(1 / scale)
    again = _tabulated(slice_basis.SliceBasis(kept, basis.curves), len(shading_map.slices))
    envelope_scale = scale_for(split(again).envelope, storage)
    parts = split(again, storage, envelope_scale)
    images = {
        "coefficients": StoredImage(pack_slices(np.ascontiguousarray(texels)), storage),
        "envelope": _envelope_image(parts, envelope_scale, storage),
    }
    facts = _split_facts("basis", parts, scale, envelope_scale)
    return images, {**facts, "curves": basis.curves.tolist()}, again


def _tabulated(model: Any, slices: int) -> ShadingMap:
    return ShadingMap(np.stack([np.asarray(model.evaluate(x), np.float32) for x in np.linspace(0, 1, slices)]))
