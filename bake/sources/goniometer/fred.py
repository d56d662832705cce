"""FRED's tabular BSDF (text): `type bsdf_data`, `format angles=deg bsdf=value scale=1`.

A line of two numbers is a direction of incidence, the lines of three numbers behind it are theta, phi and the BRDF in
1/sr, without the cosine. Angles are around the normal, and the mirror direction lies at the *same* theta and phi as the
line of incidence (seen in the files of ua-loft/bsdf-tools, whose peaks are there): phi of the light is that of the
incidence plus 180 degrees.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...directions import spherical
from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import TextFile
from .scattered_source import scattered_source

_REMEDY = "export the measurement again as FRED's tabular scatter data"
MAX_SAMPLES = 1 << 20


def read(path: Path) -> LookupSource:
    """Read a FRED file. Raises BakeError: damaged, of other units than degrees or radians, too few directions."""
    file = TextFile(path, _REMEDY)
    unit, scale, sets = np.pi / 180, 1.0, list[tuple[Array, list[Array]]]()
    for number, words, _ in file.split(","):
        if not words or words[0].lower() == "type":
            continue
        if words[0].lower() == "format":
            unit, scale = _format(file, number, words[1:])
        elif len(words) == 2:
            sets.append((file.numbers(number, words) * unit, []))
        elif len(words) == 3 and sets:
            sets[-1][1].append(file.numbers(number, words))
        else:
            file.refuse(number, "is neither an incidence (2 numbers) nor a sample (3 numbers)")
        if sum(len(rows) for _, rows in sets[-1:]) > MAX_SAMPLES:
            file.refuse(number, f"more than {MAX_SAMPLES} samples")
    if not sets or not all(rows for _, rows in sets):
        raise file.error("has an incidence without samples" if sets else "holds no samples")
    wi, wo, values = [], [], []
    for incidence, rows in sets:
        table = np.stack(rows)
        out = spherical(table[:, 0] * unit, table[:, 1] * unit)
        wi.append(np.broadcast_to(spherical(incidence[0], incidence[1] + np.pi), out.shape))
        wo.append(out)
        values.append(table[:, 2] * scale)
    file.check_values(np.concatenate(values))
    facts: dict[str, Any] = {"format": "FRED tabular BSDF"}
    return scattered_source(
        file, np.concatenate(wi), np.concatenate(wo), np.concatenate(values)[:, None], "grey", facts
    )


def _format(file: TextFile, line: int, words: list[str]) -> tuple[float, float]:
    """Unit of angles in radians, and factor of the values, from `angles=deg bsdf=value scale=1`."""
    said = dict(word.lower().partition("=")[::2] for word in words)
    angles = said.get("angles", "deg")
    if angles not in ("deg", "rad") or said.get("bsdf", "value") != "value":
        file.refuse(line, f"values are stored as {' '.join(words)[:60]!r}, only angles=deg|rad bsdf=value are known")
    scale = file.numbers(line, [said.get("scale", "1")])[0]
    return (np.pi / 180 if angles == "deg" else 1.0), float(scale)


def _matches(path: Path, head: bytes) -> bool:
    return head.lstrip().lower().startswith(b"type bsdf_data")


READER = Reader("FRED", (".txt", ".dat"), _matches, lambda path, reading: read(path))
