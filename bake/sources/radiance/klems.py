"""Matrices over Klems' patches of the hemisphere (`bake.patches`), addressed as Radiance's library does.

An incident bin is named by the direction in which the light *travels*, so the matrix' diagonal is the mirror direction.
Rows are outgoing and columns incident bins where the structure is `Columns`, the other way about where it is `Rows`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import BakeError
from ...patches import KLEMS
from ...source import Array
from ..lookup.lookup_source import negative_facts
from ..lookup.text_file import LARGEST_VALUE, printable

_REMEDY = "give a file over LBNL/Klems Full, Half or Quarter"


def klems_lookup(
    path: Path, structure: str, block: ElementTree.Element
) -> tuple[Callable[[Array, Array], Array], dict[str, Any]]:
    """The values of a block, as a function of (wi, wo), (n, 3) each, to (n,), and facts. Raises BakeError."""
    names = [_basis(path, block.findtext(f"{part}AngleBasis")) for part in ("Column", "Row")]
    incident, outgoing = (KLEMS[name] for name in names)
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

    return lookup, {"entries": list(table.shape), "patches": " by ".join(dict.fromkeys(names)), **told}


def _basis(path: Path, name: str | None) -> str:
    """Name of the patches in `bake.patches.KLEMS`. Raises BakeError."""
    words = (name or "").strip().lower().removeprefix("lbnl/")
    if words not in KLEMS:
        raise BakeError(path, f"uses the directions {printable(name or '', 40)!r}", _REMEDY)
    return words


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
