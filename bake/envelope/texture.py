"""Fitted weights as an image, and the probability of the mirror that follows from it.

The image is (K R, n, 4): a block of R rows for each closure, whose columns are its colour at the nodes evenly spaced in
sqrt(1 - cos theta_o) from the normal at the left to the horizon at the right. Of elevations alone a block is one row;
of a grid of viewers its rows go over phi_o, the last before the first and the first after the last once more, for a
linear filter. The alpha of the first block is the residual's share of the light, that of the others 0. Read it
Non-Color, Channel Packed, linear, extended.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Array
from ..tables.grids.anisotropic_grids import azimuth_index
from .fitted import ClosureFit, EnvelopeFit, PreviewFit
from .viewers import ViewerGrid, Viewers

# No part that exists is drawn more rarely than this, so that its weight never grows beyond measure.
LEAST_SHARE = 0.02
_NOTHING = 1e-6  # a residual below this share everywhere is rounding


def pack_weights(fit: ClosureFit) -> NDArray[np.float32]:
    """Image of the weights; the shares of an envelope are `guarded_share`."""
    shape = fit.viewers.shape
    count = len(fit.closures)
    image = np.zeros((count, *shape[::-1], 4), np.float32)
    image[..., :3] = fit.weights.transpose(len(shape), *range(len(shape))[::-1], len(shape) + 1)
    if isinstance(fit, EnvelopeFit):
        image[0, ..., 3] = guarded_share(fit).T
    for axis in fit.viewers.periodic:
        # Axis 0 of the image are the closures, and the viewers' axes come in reverse.
        ends = [(1, 1) if k == len(shape) - axis else (0, 0) for k in range(image.ndim)]
        image = np.pad(image, ends, mode="wrap")
    return image.reshape(-1, shape[0], 4)


def unpack_weights(
    image: Array, viewers: Viewers, count: int, where: str | Path = "envelope"
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Weights (*viewers.shape, count, 3) and the residual's share (*viewers.shape) of an image that may come from
    anywhere. Raises BakeError."""
    shape = viewers.shape
    rows = [n + 2 if axis in viewers.periodic else n for axis, n in enumerate(shape)][:0:-1]
    wanted = int(np.prod([count, *rows])), shape[0], 4
    if np.shape(image) != wanted:
        size = " x ".join(map(str, np.shape(image)))
        cause = f"does not hold the weights of its {count} closures: its size is {size}, not {wanted[0]} x {wanted[1]}"
        raise BakeError(where, cause, "bake it again")
    texels = np.asarray(image, np.float32).reshape(count, *rows, shape[0], 4)
    texels = texels[(slice(None), *(slice(1, -1) for _ in rows))]
    if not np.isfinite(texels).all() or texels.min() < 0 or texels[0, ..., 3].max() > 1:
        raise BakeError(where, "holds weights below 0 or shares beyond 1", "bake it again")
    weights = texels[..., :3].transpose(*range(1, len(shape) + 1)[::-1], 0, len(shape) + 1)
    return np.ascontiguousarray(weights), texels[0, ..., 3].T.copy()


def fit_from_image(
    closures: tuple[Any, ...], viewers: Viewers, image: Array, measured: dict[str, Any], where: str | Path = "envelope"
) -> EnvelopeFit:
    """The fit whose weights `pack_weights` made into an image, which may be anybody's. Raises BakeError naming `where`.

    Parameters
    ----------
    closures, viewers, measured : as the bundle describes them
    """
    return EnvelopeFit(closures, viewers, *unpack_weights(image, viewers, len(closures), where), measured)


def preview_from_image(
    closures: tuple[Any, ...], viewers: Viewers, image: Array, error: float, where: str | Path = "preview"
) -> PreviewFit:
    """The same for mode Preview. Raises BakeError naming `where`."""
    weights, _ = unpack_weights(image, viewers, len(closures), where)
    return PreviewFit(closures, viewers, weights, error)


def guarded_share(fit: EnvelopeFit) -> NDArray[np.float32]:
    """The residual's share (*shape), kept from 0 where there is one and from 1 where E is seen at or beside a node.

    Mirror and closures exclude each other, and the interpolated share is the probability of one of them: were it 0 or
    1 where both carry light, the other's light would be lost.
    """
    share, beside = fit.residual_share, (fit.weights > 0).any((-1, -2))
    for axis, n in enumerate(fit.viewers.shape):
        near = np.arange(n) + np.arange(-1, 2)[:, None]
        near = near % n if axis in fit.viewers.periodic else np.clip(near, 0, n - 1)
        beside = np.take(beside, near, axis).any(axis)
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


def row_coordinate(xp: Any, grid: ViewerGrid, wo: Any, k: int, count: int) -> Any:
    """Vertical coordinate, 1 on top as Blender counts, of closure `k` of `count` for a viewer of a grid."""
    x, y, _ = xp.components(wo)
    row = azimuth_index(xp, x, y, grid.n_phi, grid.folded) + (k * (grid.n_phi + 2) + 1.5)
    return 1 - row * (1 / (count * (grid.n_phi + 2)))


def mirror_probability(xp: Any, share: Any, eagerness: Any = 1.0) -> Any:
    """Probability P of emitting only the mirror, weight R / (pdf P), rather than only the closures over 1 - P.

    P / (1 - P) = eagerness share / (1 - share). The variance of such a choice is least at eagerness = the ratio of the
    relative noise of a mirror sample to that of a closure sample, divided by the root of the ratio of their costs. At 1
    P is the share and every sample is worth the same; at 1 - share P is share / (1 + share).
    """
    wanted = share * eagerness
    return xp.divide(wanted, wanted + (1 - share))
