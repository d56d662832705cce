"""A measurement whose light and viewer change places, or are both."""

from __future__ import annotations

from collections.abc import Callable

from ..patches import patches_of
from ..reading import Reciprocity
from ..source import Array, BrdfSource, Facts, SheetSource


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
        self.patches = patches_of(source)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr; see `BrdfSource.evaluate`."""
        return self._read(self._source.evaluate, wi, wo)

    def _read(self, values: Callable[[Array, Array], Array], wi: Array, wo: Array) -> Array:
        exchanged = values(wo, wi)
        if self._how == "exchanged":
            return exchanged
        mean: Array = (exchanged + values(wi, wo)) / 2
        return mean


class ExchangedSheet(Exchanged):
    """The same of a sheet, light and viewer of whose transmission change sides."""

    def __init__(self, source: SheetSource, how: Reciprocity) -> None:
        super().__init__(source, how)
        self._sheet, self.alike = source, source.alike

    def transmitted(self, wi: Array, wo: Array) -> Array:
        """BTDF in 1/sr; see `SheetSource.transmitted`."""
        return self._read(self._sheet.transmitted, wi, wo)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        """BRDF of the back in 1/sr; see `SheetSource.reflected_behind`."""
        return self._read(self._sheet.reflected_behind, wi, wo)


def exchanged_source(source: BrdfSource, how: Reciprocity) -> BrdfSource:
    """A source read so; a sheet stays one."""
    return ExchangedSheet(source, how) if isinstance(source, SheetSource) else Exchanged(source, how)
