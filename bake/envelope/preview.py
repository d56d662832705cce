"""A measured BRDF as native closures alone: close to it rather than under it (DESIGN.md section 5, mode Preview).

    f cos(theta_i) ~ E = sum_k w_k(theta_o) c_k,   w >= 0,   and the albedo of E is the measured one at every theta_o.

The weights minimise the squared difference in parts of f cos + what a Lambertian surface of the same albedo reflects: a
plain difference would see the highlight and nothing else. They are linear between nodes evenly spaced in
sqrt(1 - cos theta_o), as an envelope's.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..material_json import require
from ..shading.lobes import Lobe, lobe_from_facts
from ..source import Array, BrdfSource
from ..tables.treated_source import TreatedSource
from .closures import BASIS, check_basis, closure_values
from .texture import unpack_weights
from .views import Views, chord_of, gauss_chords, interpolated, sample_views

_MOST = 3
_NODES = 32
_VIEWS, _N_H, _N_PHI = 12, 28, 14
_GAIN = 0.97  # of the error with one closure less: above it, the further closure is not worth its nodes


@dataclass(frozen=True, eq=False)
class PreviewFit:
    """K native closures, their weights (n, K, 3) >= 0 over theta_o, and the relative error left, a number."""

    closures: tuple[Lobe, ...]
    weights: NDArray[np.float32]
    error: float

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """E (..., 3) in 1/sr with its cosine, of unit directions that broadcast."""
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        values = closure_values(self.closures, wi, wo)
        return np.einsum("...k,...kc->...c", values, interpolated(self.weights, chord_of(wo)))

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        closures = [lobe.facts() for lobe in self.closures]
        return {"closures": closures, "nodes": len(self.weights), "error": round(self.error, 6)}

    def packed(self) -> NDArray[np.float32]:
        """(K, n, 4): row k holds the colour of closure k at the nodes, alpha 0."""
        image = np.zeros((*self.weights.shape[1::-1], 4), np.float32)
        image[..., :3] = np.moveaxis(self.weights, 1, 0)
        return image


def fit_preview(source: BrdfSource | TreatedSource, most: int = _MOST, nodes: int = _NODES) -> PreviewFit:
    """Choose at most `most` closures of `BASIS` and fit their weights.

    Raises
    ------
    BakeError : the source is anisotropic, black or not finite
    """
    treated = source if isinstance(source, TreatedSource) else TreatedSource(source)
    if not treated.source.isotropic:
        raise BakeError(treated.name, "is anisotropic, and this fit is isotropic", "fit an isotropic material")
    chords, importance = gauss_chords(_VIEWS)
    closures, error = _chosen(sample_views(treated, chords, _N_H, _N_PHI), importance, most)
    views = sample_views(treated, np.linspace(0, 1, nodes), _N_H, _N_PHI)
    if not views.values.any():
        raise BakeError(treated.name, "reflects nothing", "check the file")
    return PreviewFit(closures, albedo_weights(views, closures).astype(np.float32), error)


def preview_from_image(facts: Mapping[str, Any], image: Array, where: str | Path = "preview") -> PreviewFit:
    """What `PreviewFit.facts` and `packed` gave, read from an untrusted bundle. Raises BakeError."""
    weights, _ = unpack_weights(image, where)
    listed = require(facts, "closures", list, where, 1, _MOST)
    if weights.shape[:2] != (require(facts, "nodes", int, where), len(listed)):
        raise BakeError(where, "does not hold the weights of its closures", "bake it again")
    closures = tuple(lobe_from_facts(entry, where) for entry in listed)
    check_basis(closures)
    return PreviewFit(closures, weights, float(require(facts, "error", float, where, minimum=0)))


def normal_equations(views: Views, closures: Sequence[Lobe], values: Array) -> tuple[Array, Array, Array]:
    """Matrices (V, K, K), right sides (V, K, C) and squares (V, C) of the relative problem for values (V, P, C)."""
    energy = np.einsum("vp,vpc->vc", views.areas, values)
    matte = (energy / np.pi)[:, None] * views.wi[..., 2:]
    # One weight for all channels keeps one matrix for them.
    scale = (values + matte).sum(-1)
    weight = views.areas * np.divide(1.0, scale * scale, out=np.zeros_like(scale), where=scale > 0)
    columns = closure_values(closures, views.wi, views.wo)
    weighted = columns * weight[..., None]
    matrices = np.einsum("vpk,vpl->vkl", weighted, columns, optimize=True)
    sides = np.einsum("vpk,vpc->vkc", weighted, values, optimize=True)
    return matrices, sides, np.einsum("vp,vpc->vc", weight, values * values)


def _chosen(views: Views, importance: Array, most: int) -> tuple[tuple[Lobe, ...], float]:
    """The closures of least error among all sets of one, then two ... as long as one more pays; and the error."""
    values = views.values.sum(-1, keepdims=True)
    if not values.any():
        return BASIS[:1], 0.0
    matrices, sides, squares = normal_equations(views, BASIS, values)
    worth = importance * np.divide(1.0, squares[:, 0], out=np.zeros(len(squares)), where=squares[:, 0] > 0)
    found: tuple[tuple[int, ...], float] = ((0,), np.inf)
    for count in range(1, most + 1):
        sets = np.array(list(itertools.combinations(range(len(BASIS)), count)))
        gram = matrices[:, sets[:, :, None], sets[:, None, :]]
        side = sides[:, sets, 0]
        weights = non_negative(gram, side)
        left = squares - 2 * (weights * side).sum(-1) + np.einsum("vsk,vskl,vsl->vs", weights, gram, weights)
        errors = np.sqrt(np.maximum(worth @ left, 0) / worth.dot(squares[:, 0]))
        best = int(errors.argmin())
        # An error of rounding alone is none: the next set would only have luckier digits.
        if errors[best] > _GAIN * found[1] or found[1] < 1e-6:
            break
        found = tuple(int(i) for i in sets[best]), float(errors[best])
    return tuple(BASIS[i] for i in found[0]), found[1]


def albedo_weights(views: Views, closures: Sequence[Lobe]) -> Array:
    """Weights (V, K, 3) that fit each channel and reflect its albedo; a channel that is black stays so."""
    matrices, sides, _ = normal_equations(views, closures, views.values)
    weights = np.stack([non_negative(matrices, sides[..., c]) for c in range(3)], -1)
    albedos = np.einsum("vp,vpk->vk", views.areas, closure_values(closures, views.wi, views.wo))
    reflected = np.einsum("vk,vkc->vc", albedos, weights)
    energy = views.energy
    lit = reflected > 1e-6 * energy
    # Where nothing fits, as in a channel of noise, the first closure carries the albedo.
    weights[:, 0] += np.where(lit, 0, energy / np.maximum(albedos[:, :1], 1e-9))
    scale = np.divide(energy, reflected, out=np.ones_like(energy), where=lit)
    return weights * scale[:, None]


def non_negative(matrices: Array, sides: Array) -> Array:
    """x >= 0 that minimises x M x / 2 - b x for symmetric M (..., K, K), b (..., K): every support tried, K <= 3."""
    count = matrices.shape[-1]
    best = np.zeros(sides.shape)
    least = np.zeros(sides.shape[:-1])
    for size in range(1, count + 1):
        for support in itertools.combinations(range(count), size):
            picked = list(support)
            part = matrices[..., picked, :][..., :, picked]
            # Closures nearly alike make the system singular; a trace of damping chooses the even split.
            trace = np.trace(part, axis1=-2, axis2=-1)[..., None, None]
            damped = part + (1e-10 * trace + 1e-300) * np.eye(size)
            x = np.linalg.solve(damped, sides[..., picked, None])[..., 0]
            value = -0.5 * (x * sides[..., picked]).sum(-1)
            better = (x >= 0).all(-1) & (value < least)
            least = np.where(better, value, least)
            fresh = np.zeros(sides.shape)
            fresh[..., picked] = x
            best = np.where(better[..., None], fresh, best)
    return best
