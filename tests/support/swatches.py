"""Small shading maps for tests, and their bundles without any photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from measured_materials.bake.bundle.bundle import Bundle, read_bundle, write_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.shading_maps.shading_map import ANGLE_KNOTS, ShadingMap, linearise
from measured_materials.bake.shading_maps.slice_atlas import GUTTER
from measured_materials.bake.shading_maps.store import store_map

from .records import ALBEDO


def identity_map(slices: int = 8, size: int = 4, colour: tuple[float, float, float] = (1.3, 1.0, 0.7)) -> ShadingMap:
    """Every pixel of photograph i equals its average, times a colour of mean 1: S(x) = x colour."""
    levels = np.linspace(0, 1, slices, dtype=np.float32)[:, None, None, None]
    return ShadingMap(np.broadcast_to(levels * np.float32(colour), (slices, size, size, 3)).copy())


def rough_map(slices: int = 6, size: int = 16, seed: int = 0) -> ShadingMap:
    """Texels that answer to light in every way: convex, concave, not monotone."""
    rng = np.random.default_rng(seed)
    exponent, k = rng.uniform(0.4, 2.5, (size, size, 3)), rng.uniform(0.3, 1.7, (size, size, 3))
    levels = np.array([0.1, 0.25, 0.4, 0.55, 0.8, 1.0])[:, None, None, None]
    photographs = k * levels**exponent * rng.uniform(0.85, 1.15, (6, size, size, 3))
    return linearise(photographs.astype(np.float32), slices).map


def map_bundle(
    path: Path,
    shading_map: ShadingMap,
    render: RenderSettings,
    *,
    compression: str = "none",
    storage: Storage = Storage.FLOAT32,
    a_max: float | None = None,
) -> Bundle:
    """A bundle of the map, written and read back."""
    images, facts, _ = store_map(shading_map, compression, storage)
    count, height, width = shading_map.slices.shape[:3]
    document = {
        "source": {"name": path.stem, "facts": {}},
        "map": {
            **facts,
            "slices": count,
            "height": height,
            "width": width,
            "gutter": GUTTER,
            "storage": str(storage),
            "a_max": a_max,
            "level_by_cosine": np.linspace(0, 1, ANGLE_KNOTS).tolist(),
        },
        "averages": {"before": shading_map.slices.mean(axis=(1, 2, 3)).tolist()[1:]},
        "errors": {"storage_rms": 0.0, "signal_rms": 0.5},
        "render": render.facts(),
        "albedo": {**ALBEDO, "sigma": 0.5, "a_max": 0.25},
    }
    return read_bundle(write_bundle(path, document, images, kind="shading_map"))
