"""An envelope's weights as an image, and the probability of the mirror that follows from it.

The image is (K, n, 4): row k holds the colour of closure k at the nodes, evenly spaced in sqrt(1 - cos theta_o) from
the normal at the left to the horizon at the right; the alpha of row 0 is the residual's share of the light, that of
the others 0. Read it Non-Color, Channel Packed, linear, extended.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..shading.lobes import Lobe
from ..source import Array
from .fit import MOST_NODES, EnvelopeFit

# No part that exists is drawn more rarely than this, so that its weight never grows beyond measure.
LEAST_SHARE = 0.02
_NOTHING = 1e-6  # a residual below this share everywhere is rounding
_MOST_CLOSURES = 12


def pack_weights(fit: EnvelopeFit) -> NDArray[np.float32]:
    """(K, n, 4) float32; its shares are `guarded_share`."""
    image = np.zeros((*fit.weights.shape[1::-1], 4), np.float32)
    image[..., :3] = np.moveaxis(fit.weights, 1, 0)
    image[0, :, 3] = guarded_share(fit)
    return image


def unpack_weights(image: Array, where: str | Path = "envelope") -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Weights (n, K, 3) and the residual's share (n,) of an image that may come from anywhere. Raises BakeError."""
    shape = np.shape(image)
    sizes = len(shape) == 3 and shape[2] == 4 and 1 <= shape[0] <= _MOST_CLOSURES and 4 <= shape[1] <= MOST_NODES
    if not sizes:
        raise BakeError(where, f"is no envelope: its size is {' x '.join(map(str, shape))}", "bake it again")
    texels = np.asarray(image, np.float32)
    if not np.isfinite(texels).all() or texels.min() < 0 or texels[0, :, 3].max() > 1:
        raise BakeError(where, "holds weights below 0 or shares beyond 1", "bake it again")
    return np.moveaxis(texels[..., :3], 0, 1).copy(), texels[0, :, 3].copy()


def fit_from_image(
    closures: tuple[Lobe, ...],
    nodes: int,
    image: Array,
    measured: dict[str, Any],
    where: str | Path = "envelope",
) -> EnvelopeFit:
    """The fit whose weights `pack_weights` made into an image, which may be anybody's. Raises BakeError naming `where`.

    Parameters
    ----------
    closures, nodes, measured : as a bundle's record has them
    """
    weights, share = unpack_weights(image, where)
    if weights.shape[:2] != (nodes, len(closures)):
        held = f"{weights.shape[1]} closures at {weights.shape[0]} nodes"
        raise BakeError(where, f"the image holds {held}, not {len(closures)} at {nodes}", "bake it again")
    return EnvelopeFit(closures, weights, share, measured)


def guarded_share(fit: EnvelopeFit) -> NDArray[np.float32]:
    """The residual's share (n,), kept from 0 where there is a residual and from 1 where E is seen at or beside a node.

    Mirror and closures exclude each other, and the interpolated share is the probability of one of them: were it 0 or
    1 where both carry light, the other's light would be lost.
    """
    share = fit.residual_share
    seen = np.concatenate([[False], (fit.weights > 0).any((1, 2)), [False]])
    beside = seen[:-2] | seen[1:-1] | seen[2:]
    low = LEAST_SHARE if share.max() > _NOTHING else 0.0
    return np.clip(share, low, np.where(beside, 1 - LEAST_SHARE, 1.0)).astype(np.float32)


def texture_coordinate(xp: Any, wo: Any, n: int) -> Any:
    """Horizontal coordinate in [0, 1] at which a linear tap of n texels interpolates between the nodes.

    Parameters
    ----------
    wo : unit vector of the namespace `xp`, to the viewer
    """
    chord = xp.minimum(xp.length(wo - xp.vec(0.0, 0.0, 1.0)) * (1 / np.sqrt(2)), 1.0)
    return chord * ((n - 1) / n) + 0.5 / n


def mirror_probability(xp: Any, share: Any, eagerness: Any = 1.0) -> Any:
    """Probability P of emitting only the mirror, weight R / (pdf P), rather than only the closures over 1 - P.

    P / (1 - P) = eagerness share / (1 - share). The variance of such a choice is least at eagerness = the ratio of the
    relative noise of a mirror sample to that of a closure sample, divided by the root of the ratio of their costs. At 1
    P is the share and every sample is worth the same; at 1 - share P is share / (1 + share).
    """
    wanted = share * eagerness
    return xp.divide(wanted, wanted + (1 - share))
