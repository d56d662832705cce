"""An independent renderer as referee: our evaluation of RGL files against Mitsuba's `measured`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.sources.rgl import read_rgl


@pytest.mark.slow
def test_rgl_equals_mitsuba_at_random_directions(shared_data: Path) -> None:
    """All files at 300 pairs each, down to 2 degrees above the horizon; negatives are compared as they are."""
    mi = pytest.importorskip("mitsuba", reason="Mitsuba comes with ./run test --all")
    mi.set_variant("scalar_rgb")
    rng = np.random.default_rng(11)
    wi, wo = (spherical(np.arccos(rng.uniform(0.035, 1, 300)), rng.uniform(-np.pi, np.pi, 300)) for _ in range(2))
    for file in sorted((shared_data / "rgl").glob("*.bsdf")):
        bsdf = mi.load_dict({"type": "measured", "filename": str(file)})
        context, interaction = mi.BSDFContext(), mi.SurfaceInteraction3f()
        truth = []
        for incident, outgoing in zip(wi, wo, strict=True):
            interaction.wi = incident.tolist()
            value = bsdf.eval(context, interaction, outgoing.tolist())
            truth.append([float(value[k]) / outgoing[2] for k in range(3)])
        found = read_rgl(file).evaluate(wi, wo)
        # Mitsuba computes in float32.
        np.testing.assert_allclose(found, truth, rtol=1e-3, atol=1e-4, err_msg=file.name)
