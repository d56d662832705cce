"""A Principled BSDF of about the look of a measured material: what an artist would use in its place.

Fitted in numpy to a model of the node: a diffuse base under a dielectric GGX layer, or a metal of Schlick's Fresnel
reflectance, with or without sheen. The base colour is what gives the measured albedo; roughness, index and sheen are
those of least squares between the square roots of f cos (Hellinger's distance), in which highlight and body weigh by
the light they carry. The node is too bright for what is dark even at grazing angles; noise is compared in parts of the
brightness, so that the form counts, and the fit compares both at the same albedo. Cycles' own node adds light scattered
several times and has a sheen of another shape (Zeltner et al. 2022): near enough for this.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import bpy
import numpy as np

from ...bake.envelope.views import Views, gauss_chords, sample_views
from ...bake.lobes.lobes import Lobe
from ...bake.lobes.microfacets import dielectric, schlick
from ...bake.source import Array, BrdfSource
from ...bake.tables.treated_source import TreatedSource
from ...nodes import compat

_VIEWS, _N_H, _N_PHI = 10, 24, 12
_ALPHAS = (0.005, 0.01, 0.02, 0.04, 0.06, 0.09, 0.13, 0.18, 0.25, 0.35, 0.5, 0.7, 1.0)
_INDICES = (1.1, 1.15, 1.2, 1.3, 1.4, 1.5, 1.65, 1.8)
_SHEENS = (0.0, 0.25, 0.5, 1.0)


@dataclass(frozen=True)
class Principled:
    """Inputs of the node, and the relative error of the square roots that the fit left."""

    base: tuple[float, float, float]
    metallic: float
    roughness: float
    ior: float
    sheen: float
    error: float

    def material(self) -> bpy.types.Material:
        """A material of that node alone."""
        values = {"Base Color": (*self.base, 1), "Metallic": self.metallic, "Roughness": self.roughness}
        values |= {"IOR": self.ior, "Sheen Weight": self.sheen}
        return compat.shader_material("Principled", "ShaderNodeBsdfPrincipled", values)

    def __str__(self) -> str:
        kind = "metal" if self.metallic else f"IOR {self.ior:g}"
        sheen = f", sheen {self.sheen:g}" if self.sheen else ""
        return f"{kind}, roughness {self.roughness:.2f}{sheen}"


def fit_principled(source: BrdfSource) -> Principled:
    """The least squares over a grid of roughness, index and sheen; the base colour is solved for."""
    chords, importance = gauss_chords(_VIEWS)
    views = sample_views(TreatedSource(source), chords, _N_H, _N_PHI)
    albedo = importance @ views.energy
    measured = np.sqrt(views.values)
    weight = importance[:, None] * views.areas
    fuzz = Lobe("sheen", 0.5).value(*np.broadcast_arrays(views.wi, views.wo)) * views.wi[..., 2]
    fits = []
    for alpha, index in itertools.product(_ALPHAS, (None, *_INDICES)):
        coloured, plain = _parts(views, alpha, index)
        for sheen in _SHEENS:
            rest = plain + sheen * fuzz
            base = np.clip((albedo - (weight * rest).sum()) / (weight * coloured).sum(), 0, 1)
            model = coloured[..., None] * base + rest[..., None]
            model = np.sqrt(model * (albedo.sum() / np.einsum("vp,vpc->", weight, model)))
            error = float(np.einsum("vp,vpc->", weight, (measured - model) ** 2))
            fits.append((error, tuple(map(float, base)), alpha, index, sheen))
    error, (red, green, blue), alpha, index, sheen = min(fits, key=lambda fit: fit[0])
    error = math.sqrt(error / float(np.einsum("vp,vpc->", weight, measured**2)))
    return Principled((red, green, blue), float(index is None), math.sqrt(alpha), index or 1.5, sheen, error)


def _parts(views: Views, alpha: float, index: float | None) -> tuple[Array, Array]:
    """f cos (V, P) of what the base colour multiplies, and of what it does not; without an index of a metal."""
    wi, wo = np.broadcast_arrays(views.wi, views.wo)
    lobe = Lobe("ggx", alpha).value(wi, wo) * wi[..., 2]
    cos_d = 0.5 * np.linalg.norm(wi + wo, axis=-1)
    if index is None:
        edge = schlick(cos_d, np.zeros(()))
        return lobe * (1 - edge), lobe * edge
    layer = lobe * dielectric(cos_d, np.array(index))
    passed = 1 - (views.areas * layer).sum(-1, keepdims=True)
    return passed * wi[..., 2] / math.pi, layer
