"""The closures of an anisotropic envelope, native to Cycles: Diffuse BSDF, and GGX of a width along each tangent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..lobes.microfacets import ggx_lobe
from ..source import Array, Facts
from .closures import NARROWEST

WIDEST = 1.0
_BASIS_WIDTHS = (0.01, 0.025, 0.06, 0.15, 0.4, 1.0)
# Cycles holds the Anisotropy of Glossy BSDF at 0.99 of 1, and alpha_x / alpha_y is (1 - a)^2.
LARGEST_RATIO = 1e4
_GRAZING = 1e-6


@dataclass(frozen=True, order=True)
class AnisotropicLobe:
    """ "lambert", or "ggx" of slope widths `alpha_x` along the tangent and `alpha_y` across it."""

    name: str
    alpha_x: float = 0.0
    alpha_y: float = 0.0

    def value(self, wi: Array, wo: Array) -> Array:
        """BRDF (...) in 1/sr of unit directions (..., 3); 0 for wi on or below the horizon."""
        wi, wo = np.broadcast_arrays(wi, wo)
        result = np.zeros(wi.shape[:-1])
        above = wi[..., 2] > 0
        if self.name == "lambert":
            result[above] = 1 / np.pi
            return result
        lit, seen = wi[above].astype(np.float64), wo[above].astype(np.float64)
        lit[:, 2], seen[:, 2] = np.maximum(lit[:, 2], _GRAZING), np.maximum(seen[:, 2], _GRAZING)
        result[above] = ggx_lobe(lit, seen, self.alpha_x, self.alpha_y)
        return result

    @property
    def roughness(self) -> float:
        """Roughness of the Glossy BSDF; its square is the geometric mean of the widths."""
        return float((self.alpha_x * self.alpha_y) ** 0.25)

    @property
    def anisotropy(self) -> float:
        """Anisotropy of the Glossy BSDF; above 0 the lobe is narrower along the tangent."""
        if self.alpha_x <= self.alpha_y:
            return float(1 - (self.alpha_x / self.alpha_y) ** 0.5)
        return float((self.alpha_y / self.alpha_x) ** 0.5 - 1)

    def facts(self) -> Facts:
        """JSON-ready; `bake.brdf.closures` reads it back."""
        widths = {} if self.name == "lambert" else {"alpha_x": self.alpha_x, "alpha_y": self.alpha_y}
        return {"name": self.name, **widths}

    def neighbours(self, ratio: float) -> list[AnisotropicLobe]:
        """Closures with one width, or both, times or over `ratio`; three digits."""
        if self.name == "lambert":
            return []
        moves = ((ratio, 1.0), (1.0, ratio), (ratio, ratio), (ratio, 1 / ratio))
        found = set()
        for x, y in (*moves, *((1 / x, 1 / y) for x, y in moves)):
            widths = (float(f"{np.clip(a, NARROWEST, WIDEST):.3g}") for a in (self.alpha_x * x, self.alpha_y * y))
            found.add(AnisotropicLobe("ggx", *widths))
        return sorted(found - {self})


# Lambert, and GGX of widths in steps of about 2.5.
ANISOTROPIC_BASIS: tuple[AnisotropicLobe, ...] = (
    AnisotropicLobe("lambert"),
    *(AnisotropicLobe("ggx", x, y) for x in _BASIS_WIDTHS for y in _BASIS_WIDTHS),
)
