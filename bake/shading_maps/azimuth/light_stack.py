"""What the fit of a map over azimuth needs of photographs: no pixels, but their products with each other.

Every value of the map is a weighted sum of photographs, so that the squared error of any such sum against any
photograph follows from the products alone: trials of weights, ranks and photographs left out cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BLOCK = 1 << 16


@dataclass(frozen=True, eq=False)
class LightStack:
    """Photographs by their lights.

    Attributes
    ----------
    directions : (n, 3) unit vectors to the lights
    averages : (n,) mean radiance
    products : (n, n) means over texels and channels of the product of two photographs
    """

    directions: Array
    averages: Array
    products: Array

    @classmethod
    def of(cls, images: NDArray[np.float32], directions: Array) -> LightStack:
        """Of photographs (n, H, W, 3)."""
        flat = images.reshape(len(images), -1)
        products, sums = np.zeros((len(flat),) * 2), np.zeros(len(flat))
        # Brought near to 1, for squares of what float32 holds may leave it.
        unit = max(float(flat.max()), float(np.finfo(np.float32).tiny))
        for start in range(0, flat.shape[1], _BLOCK):
            block = flat[:, start : start + _BLOCK] * np.float32(1 / unit)
            products += block @ block.T
            sums += block.sum(1, dtype=np.float64)
        return cls(directions, sums * (unit / flat.shape[1]), products * (unit / flat.shape[1] * unit))

    def __len__(self) -> int:
        return len(self.averages)

    def part(self, chosen: NDArray[np.intp]) -> LightStack:
        """Some of the photographs."""
        return LightStack(self.directions[chosen], self.averages[chosen], self.products[np.ix_(chosen, chosen)])

    def errors(self, weights: Array, wanted: NDArray[np.intp], of: NDArray[np.intp]) -> Array:
        """Mean squared difference of sums of the photographs `of`, by weights (m, len(of)), from those `wanted`."""
        signed = np.zeros((len(weights), len(self)))
        signed[:, of] = weights
        signed[np.arange(len(weights)), wanted] -= 1
        found: Array = np.maximum(np.einsum("ij,ij->i", signed @ self.products, signed), 0)
        return found

    def folds(self, most: int = 8) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """(kept, left out): every third light by azimuth, thrice; of few lights each by itself."""
        order = np.argsort(np.arctan2(self.directions[:, 1], self.directions[:, 0]), kind="stable")
        count = min(most, len(self))
        parts = [np.sort(order[k::count]) for k in range(count)]
        return [(np.setdiff1d(order, part), part) for part in parts]


def relative_error(stack: LightStack, errors: Array) -> float:
    """Mean of RMS errors in parts of the photographs' own RMS, given mean squared errors (n,).

    One photograph of a highlight that no other foretells does not outweigh all others.
    """
    own = np.maximum(np.diag(stack.products), 1e-300)
    return float(np.sqrt(errors / own).mean())
