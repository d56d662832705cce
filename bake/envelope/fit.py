"""An envelope E under a measured f cos: a sum of native closures whose weights depend on theta_o (DESIGN.md section 5).

    f cos(theta_i) = E + R,   E = sum_k w_k(theta_o) c_k,   w >= 0,   R = max(f cos - E, 0).

The weights are linear between nodes evenly spaced in the chord v = sqrt(1 - cos theta_o). Each node's weights solve a
linear programme; then E is verified on a denser set of viewers and lights, between the nodes too, and lowered where it
is too high. That costs 0.5 % of the energy where the budget is 0.1 % (binding each programme half-way to its neighbours
as well was tried: it lowers less afterwards, carries no more and takes three times as long).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..shading.lobes import Lobe
from ..source import Array, BrdfSource
from ..tables.treated_source import TreatedSource
from .choice import Choice, choose
from .closures import BASIS, check_basis, closure_sum, closure_values
from .linear_program import solve
from .verification import lowered, measured, residual_shares
from .views import Views, chord_of, interpolated, sample_views

Progress = Callable[[float], None]

_N_H, _N_PHI = 40, 20
_TOLERANCE = 1e-7
_PLANNED = 0.8  # part of the budget that is spent; what falls between the directions takes up to the rest
_DARK = 1e-9  # of the largest albedo: what reflects less is black
MOST_NODES = 1024


@dataclass(frozen=True)
class EnvelopeSettings:
    """How close and how rich an envelope is to be.

    Parameters
    ----------
    budget : the most that E may exceed f cos by, integrated, as a share of the energy at each theta_o and channel. A
        stated bias: measurements are noisy, and an envelope under every dip of the noise carries little
    price : what each unit of that must buy in energy carried, or it is not spent
    most : closures
    enough : share of what the whole basis carries that ends the choice earlier
    nodes : in theta_o
    basis : closures to choose from
    """

    budget: float = 1e-3
    price: float = 10.0
    most: int = 3
    enough: float = 0.97
    nodes: int = 64
    basis: tuple[Lobe, ...] = BASIS

    def __post_init__(self) -> None:
        _check("budget", self.budget, 0, 0.1)
        _check("price", self.price, 0, 1e6)
        _check("closures", self.most, 1, 12, whole=True)
        _check("share of the basis", self.enough, 0.01, 1)
        _check("nodes", self.nodes, 4, MOST_NODES, whole=True)
        check_basis(self.basis)


def _check(name: str, value: Any, low: float, high: float, whole: bool = False) -> None:
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
        kind = "a whole number" if whole else "a number"
        raise BakeError(f"envelope {name}", f"cannot be {value!r}", f"give {kind} from {low:g} to {high:g}")


@dataclass(frozen=True, eq=False)
class EnvelopeFit:
    """A fitted envelope.

    Attributes
    ----------
    closures : K native closures
    weights : (n, K, 3) float32 >= 0 at the chords i / (n - 1), linear between them
    residual_share : (n,) float32 in [0, 1], the part of all light at each node that the residual carries
    measured : what `facts` adds to the closures: shares carried and overshoot, on directions not used for the fit
    """

    closures: tuple[Lobe, ...]
    weights: NDArray[np.float32]
    residual_share: NDArray[np.float32]
    measured: dict[str, Any]

    def weights_at(self, chords: Array) -> Array:
        """(..., K, 3) at chords sqrt(1 - cos theta_o) in [0, 1]."""
        return interpolated(self.weights, chords)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """E / cos(theta_i) in 1/sr, (..., 3), of unit directions that broadcast; 0 on and below the horizon."""
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        return closure_sum(self.closures, self.weights_at(chord_of(wo)), wi, wo)

    def facts(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "closures": [lobe.facts() for lobe in self.closures],
            "nodes": len(self.weights),
            **self.measured,
        }


def fit_envelope(
    source: BrdfSource | TreatedSource, settings: EnvelopeSettings | None = None, progress: Progress | None = None
) -> EnvelopeFit:
    """Choose closures and fit their weights; `progress` is called with the share done.

    A source's negative values count as 0, and one that is not symmetric in phi_delta is averaged with its mirror
    image, as in its table.

    Raises
    ------
    BakeError : a setting out of range, or a source that is anisotropic, black or not finite
    """
    settings = settings or EnvelopeSettings()
    say = progress or (lambda share: None)
    treated = source if isinstance(source, TreatedSource) else TreatedSource(source)
    if not treated.source.isotropic:
        raise BakeError(treated.name, "is anisotropic, and this envelope is isotropic", "fit an isotropic material")
    views = sample_views(treated, np.linspace(0, 1, settings.nodes), _N_H, _N_PHI)
    if not views.values.any():
        raise BakeError(treated.name, "reflects nothing", "check the file")
    say(0.1)
    choice = choose(
        treated,
        settings.basis,
        settings.most,
        settings.enough,
        _PLANNED * settings.budget,
        settings.price,
        lambda share: say(0.1 + 0.5 * share),
    )
    weights = node_weights(views, choice.closures, _PLANNED * settings.budget, settings.price)
    say(0.75)
    return _verified(treated, choice, weights, settings, say)


def node_weights(views: Views, closures: Sequence[Lobe], budget: float, price: float) -> Array:
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


def _verified(
    source: TreatedSource, choice: Choice, weights: Array, settings: EnvelopeSettings, say: Progress
) -> EnvelopeFit:
    weights, factor = lowered(source, choice.closures, weights, _PLANNED * settings.budget)
    say(0.9)
    # Noise can leave a closure nothing at all.
    used = weights.any((0, 2))
    used[0] |= not used.any()
    closures = tuple(lobe for lobe, kept in zip(choice.closures, used) if kept)
    stored = _rounded_down(weights[:, used])
    measures = measured(source, closures, stored)
    share = residual_shares(source, closures, stored)
    facts = {
        "budget": float(settings.budget),
        "price": float(settings.price),
        "reach": round(choice.reach, 6),
        "lowered_to": {"mean": round(float(factor.mean()), 6), "least": round(float(factor.min()), 6)},
        **measures,
    }
    say(1.0)
    return EnvelopeFit(closures, stored, share.astype(np.float32), facts)


def _rounded_down(weights: Array) -> NDArray[np.float32]:
    """float32 that is nowhere above float64."""
    stored = weights.astype(np.float32)
    return np.where(stored > weights, np.nextafter(stored, np.float32(0)), stored)
