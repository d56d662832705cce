"""Bakes in a fraction of the time, for tests of what becomes of a bundle, whatever its values."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.brdf import bake, preview_sphere
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.envelope.viewers import Elevations, ViewerGrid
from measured_materials.bake.images import png
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp

PAIRS = 2048
SAMPLER = 16, 16, 8, 2  # n_o, n_h, n_phi, warp_power
WARP = 4, 12, 4, 1e-2  # n_o, n_h, n_phi, linear


@contextmanager
def coarse_bakes() -> Iterator[None]:
    """Within, a bake measures its errors at a sixteenth of the directions, takes closures as the basis has them, makes
    a small sampler where its settings name none, shades its preview by one light, and compresses without a search.

    All that a bundle holds is there. Not for tests that look at errors, at pictures or at bytes.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake, "_ERROR_PAIRS", PAIRS)
        patch.setattr(preview_sphere, "_ring", lambda count, theta: np.zeros((0, 3)))
        patch.setattr(png, "_BEST", 1)
        patch.setattr(png, "_TRIED", 0)
        patch.setattr(SamplerLayout.__init__, "__defaults__", SAMPLER)
        patch.setattr(HalfVectorWarp.__init__, "__defaults__", WARP)
        for viewers in (Elevations, ViewerGrid):
            patch.setattr(viewers, "search", replace(viewers.search, ratios=(), exchanged=False, of_basis=False))
        yield


@pytest.fixture(autouse=True, scope="module")
def coarse() -> Iterator[None]:
    """For a module of tests, which takes it up by importing it."""
    with coarse_bakes():
        yield


@contextmanager
def baked_once(known: dict[str, BakeResult], folder: Path) -> Iterator[None]:
    """Within, imports of a file with settings that are `known` copy what the first of them has baked to `folder`."""
    from measured_materials.addon.material import bake_material  # Blender is imported where it is used

    def bake_file(file: Path, out: Path, settings: BakeSettings, progress: object = None) -> BakeResult:
        kept = folder / out.name
        key = f"{file} {settings} {out.name}"
        if key not in known:
            known[key] = bake.bake_file(file, kept, settings)
        shutil.copytree(kept, out)
        return replace(known[key], path=out)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake_material, "bake_file", bake_file)
        yield
