"""The width about which a warp's rows are spread: that of least variance, measured.

Each width's sampler draws, all draws together are one sample of their mixture, and each width's second moment is
estimated from all of them: a sampler that misses a highlight is found out by those that do not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..directions import spherical
from ..source import Array
from .cell_sampler import Evaluates
from .half_vector_warp import HalfVectorWarp
from .warp_sampler import WarpSampler, build_warp

WIDTHS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
_BINS = 3
_ANGLES = 0.15, 0.65, 1.1, 1.4
_DRAWS = 1024


def fitted_warp(source: Evaluates, layout: HalfVectorWarp) -> HalfVectorWarp:
    """The layout with the width of least variance, if it names none."""
    if layout.linear > 0:
        return layout
    samplers = [build_warp(source, replace(layout, n_o=_BINS, linear=width)) for width in WIDTHS]
    moments = np.mean([_second_moments(source, samplers, angle) for angle in _ANGLES], 0)
    return replace(layout, linear=WIDTHS[int(moments.argmin())])


def _second_moments(source: Evaluates, samplers: list[WarpSampler], theta_o: float) -> Array:
    """Of a sample of an even sky by each sampler, over the squared mean."""
    random = np.random.default_rng(0).random((_DRAWS, 2))
    wo = np.broadcast_to(spherical(theta_o, 0.0), (_DRAWS, 3))
    wi = np.concatenate([sampler.sample(wo, random)[0] for sampler in samplers])
    wi = wi[wi[:, 2] > 0]
    wo = np.broadcast_to(spherical(theta_o, 0.0), wi.shape)
    light = source.evaluate(wi, wo).mean(-1) * wi[:, 2]
    densities = np.array([sampler.pdf(wi, wo) for sampler in samplers])
    weight = light / densities.mean(0)
    mean = weight.sum() / (len(samplers) * _DRAWS)
    second: Array = (weight * light / densities).sum(1) / (len(samplers) * _DRAWS * max(mean, 1e-300) ** 2)
    return second
