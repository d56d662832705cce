"""A bidirectional texture function: pictures of a swatch for every view and light, between them, and compressed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from measured_materials.bake.images.bilinear import texels_around
from numpy.typing import NDArray

from .rings import Array, Rings

# Of a number as it would be stored: half floats.
_BYTES = 2


@dataclass(frozen=True, eq=False)
class Btf:
    """Rectified pictures: a texel is the same place of the swatch in all of them, which repeats, row 0 on top.

    pictures : (V, L, H, W, 3) float32, f_r cos(theta_i) in 1/sr
    views, lights : their V and L directions
    bytes : of what is stored
    """

    pictures: NDArray[np.float32]
    views: Rings
    lights: Rings
    bytes: int

    def __post_init__(self) -> None:
        if self.pictures.shape[:2] != (len(self.views.angles), len(self.lights.angles)):
            raise ValueError(f"pictures {self.pictures.shape} of these directions")

    def at(self, uv: Array, wi: Array, wo: Array) -> Array:
        """f_r cos(theta_i) (..., 3), between texels and directions; below the last ring of lights by the cosine.

        Parameters
        ----------
        uv : (..., 2), v upwards; the swatch covers [0, 1]
        wi, wo : (..., 3), or one for all
        """
        wi, wo = np.broadcast_to(wi, (*uv.shape[:-1], 3)), np.broadcast_to(wo, (*uv.shape[:-1], 3))
        texels = texels_around(self.pictures.shape[2:4], uv)
        total = np.zeros((*uv.shape[:-1], 3))
        for view, seen in self.views.around(wo):
            for light, lit in self.lights.around(wi):
                for texel, weight in texels:
                    total += (seen * lit * weight)[..., None] * self.pictures[(view, light, *texel)]
        return total * np.clip(wi[..., 2:] / np.cos(self.lights.steepest), 0, 1)


def whole(pictures: NDArray[np.float32], views: Rings, lights: Rings) -> Btf:
    """All that was photographed, as it is."""
    return Btf(pictures, views, lights, _BYTES * pictures.size)


def compressed(btf: Btf, components: int = 16, *, per_view: bool = False) -> Btf:
    """The pictures as sums of so many eigen-textures, by truncated singular values (Eckart & Young 1936).

    Stored are the eigen-textures and their weights in every picture, as half floats.

    Parameters
    ----------
    per_view : for each view by itself, as Sattler et al. 2003 do, and not for the matrix of texels by all pictures, as
        Koudelka et al. 2003
    """
    pictures = btf.pictures
    texels = int(np.prod(pictures.shape[2:]))
    matrices = pictures.reshape(len(pictures) if per_view else 1, -1, texels)
    count = min(components, matrices.shape[1])
    kept = np.stack([_truncated(matrix, count) for matrix in matrices])
    stored = _BYTES * len(matrices) * count * (texels + matrices.shape[1])
    return replace(btf, pictures=np.maximum(kept, 0).reshape(pictures.shape), bytes=stored)


def _truncated(matrix: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Nearest matrix of this rank in the mean square; of (pictures, texels), far more texels than pictures."""
    products = matrix.astype(np.float64) @ matrix.astype(np.float64).T
    weights = np.linalg.eigh(products)[1][:, -count:].astype(np.float32)
    return weights @ (weights.T @ matrix)
