"""What a shading map reflects on the average: its response to r, and the albedo that follows from f_r."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import xp_numpy
from ..lobes.lobes import Lobe, lobe_peak, lobe_value
from ..source import Array, BrdfSource, Facts
from ..tables.albedo import albedo_facts
from .render_settings import UNCALIBRATED_SIGMA, RenderSettings
from .shading_map import ShadingMap

_NORMAL = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class LobeSource:
    """An f_r as a BRDF source."""

    lobe: Lobe
    isotropic: bool = True
    bilateral: bool = True

    @property
    def name(self) -> str:
        """Name of the lobe."""
        return self.lobe.name

    @property
    def facts(self) -> Facts:
        """Parameters of the lobe, JSON-ready."""
        return self.lobe.facts()

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr."""
        value = lobe_value(xp_numpy, self.lobe.name, wi, wo, self.lobe.p1, self.lobe.p2)
        return np.repeat(np.asarray(value)[..., None], 3, -1)


class _Average:
    """The mean over the swatch as a BRDF source: a_max A(sigma f_r cos / a_max) / cos, A the slices' mean colours."""

    isotropic = bilateral = True
    name = "shading map"

    def __init__(self, shading_map: ShadingMap, f_r: BrdfSource, above: str, scale: tuple[float, float]) -> None:
        self.means = shading_map.slices.mean(axis=(1, 2), dtype=np.float64)
        self.levels, self.f_r, self.above = shading_map.levels, f_r, above
        self.sigma, self.a_max = scale
        self.facts: Facts = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr of the swatch's mean."""
        cosine = np.maximum(wi[..., 2:], 1e-6)
        x = self.sigma / self.a_max * self.f_r.evaluate(wi, wo) * cosine
        response = np.stack([np.interp(x[..., c], self.levels, self.means[:, c]) for c in range(3)], -1)
        if self.above == "scale":
            response *= np.maximum(x, 1)
        return self.a_max * response / cosine


def resolved_scale(
    render: RenderSettings, calibrated: float | None, f_r: BrdfSource | None = None
) -> tuple[float, float]:
    """(sigma, a_max): what is given stays, and what is not makes the peak of sigma f_r cos meet a_max.

    Parameters
    ----------
    calibrated : r of the brightest photograph in 1/sr, if it is known
    f_r : where it is a table instead of `render.lobe`
    """
    a_max = render.a_max if render.a_max is not None else calibrated
    if render.sigma is not None and a_max is not None:
        return render.sigma, a_max
    peak = peak_of(render, f_r)
    if a_max is not None:
        return a_max / peak, a_max
    sigma = UNCALIBRATED_SIGMA if render.sigma is None else render.sigma
    return sigma, sigma * peak


def peak_of(render: RenderSettings, f_r: BrdfSource | None = None) -> float:
    """Largest f_r cos(theta_i) seen from the normal, in 1/sr."""
    if f_r is None and render.lobe is not None:
        return float(lobe_peak(xp_numpy, render.lobe.name, _NORMAL, render.lobe.p1, render.lobe.p2))
    assert f_r is not None
    # Chord spacing: as fine at a mirror peak as anywhere.
    half = np.linspace(0, 1, 4001) ** 2 * (np.pi / 4)
    theta = 2 * half
    wi = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], -1)
    value = f_r.evaluate(wi, np.broadcast_to(_NORMAL, wi.shape)).mean(-1) * wi[:, 2]
    return float(value.max())


def map_albedo_facts(
    shading_map: ShadingMap, render: RenderSettings, calibrated: float | None, f_r: BrdfSource | None = None
) -> Facts:
    """`albedo.albedo_facts` of the swatch's average, with the sigma and a_max that it holds for."""
    sigma, a_max = resolved_scale(render, calibrated, f_r)
    source: Any = f_r if f_r is not None else LobeSource(_lobe(render))
    average = _Average(shading_map, source, render.above, (sigma, a_max))
    return {**albedo_facts(average, n=32), "sigma": sigma, "a_max": a_max}


def _lobe(render: RenderSettings) -> Lobe:
    assert render.lobe is not None
    return render.lobe
