"""ALTA's scattered data (`.dat`, text or binary), as CEA published its retroreflective tapes.

Layout, from ALTA's documentation of data formats and its reader (mkae/alta, MPL-2.0): lines `#KEY value`, among them
`#DIM inputs outputs`, `#PARAM_IN`, `#PARAM_OUT` and `#VS`, then one sample per line, angles in radians. The light of
ISOTROPIC_TL_TV_PROJ_DPHI lies at +x: (theta_light, theta_view cos dphi, theta_view sin dphi), so that a positive
second number is the retro side (both published tapes peak there). Cartesian parameterisations pack the *viewer*
first. Values of INV_STERADIAN_COSINE_FACTOR contain the viewer's cosine and are divided by it. A file that does not
say what its values are is read as a BRDF, and `facts` say so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...directions import normalize, spherical
from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import NamedFile, TextFile, beginning, printable
from .alta_stream import Stream, is_stream
from .scattered_source import Colour, scattered_source

MAX_SAMPLES = 200_000
_REMEDY = "give an ALTA file whose #PARAM_IN is one of the known parameterisations"
# The cosine that a weighted value is divided by at least; nearer to the horizon a measurement says nothing.
_LEAST_COS = 0.02

_Pairs = tuple[Array, Array]


def _projected(x: Array) -> _Pairs:
    theta_v, dphi = np.hypot(x[:, 1], x[:, 2]), np.arctan2(x[:, 2], x[:, 1])
    return spherical(x[:, 0], 0.0), spherical(theta_v, dphi)


def _spherical(x: Array) -> _Pairs:
    return spherical(x[:, 0], x[:, 1]), spherical(x[:, 2], x[:, 3])


def _viewer_first(x: Array) -> _Pairs:
    return spherical(x[:, 1], 0.0), spherical(x[:, 0], x[:, 2])


def _cartesian(x: Array) -> _Pairs:
    return normalize(x[:, 3:6]), normalize(x[:, :3])


PARAMETERISATIONS: dict[str, tuple[int, Callable[[Array], _Pairs]]] = {
    "ISOTROPIC_TL_TV_PROJ_DPHI": (3, _projected),
    "ISOTROPIC_TV_TL_DPHI": (3, _viewer_first),
    "SPHERICAL_TL_PL_TV_PV": (4, _spherical),
    "CARTESIAN": (6, _cartesian),
}
_OUTPUTS: dict[str, tuple[Colour, int]] = {
    "INV_STERADIAN": ("grey", 1),
    "INV_STERADIAN_COSINE_FACTOR": ("grey", 1),
    "RGB_COLOR": ("rgb", 3),
    "XYZ_COLOR": ("xyz", 3),
    "": ("grey", 1),
}


def read(path: Path) -> LookupSource:
    """Read an ALTA file. Raises BakeError: damaged, of an unknown parameterisation or quantity."""
    if is_stream(path):
        stream = Stream(path, _REMEDY)
        return _source(stream, stream.header, stream.rows)
    file = TextFile(path, _REMEDY, comment="")
    header, first = _header(file)
    return _source(file, header, lambda columns: _rows(file, first, columns))


def _source(file: NamedFile, header: dict[str, str], rows: Callable[[int], Array]) -> LookupSource:
    """The samples as a source; `rows` gives as many columns of them as are asked for."""
    name = header.get("PARAM_IN", "").upper()
    if name not in PARAMETERISATIONS:
        raise file.error(f"#PARAM_IN is {name[:40]!r}, not {', '.join(PARAMETERISATIONS)}")
    output = header.get("PARAM_OUT", "").upper()
    if output not in _OUTPUTS:
        raise file.error(f"#PARAM_OUT is {output[:40]!r}, not {', '.join(filter(None, _OUTPUTS))}")
    inputs, pairs = PARAMETERISATIONS[name]
    colour, outputs = _OUTPUTS[output]
    declared = header.get("DIM", f"{inputs} {outputs}").split()
    if declared[:1] != [str(inputs)]:
        raise file.error(f"#DIM says {' '.join(declared)[:20]!r}, {name} has {inputs} numbers")
    if declared[1:2] == ["3"] and not output:
        colour, outputs = "rgb", 3
    table = rows(inputs + outputs)
    wi, wo = pairs(table[:, :inputs])
    values = table[:, inputs : inputs + outputs]
    weighted = output == "INV_STERADIAN_COSINE_FACTOR"
    facts: dict[str, Any] = {
        "format": "ALTA",
        "parameterisation": name,
        "quantity": output or "not stated, read as a BRDF",
        "cosine_divided_out": weighted,
        "comments": [f"{key}: {printable(header[key])}" for key in ("SAMPLE", "ORIGIN") if key in header],
    }
    if weighted:
        keep = wo[:, 2] > _LEAST_COS
        wi, wo, values = wi[keep], wo[keep], values[keep] / wo[keep, 2:]
        facts["samples_too_low"] = int(np.count_nonzero(~keep))
    file.check_values(values)
    return scattered_source(file, wi, wo, values, colour, facts)


def _header(file: TextFile) -> tuple[dict[str, str], int]:
    """The keys, and the index of the first line that is data."""
    header: dict[str, str] = {}
    for index, line in enumerate(file.lines):
        text = line.strip()
        if text.startswith("#"):
            key, _, value = text[1:].partition(" ")
            if key[:1].isalpha():
                header[key.upper()] = value.strip()
            if text.upper().startswith("#ALTA END HEADER"):
                return header, index + 1
        elif text and header:
            return header, index
    raise file.error("holds no samples")


def _rows(file: TextFile, first: int, columns: int) -> Array:
    """(N, columns); what #VS adds behind the values is not used."""
    rows: list[Array] = []
    for number, words, _ in file.split():
        if number <= first or not words or words[0].startswith("#"):
            continue
        if len(words) < columns:
            file.refuse(number, f"{len(words)} numbers, at least {columns} are expected")
        if len(rows) == MAX_SAMPLES:
            file.refuse(number, f"more than {MAX_SAMPLES} samples")
        rows.append(file.numbers(number, words[:columns]))
    if not rows:
        raise file.error("holds no samples")
    return np.stack(rows)


def _matches(path: Path, head: bytes) -> bool:
    return b"#PARAM_IN" in beginning(path) or is_stream(path)


READER = Reader("ALTA", (".dat", ".alta"), _matches, lambda path, reading: read(path))
