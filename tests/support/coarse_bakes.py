"""Bakes in a fraction of the time, for tests of what becomes of a bundle, whatever its values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from measured_materials.bake.brdf import bake
from measured_materials.bake.envelope.viewers import Elevations, ViewerGrid

PAIRS = 2048


@contextmanager
def coarse_bakes() -> Iterator[None]:
    """Within, a bake measures its errors at a sixteenth of the directions, and takes closures as the basis has them.

    All that a bundle holds is there, of the same kinds and sizes. Not for tests that look at errors or at pictures.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake, "_ERROR_PAIRS", PAIRS)
        for viewers in (Elevations, ViewerGrid):
            patch.setattr(viewers, "search", replace(viewers.search, ratios=(), exchanged=False, of_basis=False))
        yield
