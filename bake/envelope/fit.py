"""An envelope E under a measured f cos: a sum of native closures whose weights depend on the viewer.

    f cos(theta_i) = E + R,   E = sum_k w_k(viewer) c_k,   w >= 0,   R = max(f cos - E, 0).

The viewer is theta_o, or (theta_o, phi_o) for anisotropic materials; weights are linear between nodes (`viewers`). Each
node's weights solve a linear programme; then E is verified on a denser set of viewers and lights, between the nodes
too, and lowered where it is too high. That costs 0.5 % of the energy where the budget is 0.1 % (binding each programme
half-way to its neighbours as well was tried: it lowers less afterwards, carries no more and takes three times as long).

Anisotropic closures lie along the tangent, as brushing does; a material whose axes are turned from it is carried less
well, and its residual takes the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Array
from .choice import Choice, choose
from .closures import Closure, check_basis, closure_values
from .fitted import EnvelopeFit
from .linear_program import solve
from .verification import lowered, measured, parts_of, residual_shares
from .viewers import Elevations, Source, Viewers
from .views import Views

Progress = Callable[[float], None]

_TOLERANCE = 1e-7
_PLANNED = 0.8  # part of the budget that is spent; what falls between the directions takes up to the rest
_DARK = 1e-9  # of the largest albedo: what reflects less is black


@dataclass(frozen=True)
class EnvelopeSettings:
    """Settings of an envelope: how close and how rich it is to be.

    Parameters
    ----------
    budget : the most that E may exceed f cos by, integrated, as a share of the energy of each viewer and channel. A
        stated bias: measurements are noisy, and an envelope under every dip of the noise carries little
    price : what each unit of that must buy in energy carried, or it is not spent
    most : closures
    enough : share of what the whole basis carries, or of all light, that ends the choice earlier
    viewers : nodes of the weights; a `ViewerGrid` for an anisotropic source
    basis : closures to choose from, by default those that go with the viewers
    """

    budget: float = 1e-3
    price: float = 10.0
    most: int = 3
    enough: float = 0.97
    viewers: Viewers = field(default_factory=Elevations)
    basis: tuple[Closure, ...] | None = None

    def __post_init__(self) -> None:
        _check("budget", self.budget, 0, 0.1)
        _check("price", self.price, 0, 1e6)
        _check("closures", self.most, 1, 12, whole=True)
        _check("share of the basis", self.enough, 0.01, 1)
        check_basis(self.closures)

    @property
    def closures(self) -> Sequence[Closure]:
        """Those to choose from."""
        return self.viewers.basis if self.basis is None else self.basis


def _check(name: str, value: Any, low: float, high: float, whole: bool = False) -> None:
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
        kind = "a whole number" if whole else "a number"
        raise BakeError(f"envelope {name}", f"cannot be {value!r}", f"give {kind} from {low:g} to {high:g}")


def fit_envelope(
    source: Source, settings: EnvelopeSettings | None = None, progress: Progress | None = None
) -> EnvelopeFit:
    """Choose closures and fit their weights; `progress` is called with the share done.

    For elevations alone a source's negative values count as 0, and one that is not symmetric in phi_delta is averaged
    with its mirror image, as in its table. For a grid of viewers the source must not be negative.

    Raises
    ------
    BakeError : a source that is black, not finite, or anisotropic while the viewers are elevations alone
    """
    settings = settings or EnvelopeSettings()
    say = progress or (lambda share: None)
    viewers, planned = settings.viewers, _PLANNED * settings.budget
    treated = viewers.treated(source)
    choice = choose(
        treated,
        viewers,
        settings.closures,
        settings.most,
        settings.enough,
        planned,
        settings.price,
        lambda share: say(0.5 * share),
    )
    say(0.5)
    chords, phi = viewers.nodes()
    found = [
        node_weights(
            viewers.views(treated, chords[p], phi[p], viewers.effort.fit), choice.closures, planned, settings.price
        )
        for p in parts_of(len(chords))
    ]
    say(0.7)
    weights = np.concatenate(found).reshape(*viewers.shape, len(choice.closures), 3)
    return _verified(treated, choice, weights, settings, say)


def node_weights(views: Views, closures: Sequence[Closure], budget: float, price: float) -> Array:
    """Weights (V, K, 3) of the best envelope at each view by itself; 0 where a channel is black."""
    energy = views.energy
    lit = energy > _DARK * energy.max()
    unit = np.where(lit, energy, 1.0)
    values = closure_values(closures, views.wi, views.wo)
    gains = np.einsum("vp,vpk->vk", views.areas, values)
    weights = np.empty((len(energy), len(closures), 3))
    for c in range(3):
        scale = unit[:, c, None]
        worth = np.where(lit[:, c, None], gains / scale, 0)
        bounds = views.values[..., c] / scale
        found = solve(values / scale[..., None], bounds, views.areas, worth, budget, price, _TOLERANCE)
        weights[..., c] = found.weights
    return weights


def _verified(source: Source, choice: Choice, weights: Array, settings: EnvelopeSettings, say: Progress) -> EnvelopeFit:
    viewers = settings.viewers
    weights, factor = lowered(source, choice.closures, viewers, weights, _PLANNED * settings.budget)
    say(0.85)
    # Noise can leave a closure nothing at all.
    used = np.moveaxis(weights, -2, 0).reshape(len(choice.closures), -1).any(1)
    used[0] |= not used.any()
    closures = tuple(lobe for lobe, kept in zip(choice.closures, used) if kept)
    stored = _rounded_down(weights[..., used, :])
    measures = measured(source, closures, viewers, stored)
    share = residual_shares(source, closures, viewers, stored)
    facts = {
        "budget": float(settings.budget),
        "price": float(settings.price),
        "reach": round(choice.reach, 6),
        "lowered_to": {"mean": round(float(factor.mean()), 6), "least": round(float(factor.min()), 6)},
        **measures,
    }
    say(1.0)
    return EnvelopeFit(closures, viewers, stored, share.astype(np.float32), facts)


def _rounded_down(weights: Array) -> NDArray[np.float32]:
    """float32 that is nowhere above float64."""
    stored = weights.astype(np.float32)
    return np.where(stored > weights, np.nextafter(stored, np.float32(0)), stored)
