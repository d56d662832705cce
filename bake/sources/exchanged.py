"""A measurement whose light and viewer change places, or are both."""

from __future__ import annotations

from ..reading import Reciprocity
from ..source import Array, BrdfSource, Facts


class Exchanged:
    """A `BrdfSource` read with light and viewer exchanged, or as the mean of both, which is reciprocal.

    Parameters
    ----------
    how : "exchanged" or "mean"
    """

    def __init__(self, source: BrdfSource, how: Reciprocity) -> None:
        self._source, self._how = source, how
        self.name, self.isotropic, self.bilateral = source.name, source.isotropic, source.bilateral
        self.facts: Facts = {**source.facts, "reciprocity": how}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr; see `BrdfSource.evaluate`."""
        exchanged = self._source.evaluate(wo, wi)
        if self._how == "exchanged":
            return exchanged
        mean: Array = (exchanged + self._source.evaluate(wi, wo)) / 2
        return mean
