"""Fitted closures whose weights depend on the viewer: an envelope, or the closures of mode Preview."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..source import Array, Facts
from .closures import closure_sum
from .viewers import Viewers


@dataclass(frozen=True, eq=False)
class ClosureFit:
    """K native closures and their weights, linear between nodes of viewers.

    Attributes
    ----------
    closures : (K,)
    viewers : the nodes
    weights : (*viewers.shape, K, 3) float32 >= 0
    """

    closures: tuple[Any, ...]
    viewers: Viewers
    weights: NDArray[np.float32]

    def weights_at(self, wo: Array) -> Array:
        """(..., K, 3) for viewers (..., 3)."""
        return self.viewers.interpolated(self.weights, *self.viewers.angles(wo))

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """E / cos(theta_i) in 1/sr, (..., 3), of unit directions that broadcast; 0 on and below the horizon."""
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        return closure_sum(self.closures, self.weights_at(wo), wi, wo)

    def facts(self) -> Facts:
        """JSON-ready; `texture.fit_from_image` reads it back."""
        return {"closures": [lobe.facts() for lobe in self.closures], **self.viewers.facts()}


@dataclass(frozen=True, eq=False)
class EnvelopeFit(ClosureFit):
    """Closures under a measurement.

    Attributes
    ----------
    residual_share : (*viewers.shape) float32 in [0, 1], the part of all light at each node that the residual carries
    measured : what `facts` adds: shares carried and overshoot, on directions not used for the fit
    """

    residual_share: NDArray[np.float32]
    measured: dict[str, Any]

    @classmethod
    def of_nothing(cls, viewers: Viewers, lobe: Any) -> EnvelopeFit:
        """One closure of no weight, which leaves nothing of a source that is black."""
        shares = {"share": 1.0, "share_rgb": [1.0] * 3, "reach": 1.0, "lowered_to": {"mean": 1.0, "least": 1.0}}
        over = {"budget": 0.0, "price": 0.0, "overshoot": 0.0, "overshoot_largest": 0.0, "overshoot_local": 0.0}
        weights, share = np.zeros((*viewers.shape, 1, 3), np.float32), np.zeros(viewers.shape, np.float32)
        return cls((lobe,), viewers, weights, share, {**shares, **over, "by_theta_o_deg": [[0, 1.0]]})

    def facts(self) -> Facts:
        """JSON-ready."""
        return {**super().facts(), **self.measured}


@dataclass(frozen=True, eq=False)
class PreviewFit(ClosureFit):
    """Closures close to a measurement and of its albedo, and the relative error left."""

    error: float

    @classmethod
    def of_nothing(cls, viewers: Viewers, lobe: Any) -> PreviewFit:
        """One closure of no weight: all of a source that is black."""
        return cls((lobe,), viewers, np.zeros((*viewers.shape, 1, 3), np.float32), 0.0)

    def facts(self) -> Facts:
        """JSON-ready."""
        return {**super().facts(), "error": round(self.error, 6)}
