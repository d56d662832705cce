"""A source as tables can hold it, and what had to be changed for that."""

from __future__ import annotations

import numpy as np

from ..errors import BakeError
from ..patches import patches_of
from ..source import Array, BrdfSource

# Beyond this a number is damage; sums of a hundred of them are still float32 numbers.
LARGEST = 1e36


class TreatedSource:
    """A source without negative values, which are set to 0, and if isotropic averaged with its mirror image.

    A `BrdfSource` itself. What is treated is counted at every evaluation; baking states the counts of one fixed set of
    directions.
    """

    def __init__(self, source: BrdfSource) -> None:
        self.source, self.name, self.facts = source, source.name, source.facts
        # An anisotropic material is not its own mirror image, and its table holds both sides.
        self.isotropic = self.bilateral = source.isotropic
        self.patches = patches_of(source)
        self._mirrors = source.isotropic and not source.bilateral
        self._values = self._negative = self._asymmetry = self._total = 0.0

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) >= 0, of an isotropic source symmetric in phi_delta. Raises BakeError as `check_values`."""
        value = self.source.evaluate(wi, wo)
        if self._mirrors:
            # Mirroring both directions in the x-z plane turns phi_delta to -phi_delta for any wo.
            mirror = np.array([1.0, -1.0, 1.0])
            other = self.source.evaluate(wi * mirror, wo * mirror)
            self._asymmetry += float(np.abs(value - other).sum()) / 2
            self._total += float(np.abs(value + other).sum()) / 2
            value = 0.5 * (value + other)
        check_values(value, self.name)
        self._values += value.size
        self._negative += int((value < 0).sum())
        return np.maximum(value, 0)

    def treatment(self) -> dict[str, float]:
        """Share of evaluated values that were negative; if isotropic, relative L1 difference to the mirror image."""
        found = {"negative_share": self._negative / max(self._values, 1.0)}
        if self.isotropic:
            found["asymmetry"] = self._asymmetry / self._total if self._total else 0.0
        return found


def check_values(values: Array, name: str) -> None:
    """Raise BakeError where a source's values are not finite, or no table could hold them."""
    if not values.size or -LARGEST <= values.min() <= values.max() <= LARGEST:
        return
    cause = (
        f"values above {LARGEST:g}, which are too large" if np.isfinite(values).all() else "values that are not finite"
    )
    raise BakeError(name, f"holds {cause}", "check the file")
