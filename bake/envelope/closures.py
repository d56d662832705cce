"""The closures an envelope is made of: native to Cycles, and equal to their formulas in `bake.lobes.lobes`.

lambert       Diffuse BSDF.
ggx           Glossy BSDF of distribution GGX. Metals and clear coats ask for narrow ones: on chrome, alpha 0.005 alone
              carries six times what 0.02 does. Cycles takes 1 - cos^2 theta_h in float32: at alpha 0.005 (`NARROWEST`)
              that scatters its values by 0.5 %, but moves the energy of the lobe by less than 0.1 %.
sheen         Sheen BSDF of distribution Ashikhmin: the rim of felts and cloth.

To the share carried Oren-Nayar would add at most 0.02, and needs a node more. Normals tilted toward the viewer add
at most 0.04 and mostly less than 0.01, tilted away at most 0.03 (`./run bench envelope`, 22 materials): not worth their
part of a graph. Neither is in the basis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..errors import BakeError
from ..lobes.lobes import PARAMETERS, Lobe
from ..source import Array, Facts


class Closure(Protocol):
    """A closure native to Cycles: a `Lobe`, or an `AnisotropicLobe`."""

    @property
    def name(self) -> str:
        """Of its formula."""
        ...

    def value(self, wi: Array, wo: Array) -> Array:
        """BRDF (...) in 1/sr without the cosine."""
        ...

    def facts(self) -> Facts:
        """Name and parameters, JSON-ready."""
        ...


NARROWEST = 0.005
_ALPHAS = (0.005, 0.007, 0.01, 0.014, 0.02, 0.03, 0.04, 0.06, 0.08, 0.12, 0.17, 0.25, 0.35, 0.5, 0.7, 1.0)
_SIGMAS = (0.3, 0.5, 0.7, 1.0)
BASIS: tuple[Lobe, ...] = (
    Lobe("lambert"),
    *(Lobe("ggx", alpha) for alpha in _ALPHAS),
    *(Lobe("sheen", sigma) for sigma in _SIGMAS),
)
NATIVE: tuple[str, ...] = ("lambert", "oren_nayar", "ggx", "sheen")


def check_basis(basis: Sequence[Closure]) -> None:
    """Raises BakeError where a lobe has no closure of its own, or there is none at all, or one twice."""
    for lobe in basis:
        if lobe.name not in NATIVE:
            raise BakeError("envelope basis", f"{lobe.name} is no native closure", f"choose from {', '.join(NATIVE)}")
    if not basis or len(set(basis)) < len(basis):
        raise BakeError("envelope basis", "is empty or holds a closure twice", "list every closure once")


def closure_values(closures: Sequence[Closure], wi: Array, wo: Array) -> Array:
    """f cos(theta_i) of each closure in 1/sr, (..., K), at unit directions that broadcast to (..., 3)."""
    wi, wo = np.broadcast_arrays(wi, wo)
    return np.stack([lobe.value(wi, wo) for lobe in closures], -1) * np.maximum(wi[..., 2:], 0)


def closure_sum(closures: Sequence[Closure], weights: Array, wi: Array, wo: Array) -> Array:
    """Sum over k of weights (..., K, 3) times closures, without the cosine, in 1/sr; 0 for a viewer below the horizon.

    Finite at grazing light, since no closure is ever divided by the cosine.
    """
    result = np.zeros(np.broadcast_shapes(wi.shape, wo.shape))
    for k, lobe in enumerate(closures):
        result += lobe.value(wi, wo)[..., None] * weights[..., k, :]
    result[wo[..., 2] <= 0] = 0
    return result


def neighbours(lobe: Lobe, ratio: float) -> list[Lobe]:
    """Closures with the parameter times and over `ratio`, within what Cycles does well; three digits."""
    if not PARAMETERS[lobe.name]:
        return []
    parameter = PARAMETERS[lobe.name][0]
    low = NARROWEST if lobe.name == "ggx" else parameter.low
    moved = {float(f"{np.clip(lobe.p1 * r, low, parameter.high):.3g}") for r in (ratio, 1 / ratio)}
    return [Lobe(lobe.name, p) for p in sorted(moved - {lobe.p1})]
