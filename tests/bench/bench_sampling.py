"""Variance of drawing light directions: the cosine, alias tables by their cells' warp, and warps of two numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from materials import ANALYTIC, cornell_files, rgl_files
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.cell_sampler import Evaluates, build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp
from measured_materials.bake.sampling.warp_choice import fitted_warp
from measured_materials.bake.sampling.warp_sampler import build_warp
from measured_materials.bake.source import Array
from measured_materials.bake.sources import read_source
from measured_materials.bake.tables.treated_source import TreatedSource
from scipy.stats import qmc

ANGLES = (0.1, 0.6, 1.1, 1.4)
SET = 64  # samples of a pixel


def cosine_sample(u: Array) -> tuple[Array, Array]:
    """Cosine-distributed directions and their pdf, from (P, 4) random numbers."""
    wi = spherical(np.arcsin(np.sqrt(u[:, 0])), 2 * np.pi * u[:, 1])
    return wi, wi[:, 2] / np.pi


def low_discrepancy(count: int, dimensions: int) -> Array:
    """Sets of `SET` Sobol points, each scrambled anew, one after the other."""
    sets = [qmc.Sobol(dimensions, seed=k).random(SET) for k in range(count // SET)]
    return np.concatenate(sets)


def spread(source: Evaluates, draw: Callable[[Array, Array], tuple[Array, Array]], random: Array) -> float:
    """Standard deviation of a sample of an even sky, as the means of sets show it, over the mean; of four viewers."""
    total = 0.0
    for theta in ANGLES:
        wo = np.broadcast_to(spherical(theta, 0.0), (len(random), 3))
        wi, pdf = draw(wo, random)
        up = wi[:, 2] > 0
        value = np.zeros(len(random))
        value[up] = source.evaluate(wi[up], wo[up]).mean(-1) * wi[up, 2] / pdf[up]
        means = value.reshape(-1, SET).mean(1)
        total += SET * means.var(ddof=1) / means.mean() ** 2 / len(ANGLES)
    return float(np.sqrt(total))


def run(out: Path, quick: bool) -> None:
    """Relative standard deviation of one sample of the albedo under an even sky, and the bytes of what draws it."""
    count = (20_000 if quick else 100_000) // SET * SET
    white = np.random.default_rng(0).random((count, 4))
    lens = np.concatenate([low_discrepancy(count, 2), white[:, 2:]], 1)
    print("standard deviation of one sample, as a share of its mean (even sky, four viewing angles)")
    print("Sobol: the first two numbers are of low discrepancy, in sets of 64; KiB are of the texels")
    head = ("cosine", "alias p=1", "p=2", "p=3", "p=2 Sobol", "KiB", "warp", "Sobol", "KiB")
    print(f"  {'material':28s}" + "".join(f"{name:>10s}" for name in head))
    measured = [(path.stem, read_source(path)) for path in [*rgl_files(), *cornell_files()]]
    for name, source in (measured or list(ANALYTIC.items()))[:: 4 if quick else 1]:
        treated = TreatedSource(source)
        alias = [build_sampler(treated, SamplerLayout(warp_power=p)) for p in (1, 2, 3)]
        warp = build_warp(treated, fitted_warp(treated, HalfVectorWarp()))
        found = [spread(treated, lambda wo, u: cosine_sample(u), white)]
        found += [spread(treated, sampler.sample, white) for sampler in alias]
        found += [spread(treated, alias[1].sample, lens), alias[1].texels.nbytes / 1024]
        found += [*(spread(treated, warp.sample, random) for random in (white, lens)), warp.texels.nbytes / 1024]
        print(f"  {name:28s}" + "".join(f"{x:10.3f}" if x < 100 else f"{x:10.0f}" for x in found))
