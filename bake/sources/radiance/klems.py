"""Matrices over Klems' directions (1994, "A New Method for Predicting the Solar Heat Gain of Complex Fenestration
Systems"), addressed as Radiance's library does.

The hemisphere is divided into rings of theta and each into equal azimuths, the first of them centred on phi = 0. An
incident bin is named by the direction in which the light *travels*, so the matrix' diagonal is the mirror direction.
Rows are outgoing and columns incident bins where the structure is `Columns`, the other way about where it is `Rows`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...directions import polar_angle
from ...errors import BakeError
from ...source import Array
from ..lookup.lookup_source import azimuth_of, negative_facts
from ..lookup.text_file import LARGEST_VALUE, printable

_REMEDY = "give a file over LBNL/Klems Full, Half or Quarter"


@dataclass(frozen=True)
class Basis:
    """Upper bounds of the rings in degrees, and the number of azimuths in each."""

    bounds: tuple[float, ...]
    azimuths: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of bins."""
        return sum(self.azimuths)

    def bins(self, direction: Array) -> Array:
        """Index of the bin of directions (n, 3) above the horizon."""
        ring = np.searchsorted(np.radians(self.bounds[:-1]), polar_angle(direction), side="right")
        number = np.array(self.azimuths)[ring]
        turn = np.floor(azimuth_of(direction) / (2 * np.pi) * number + 0.5).astype(np.intp) % number
        first = np.concatenate([[0], np.cumsum(self.azimuths)[:-1]])
        bins: Array = first[ring] + turn
        return bins


# Radiance's own list: it goes by the name of a basis, whatever the file says of its rings.
BASES = {
    "klems full": Basis((5, 15, 25, 35, 45, 55, 65, 75, 90), (1, 8, 16, 20, 24, 24, 24, 16, 12)),
    "klems half": Basis((6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90), (1, 8, 12, 16, 20, 12, 4)),
    "klems quarter": Basis((9, 27, 46, 66, 90), (1, 8, 12, 12, 8)),
}


def klems_lookup(
    path: Path, structure: str, block: ElementTree.Element
) -> tuple[Callable[[Array, Array], Array], dict[str, Any]]:
    """The values of a block, as a function of (wi, wo), (n, 3) each, to (n,), and facts. Raises BakeError."""
    incident = _basis(path, block.findtext("ColumnAngleBasis"))
    outgoing = _basis(path, block.findtext("RowAngleBasis"))
    if structure == "rows":
        incident, outgoing = outgoing, incident
    matrix = _matrix(path, block.findtext("ScatteringData") or "", outgoing.count * incident.count)
    if structure == "rows":
        table = matrix.reshape(incident.count, outgoing.count).T
    else:
        table = matrix.reshape(outgoing.count, incident.count)
    told = negative_facts(table)
    table = np.maximum(table, 0)

    def lookup(wi: Array, wo: Array) -> Array:
        # The light travels against wi: its azimuth is the source's half a turn further.
        travel = wi * np.array([-1.0, -1.0, 1.0])
        values: Array = table[outgoing.bins(wo), incident.bins(travel)]
        return values

    return lookup, {"entries": list(table.shape), **told}


def _basis(path: Path, name: str | None) -> Basis:
    words = (name or "").strip().lower().removeprefix("lbnl/")
    if words not in BASES:
        raise BakeError(path, f"uses the directions {printable(name or '', 40)!r}", _REMEDY)
    return BASES[words]


def _matrix(path: Path, text: str, count: int) -> Array:
    try:
        values = np.array(text.replace(",", " ").split(), dtype=np.float64)
    except ValueError as error:
        raise BakeError(path, f"a block holds what is no number ({printable(str(error), 60)})", _REMEDY) from error
    if values.size != count:
        raise BakeError(path, f"a block holds {values.size} numbers instead of {count}", _REMEDY)
    if not np.isfinite(values).all() or np.abs(values).max() > LARGEST_VALUE:
        raise BakeError(path, f"a block holds numbers that are not finite or exceed {LARGEST_VALUE:g} 1/sr", _REMEDY)
    return values
