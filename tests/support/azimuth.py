"""Maps over azimuth of a closed form: Lambertian texels of known normals, and curves that are held at 0 in places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from measured_materials.bake.bundle.bundle import Bundle, read_bundle, write_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.shading_maps.albedo import map_albedo_facts
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis, levels_of, mean_over_azimuth
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.shading_maps.shading_map import ShadingMap, averages_of, level_by_cosine
from measured_materials.bake.shading_maps.slice_atlas import GUTTER
from measured_materials.bake.shading_maps.store import store_azimuth
from measured_materials.bake.shading_maps.swatch_preview import preview_swatch


def lambert_basis(height: int = 4, width: int = 4, azimuths: int = 16, levels: int = 8, seed: int = 0) -> AzimuthBasis:
    """S = x + 0.5 x sqrt(1 - x^2) (a cos phi + b sin phi), exact at nodes above x = 0; a and b sum up to 0.

    Rank 3: x, and its product with the projected direction of the light in both axes. A texel whose a is above its
    level faces the light of phi = 0; all stay above 0. The channels differ.
    """
    rng = np.random.default_rng(seed)
    slope = rng.uniform(-1, 1, (2, height, width, 3))
    slope -= slope.mean((1, 2), keepdims=True)
    slope /= np.abs(slope).max()
    phi, x = 2 * np.pi * np.arange(azimuths) / azimuths, levels_of(levels)
    lean = np.sqrt(1 - x**2)
    curves = np.stack([np.ones((azimuths, levels)), *(f(phi)[:, None] * lean for f in (np.cos, np.sin))])
    curves[:, :, 0] = curves[:, :, 1]
    coefficients = np.stack([np.ones((height, width, 3)), *(0.5 * slope)], -1)
    return AzimuthBasis(coefficients.astype(np.float32), curves.astype(np.float32))


def clamped_basis(height: int = 4, width: int = 4, azimuths: int = 16, levels: int = 8, rank: int = 5) -> AzimuthBasis:
    """Curves and coefficients of either sign whose sum is held at 0 over large parts of level and azimuth."""
    rng = np.random.default_rng(rank)
    phi, x = 2 * np.pi * np.arange(azimuths) / azimuths, levels_of(levels)
    curves = [np.ones((azimuths, levels))]
    for k in range(1, rank):
        curves.append(np.cos(((k + 1) // 2) * phi - 0.7 * k)[:, None] * (1 - x) * 2)
        curves[-1][:, 0] = curves[-1][:, 1]
    coefficients = rng.uniform(-2, 2, (height, width, 3, rank))
    coefficients[..., 0] = rng.uniform(0.2, 1.5, (height, width, 3))
    return AzimuthBasis(coefficients.astype(np.float32), np.stack(curves).astype(np.float32))


def write_azimuth_bundle(
    path: Path,
    basis: AzimuthBasis,
    render: RenderSettings | None = None,
    storage: Storage = Storage.FLOAT32,
    a_max: float | None = None,
) -> Bundle:
    """A whole bundle of a map, as the bake writes one."""
    render = render or RenderSettings()
    images, facts, stored = store_azimuth(basis, storage)
    mean = ShadingMap(mean_over_azimuth(stored))
    height, width = basis.coefficients.shape[:2]
    averages = averages_of(mean.slices).tolist()
    document = {
        "source": {"name": path.stem, "sha256": "0" * 64, "facts": {"format": "photographs of a swatch"}},
        "map": {
            **facts,
            "slices": basis.curves.shape[2],
            "height": height,
            "width": width,
            "gutter": GUTTER,
            "storage": str(storage),
            "a_max": a_max,
            "level_by_cosine": level_by_cosine(None, np.array([1.0])),
        },
        "averages": {"photographs": [], "elevations_deg": None, "before": averages, "after": averages},
        "errors": {"storage_rms": 0.0, "signal_rms": 1.0, "held_out": [], "held_out_relative": None},
        "warnings": [],
        "render": render.facts(),
        "albedo": map_albedo_facts(mean, render, a_max),
    }
    return read_bundle(write_bundle(path, document, images, preview_swatch(mean), kind="shading_map"))
