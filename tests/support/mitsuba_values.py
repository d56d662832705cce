"""What Mitsuba's `measured` reads from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.source import Array


def random_pairs(least_cosine: float) -> tuple[Array, Array]:
    """300 pairs of directions, in all azimuths."""
    rng, n = np.random.default_rng(11), 300
    cosines = ((rng.uniform(least_cosine, 1, n), rng.uniform(-np.pi, np.pi, n)) for _ in range(2))
    wi, wo = (spherical(np.arccos(cosine), phi) for cosine, phi in cosines)
    return wi, wo


def mitsuba_values(file: Path, wi: Array, wo: Array) -> Array:
    """BRDF (P, 3) in 1/sr, computed in float32; skips the test where Mitsuba is not installed."""
    mi = pytest.importorskip("mitsuba", reason="Mitsuba comes with ./run test --all")
    mi.set_variant("scalar_rgb")
    bsdf = mi.load_dict({"type": "measured", "filename": str(file)})
    context, interaction = mi.BSDFContext(), mi.SurfaceInteraction3f()
    values = []
    for incident, outgoing in zip(wi, wo, strict=True):
        interaction.wi = incident.tolist()
        value = bsdf.eval(context, interaction, outgoing.tolist())
        values.append([float(value[k]) / outgoing[2] for k in range(3)])
    return np.array(values)
