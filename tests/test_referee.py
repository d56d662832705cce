"""An independent renderer as referee: our evaluation of RGL files against Mitsuba's `measured`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.sources.rgl import read_rgl
from support.mitsuba_values import mitsuba_values, random_pairs


@pytest.mark.slow
def test_rgl_equals_mitsuba_at_random_directions(shared_data: Path) -> None:
    """All files at 300 pairs each, down to 2 degrees above the horizon; negatives are compared as they are."""
    wi, wo = random_pairs(0.035)
    for file in sorted((shared_data / "rgl").glob("*.bsdf")):
        truth, found = mitsuba_values(file, wi, wo), read_rgl(file).evaluate(wi, wo)
        np.testing.assert_allclose(found, truth, rtol=1e-3, atol=1e-4, err_msg=file.name)
