"""Weights over the viewer's elevation and azimuth as an image, and back.

The image is (K (n_phi + 2), n_theta, 4): for each closure a block of rows over phi_o, the last row before the first
and the first after the last once more, for a linear filter; columns as in `bake.envelope.texture`. The alpha of the
first block is the residual's share of the light.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..envelope.texture import LEAST_SHARE
from ..errors import BakeError
from ..material_json import require
from ..source import Array
from ..tables.anisotropic_grids import azimuth_index
from .envelope import AnisotropicFit
from .lobes import lobe_from_facts
from .views import ViewerGrid

_NOTHING = 1e-6
_MOST_CLOSURES, _MOST_NODES = 12, 256


def pack_weights(weights: Array, share: Array | None = None) -> NDArray[np.float32]:
    """Of weights (n_theta, n_phi, K, 3), and the share (n_theta, n_phi) where there is a residual."""
    n_theta, n_phi, count = weights.shape[:3]
    image = np.zeros((count, n_phi, n_theta, 4), np.float32)
    image[..., :3] = np.moveaxis(weights, (2, 1, 0), (0, 1, 2))
    if share is not None:
        image[0, ..., 3] = share.T
    return np.pad(image, ((0, 0), (1, 1), (0, 0), (0, 0)), mode="wrap").reshape(-1, n_theta, 4)


def guarded_share(fit: AnisotropicFit) -> NDArray[np.float32]:
    """The residual's share, kept from 0 where there is one and from 1 where E is seen at or beside a node.

    See `bake.envelope.texture.guarded_share`.
    """
    seen = np.pad((fit.weights > 0).any((2, 3)), ((1, 1), (0, 0)))
    beside = seen[:-2] | seen[1:-1] | seen[2:]
    beside |= np.roll(beside, 1, 1) | np.roll(beside, -1, 1)
    low = LEAST_SHARE if fit.share.max() > _NOTHING else 0.0
    return np.clip(fit.share, low, np.where(beside, 1 - LEAST_SHARE, 1.0)).astype(np.float32)


def fit_from_image(facts: Mapping[str, Any], image: Array, where: str | Path) -> AnisotropicFit:
    """What `AnisotropicFit.facts` and `pack_weights` gave, read from an untrusted bundle. Raises BakeError."""
    n_theta, n_phi = (require(facts, key, int, where, 2, _MOST_NODES) for key in ("n_theta", "n_phi"))
    grid = ViewerGrid(n_theta, n_phi, require(facts, "folded", bool, where))
    listed = require(facts, "closures", list, where, 1, _MOST_CLOSURES)
    closures = tuple(lobe_from_facts(entry, where) for entry in listed)
    if np.shape(image) != (len(closures) * (grid.n_phi + 2), grid.n_theta, 4):
        raise BakeError(where, "does not hold the weights of its closures", "bake it again")
    texels = np.asarray(image, np.float32).reshape(len(closures), grid.n_phi + 2, grid.n_theta, 4)[:, 1:-1]
    if not np.isfinite(texels).all() or texels.min() < 0 or texels[0, ..., 3].max() > 1:
        raise BakeError(where, "holds weights below 0 or shares beyond 1", "bake it again")
    weights = np.ascontiguousarray(np.moveaxis(texels[..., :3], (0, 1, 2), (2, 1, 0)))
    known = {"closures", "n_theta", "n_phi", "folded"}
    measured = {key: value for key, value in facts.items() if key not in known}
    return AnisotropicFit(closures, grid, weights, texels[0, ..., 3].T.copy(), measured)


def row_coordinate(xp: Any, grid: ViewerGrid, wo: Any, k: int, count: int) -> Any:
    """Vertical coordinate, 1 on top as Blender counts, of closure `k` of `count` for a viewer."""
    x, y, _ = xp.components(wo)
    row = azimuth_index(xp, x, y, grid.n_phi, grid.folded) + (k * (grid.n_phi + 2) + 1.5)
    return 1 - row * (1 / (count * (grid.n_phi + 2)))
