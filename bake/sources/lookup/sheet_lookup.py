"""A measured sheet that is looked up: reflection and transmission of both sides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...source import Array
from .lookup_source import CHUNK, LookupSource, above_horizon

Lookup = Callable[[Array, Array], Array]
_OTHER_SIDE = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class SheetLookup(LookupSource):
    """A `SheetSource` of four functions; `lookup` is the front's reflection.

    Each takes directions (n, 3) above the horizon: those below come mirrored in the sheet's plane, x and y being those
    of the front.

    Parameters
    ----------
    through, through_behind : transmission to viewers of the front and to those of the back
    behind : reflection of the back; None where it is black, or not known
    alike : see `SheetSource`
    """

    through: Lookup
    through_behind: Lookup
    behind: Lookup | None = None
    alike: bool = False

    def transmitted(self, wi: Array, wo: Array) -> Array:
        """BTDF in 1/sr; see `SheetSource.transmitted`."""
        to_front = above_horizon(self.through, wi * _OTHER_SIDE, wo, CHUNK)
        return to_front + above_horizon(self.through_behind, wi, wo * _OTHER_SIDE, CHUNK)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        """BRDF of the back in 1/sr; see `SheetSource.reflected_behind`."""
        if self.behind is None:
            return np.zeros((*np.broadcast_shapes(wi.shape[:-1], wo.shape[:-1]), 3))
        return above_horizon(self.behind, wi * _OTHER_SIDE, wo * _OTHER_SIDE, CHUNK)


def exchanged(lookup: Lookup) -> Lookup:
    """The other direction of a transmission by reciprocity: light and viewer change places."""
    return lambda wi, wo: lookup(wo, wi)
