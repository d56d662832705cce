"""Diffuse plus two GGX lobes fitted to scattered samples: the prior that `scattered` may build on.

It carries what a handful of samples cannot show an interpolant: how a specular peak is shaped between and
beyond them, towards grazing in particular.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ...source import Array
from .scattered_invariants import Invariants

NARROW_ALPHAS = (0.003, 0.006, 0.01, 0.015, 0.02, 0.03, 0.05, 0.08, 0.12)
BROAD_ALPHAS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.6)
NORMAL_REFLECTANCES = (0.02, 0.04, 0.08)


def _shadowing(cosine: Array, alpha: float) -> Array:
    """Smith's G1 of GGX divided by the cosine, finite at grazing (Walter et al. 2007, equation 34)."""
    return 2 / (cosine + np.sqrt(alpha**2 + (1 - alpha**2) * cosine**2))


def lobe_basis(pair: Invariants, narrow: float, broad: float, f0: float) -> Array:
    """Unit-amplitude terms of the model, (..., 5), all reciprocal.

    Lambert; a diffuse term dimmed by Fresnel transmission both ways (Ashikhmin and Shirley 2000, equation 5);
    a narrow and a broad GGX lobe (Walter et al. 2007) under Schlick's Fresnel term; the broad one without it.

    Parameters
    ----------
    pair : of shape (...)
    narrow, broad : GGX alpha
    f0 : reflectance at normal incidence
    """
    sin2_h, cos_d, cos_i, cos_o = pair
    fresnel = f0 + (1 - f0) * (1 - cos_d) ** 5

    def ggx(alpha: float) -> Array:
        # The chord form alpha^2 + (1 - alpha^2) sin^2 keeps its digits at the peak of a narrow lobe.
        ndf = alpha**2 / (np.pi * (alpha**2 + (1 - alpha**2) * sin2_h) ** 2)
        return ndf * _shadowing(cos_i, alpha) * _shadowing(cos_o, alpha) / 4

    broad_lobe = ggx(broad)
    transmitted = (1 - (1 - cos_i / 2) ** 5) * (1 - (1 - cos_o / 2) ** 5) / np.pi
    lambert = np.full_like(cos_i, 1 / np.pi)
    return np.stack([lambert, transmitted, ggx(narrow) * fresnel, broad_lobe * fresnel, broad_lobe], -1)


def nonnegative_least_squares(matrix: Array, target: Array) -> Array:
    """min |matrix x - target| subject to x >= 0, by trying every support; for a handful of columns.

    Parameters
    ----------
    matrix : (N, K), K <= 6
    target : (N,)

    Returns
    -------
    (K,)
    """
    columns = matrix.shape[1]
    normal, right = matrix.T @ matrix, matrix.T @ target
    # Lobes whose samples are missing leave empty columns; the ridge keeps them out without an exception.
    normal = normal + np.eye(columns) * 1e-10 * max(float(np.trace(normal)), 1e-30)
    best, least = np.zeros(columns), 0.0
    for support in product((False, True), repeat=columns):
        picked = np.flatnonzero(support)
        if not picked.size:
            continue
        x = np.linalg.solve(normal[np.ix_(picked, picked)], right[picked])
        gain = -float(right[picked] @ x)
        if (x >= 0).all() and gain < least:
            least = gain
            best = np.zeros(columns)
            best[picked] = x
    return best


@dataclass(frozen=True)
class Lobes:
    """Fitted model: shape parameters and amplitudes (5, C) of `lobe_basis`."""

    narrow: float
    broad: float
    f0: float
    amplitude: Array

    def evaluate(self, pair: Invariants) -> Array:
        """(..., C) BRDF in 1/sr, >= 0, of invariants of shape (...)."""
        return lobe_basis(pair, self.narrow, self.broad, self.f0) @ self.amplitude


def fit_lobes(pair: Invariants, values: Array, scale: float) -> Lobes:
    """Lobes of least squared error in asinh(f / scale), over a grid of shapes.

    Amplitudes are the least-squares ones for errors relative to f + scale, so that dark samples weigh as much
    as the peak.

    Parameters
    ----------
    pair : of shape (N,)
    values : (N, C)
    scale : BRDF value below which errors count linearly
    """
    weight = 1 / (np.abs(values) + scale)
    level = np.arcsinh(values / scale)
    best, least = None, np.inf
    for narrow, broad, f0 in product(NARROW_ALPHAS, BROAD_ALPHAS, NORMAL_REFLECTANCES):
        if broad < 1.5 * narrow:
            continue
        basis = lobe_basis(pair, narrow, broad, f0)
        amplitude = np.stack(
            [
                nonnegative_least_squares(basis * weight[:, c : c + 1], values[:, c] * weight[:, c])
                for c in range(values.shape[1])
            ],
            -1,
        )
        error = float(np.mean((np.arcsinh(basis @ amplitude / scale) - level) ** 2))
        if error < least:
            best, least = Lobes(narrow, broad, f0, amplitude), error
    if best is None:
        raise ValueError("the samples are not finite")
    return best
