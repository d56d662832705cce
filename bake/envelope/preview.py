"""A measured BRDF as native closures alone: close to it rather than under it, for mode Preview.

    f cos(theta_i) ~ E = sum_k w_k(viewer) c_k,   w >= 0,   and the albedo of E is the measured one for every viewer.

The weights minimise the squared difference in parts of f cos + what a Lambertian surface of the same albedo reflects: a
plain difference would see the highlight and nothing else. They are linear between nodes of viewers, as an envelope's.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ..errors import BakeError
from ..source import Array
from .closures import Closure, closure_values
from .fitted import ClosureFit, PreviewFit
from .verification import parts_of
from .viewers import Elevations, Source, Viewers
from .views import Views, gauss_chords

_MOST = 3
_NODES = Elevations(32)
_GAIN = 0.97  # of the error with one closure less: above it, the further closure is not worth its nodes


def fit_preview(
    source: Source, viewers: Viewers = _NODES, closures: Sequence[Closure] | None = None, most: int = _MOST
) -> PreviewFit:
    """Choose at most `most` closures that go with the viewers, or take those given, and fit their weights.

    The error of closures that were chosen is that of their best weights for the viewers that chose; the error of those
    given is `preview_error`.

    Raises
    ------
    BakeError : the source is black, not finite, or anisotropic while the viewers are elevations alone
    """
    treated, effort = viewers.treated(source), viewers.effort
    error = None
    if closures is None:
        chords, phi, importance = viewers.chosen_from()
        views = viewers.views(treated, chords, phi, effort.preview)
        closures, error = _chosen(views, viewers.basis, importance, most)
    chords, phi = viewers.nodes()
    found, black = [], True
    for part in parts_of(len(chords)):
        views = viewers.views(treated, chords[part], phi[part], effort.preview)
        black = black and not views.values.any()
        found.append(albedo_weights(views, closures))
    if black:
        raise BakeError(treated.name, "reflects nothing", "check the file")
    weights = np.concatenate(found).reshape(*viewers.shape, len(closures), 3).astype(np.float32)
    fit = PreviewFit(tuple(closures), viewers, weights, 0.0 if error is None else error)
    return fit if error is not None else PreviewFit(fit.closures, viewers, weights, preview_error(treated, fit))


def preview_error(source: Source, fit: ClosureFit) -> float:
    """Error of weights in parts of the source, by the measure that they minimise, at viewers and directions of no fit.

    It is 0 of weights that are the source, and 1 of none.
    """
    viewers = fit.viewers
    elevations, importance = gauss_chords(viewers.effort.measured)
    azimuths = viewers.azimuths()
    count = len(azimuths)
    chords, phi = np.repeat(elevations, count), np.tile(azimuths, len(elevations))
    views = viewers.views(source, chords, phi, viewers.effort.independent)
    matrices, sides, squares = normal_equations(views, fit.closures, views.values.sum(-1, keepdims=True))
    weights = viewers.interpolated(fit.weights, chords, phi).sum(-1)
    left = squares[:, 0] - 2 * (weights * sides[..., 0]).sum(-1) + np.einsum("vk,vkl,vl->v", weights, matrices, weights)
    shares = np.divide(left, squares[:, 0], out=np.zeros(len(left)), where=squares[:, 0] > 0)
    return float(np.sqrt(max(np.repeat(importance, count) @ shares, 0) / (count * importance.sum())))


def normal_equations(views: Views, closures: Sequence[Closure], values: Array) -> tuple[Array, Array, Array]:
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


def _chosen(views: Views, basis: Sequence[Closure], importance: Array, most: int) -> tuple[tuple[Closure, ...], float]:
    """The closures of least error among all sets of one, then two ... as long as one more pays; and the error."""
    values = views.values.sum(-1, keepdims=True)
    if not values.any():
        return tuple(basis[:1]), 0.0
    matrices, sides, squares = normal_equations(views, basis, values)
    worth = importance * np.divide(1.0, squares[:, 0], out=np.zeros(len(squares)), where=squares[:, 0] > 0)
    found: tuple[tuple[int, ...], float] = ((0,), np.inf)
    for count in range(1, most + 1):
        sets = np.array(list(itertools.combinations(range(len(basis)), count)))
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
    return tuple(basis[i] for i in found[0]), found[1]


def albedo_weights(views: Views, closures: Sequence[Closure]) -> Array:
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
