"""Bakes in a fraction of the time, for tests of what becomes of a bundle, whatever its values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from measured_materials.bake.brdf import bake
from measured_materials.bake.envelope.viewers import Elevations, ViewerGrid
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp

PAIRS = 2048
SAMPLER = 16, 16, 8, 2  # n_o, n_h, n_phi, warp_power
WARP = 4, 12, 4, 1e-2  # n_o, n_h, n_phi, linear


@contextmanager
def coarse_bakes() -> Iterator[None]:
    """Within, a bake measures its errors at a sixteenth of the directions, takes closures as the basis has them, and
    makes a small sampler where its settings name none.

    All that a bundle holds is there. Not for tests that look at errors or at pictures.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake, "_ERROR_PAIRS", PAIRS)
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
