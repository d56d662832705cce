"""Variance of drawing light directions: cosine against alias tables, and the warps of the tables' cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from materials import cornell_files, rgl_files
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.cell_sampler import build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import Array
from measured_materials.bake.sources import read_source
from measured_materials.bake.tables.accuracy import estimator_variance
from measured_materials.bake.tables.treated_source import TreatedSource

ANGLES = (0.1, 0.6, 1.1, 1.4)


def cosine_sample(u: Array) -> tuple[Array, Array]:
    """Cosine-distributed directions and their pdf, from (P, 4) random numbers."""
    wi = spherical(np.arcsin(np.sqrt(u[:, 0])), 2 * np.pi * u[:, 1])
    return wi, wi[:, 2] / np.pi


def run(out: Path, quick: bool) -> None:
    """Relative standard deviation of one sample of the albedo under a uniform sky, mean of four viewing angles."""
    count = 20_000 if quick else 100_000
    random = np.random.default_rng(0).random((count, 4))
    print("standard deviation of one sample, as a share of its mean (uniform sky, four viewing angles)")
    print(
        f"  {'material':28s} {'cosine':>8s} {'warp 1':>8s} {'warp 2':>8s} {'warp 3':>8s}   gain of warp 2 in variance"
    )
    for path in [*rgl_files(), *cornell_files()][:: 4 if quick else 1]:
        treated = TreatedSource(read_source(path))
        samplers = [build_sampler(treated, SamplerLayout(warp_power=p)) for p in (1, 2, 3)]
        totals = np.zeros(4)
        for theta in ANGLES:
            wo = np.broadcast_to(spherical(theta, 0.0), (count, 3))

            def integrand(wi: Array, wo: Array = wo, treated: TreatedSource = treated) -> Array:
                return treated.evaluate(wi, wo) * np.maximum(wi[:, 2:], 0)

            draws = [cosine_sample, *(lambda u, s=s, wo=wo: s.sample(wo, u) for s in samplers)]
            for k, draw in enumerate(draws):
                mean, variance = estimator_variance(integrand, draw, random)
                totals[k] += variance / mean**2 / len(ANGLES)
        spread = np.sqrt(totals)
        row = " ".join(f"{x:8.3f}" for x in spread)
        print(f"  {path.stem:28s} {row}   {totals[0] / totals[2]:8.1f}")
