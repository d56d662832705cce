"""The warp sampler as node groups and in OSL against float64 numpy, draw by draw, on render cards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import normalize, spherical
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp
from measured_materials.bake.sampling.inverse_tables import inverted, stratum
from measured_materials.bake.sampling.slope_warp import SlopeWarp
from measured_materials.bake.sampling.warp_sampler import WarpSampler, build_warp
from measured_materials.bake.sources import analytic
from measured_materials.nodes.group import call
from measured_materials.nodes.osl_parameters import cell_constants
from measured_materials.nodes.warp_sampler_group import warp_pdf_group, warp_sampler_group
from numpy.typing import NDArray
from support.cards import card, data_image
from support.osl import shader_card, skip_without_osl

Array = NDArray[np.float32]
BRUSHED = analytic.Ggx(alpha=0.1, alpha_y=0.4)
SAMPLERS = {
    "satin": (analytic.Ward(alpha=0.3, diffuse=(0.3, 0.1, 0.05), specular=0.2), HalfVectorWarp(8, 24, 12, 1e-2)),
    "mirror-like": (analytic.Ggx(alpha=0.02), HalfVectorWarp(linear=1e-5)),
    "brushed": (BRUSHED, SlopeWarp(4, 8, 14, 12, 0.1, 0.4)),
    "brushed, half a turn": (BRUSHED, SlopeWarp(4, 8, 14, 12, 0.1, 0.4, True)),
}


def sampler_of(name: str) -> WarpSampler:
    source, layout = SAMPLERS[name]
    return build_warp(source, layout)


def draws(sampler: WarpSampler, turned: bool) -> tuple[Array, Array]:
    """Viewers (N, 3) and numbers (N, 4), 0 and 1 included, that float32 takes for the same bins, strata and rows."""
    rng, count, layout = np.random.default_rng(5), 6000, sampler.layout
    theta = np.concatenate([[0, 1e-4, np.pi / 2 - 1e-3], np.arccos(rng.random(count - 3))])
    wo = spherical(theta, rng.uniform(-np.pi, np.pi, count) * turned).astype(np.float32)
    u = rng.random((count, 4)).astype(np.float32)
    u[:81] = np.stack(np.meshgrid(*[[0, 0.37, 1]] * 4), -1).reshape(-1, 4)
    near = [layout.bin_of(xp_numpy, normalize(wo.astype(float) + d)) for d in 1e-5 * np.vstack([np.eye(3), -np.eye(3)])]
    row = layout.bin_of(xp_numpy, wo.astype(float)).astype(int)
    matte = sampler.texels[row, 0, 3].astype(float)
    first = u[:, 0].astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        rest = np.where(first < matte, first / matte, (first - matte) / np.where(matte < 1, 1 - matte, 1))
    s = inverted(xp_numpy, rest, sampler.texels[row, stratum(xp_numpy, rest, layout.strata).astype(int), :3])
    far = (np.ptp(near, 0) == 0) & (np.abs(first - matte) > 1e-5) & (np.abs(s - np.rint(s)) > 1e-3)
    return wo[far], u[far]


def assert_same(sampler: WarpSampler, wo: Array, u: Array, wi: Array, pdf: Array, density: Array, other: Array) -> None:
    """Directions and densities as numpy has them; `density` is that of the directions `other`."""
    expected_wi, expected_pdf = sampler.sample(wo.astype(float), u.astype(float))
    off = np.abs(wi - expected_wi).max(-1)
    print("wi", np.median(off), np.quantile(off, 0.98), off.max())
    # Where the second number lies beside the end of a stratum both entries give one place; slopes magnify in the tail.
    assert np.median(off) < 6e-7 and np.quantile(off, 0.98) < 1e-5 and off.max() < 1e-4
    up = expected_wi[:, 2] > 0.01
    off = np.abs(pdf[up] / expected_pdf[up] - 1)
    print("pdf", np.median(off), np.quantile(off, 0.97))
    assert np.median(off) < 5e-6 and np.quantile(off, 0.97) < 3e-5
    up = other[:, 2] > 0.01
    truth = sampler.pdf(other[up].astype(float), wo[up].astype(float))
    off = np.abs(density[up] / truth - 1)
    print("density", np.median(off), np.quantile(off, 0.97))
    # At the edge of a cell either of two is right.
    assert np.median(off) < 5e-6 and np.quantile(off, 0.97) < 3e-5


@pytest.mark.parametrize("name", SAMPLERS)
def test_nodes(name: str) -> None:
    sampler = sampler_of(name)
    image = data_image(f"warp {name}", sampler.texels)
    draw, ask = (make(f"card warp {name}", image, sampler.layout) for make in (warp_sampler_group, warp_pdf_group))
    wo, u = draws(sampler, name.startswith("brushed"))
    wi, pdf = card(lambda o, *r: call(draw, o, *r), wo, *u.T)
    other = np.random.default_rng(6).permutation(wi)
    (density,) = card(lambda i, o: call(ask, i, o), other, wo)
    assert_same(sampler, wo, u, wi, pdf, density, other)


@pytest.mark.parametrize("name", SAMPLERS)
def test_osl(tmp_path: Path, name: str) -> None:
    skip_without_osl()
    sampler = sampler_of(name)
    write_image(tmp_path / "warp.exr", sampler.texels, Storage.FLOAT32)
    wo, u = draws(sampler, name.startswith("brushed"))
    other = np.random.default_rng(6).permutation(sampler.sample(wo.astype(float), u)[0]).astype(np.float32)
    constants = {"Sampler": str(tmp_path / "warp.exr"), **cell_constants(sampler.layout)}
    numbers = dict(zip(("RandomCell", "RandomAlias", "RandomU", "RandomV"), u.T, strict=True))
    wi, pdf, density = shader_card(
        "measured_sampler.osl", ["wi", "pdf", "Density"], constants, wo=wo, Direction=other, **numbers
    )
    assert_same(sampler, wo, u, wi, pdf, density, other)
