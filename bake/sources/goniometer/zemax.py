"""Zemax' tabular BSDF (`.bsdf`, text), reflection.

Layout, from Zemax' "BSDF Data Interchange file format specification" and libbsdf's reader: keywords, lists of angles in
degrees, then for every rotation of the sample and every incidence the total integrated scatter and one line per azimuth
with the values of all radial angles, in 1/sr without the cosine. Radial angle and azimuth are polar coordinates around
the *mirror* direction; azimuth 0 points from there to the normal. Three blocks follow each other for CIE XYZ.

The total integrated scatter is not used: in published files it is the integral without the cosine, or half of that.
Rotations of the sample are read as the azimuth of the light's plane, as libbsdf does; the specification measures them
from the plane's normal, which turns the material by 90 degrees. `facts` say so, and the tangent can be turned.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import TextFile, beginning
from .keywords import MAX_ENTRIES, Words, to_rgb
from .specular_frame import SpecularGrid

_REMEDY = "export the measurement again as a Zemax tabular BSDF"
_SYMMETRIES = {"planesymmetrical": "plane", "asymmetrical": "none", "asymmetrical4d": "none"}
_CONTENTS = {"monochrome": ("Monochrome",), "xyz": ("TristimulusX", "TristimulusY", "TristimulusZ")}


def read(path: Path) -> LookupSource:
    """Read a Zemax file. Raises BakeError: damaged, or one of transmission."""
    file = TextFile(path, _REMEDY)
    words = Words.of(file)
    words.expect("Source")
    origin = words.take("the source")
    words.expect("Symmetry")
    symmetry = words.choice("the symmetry", _SYMMETRIES)
    words.expect("SpectralContent")
    blocks = _CONTENTS[words.choice("the spectral content", {name: name for name in _CONTENTS})]
    words.expect("ScatterType")
    if words.choice("the scatter type", {"brdf": "r", "btdf": "t"}) == "t":
        raise file.error("holds transmission", "give the file of the reflection")
    words.expect("SampleRotation")
    rotations = words.angles("rotations of the sample", -360, 720)
    words.expect("AngleOfIncidence")
    incidences = words.angles("angles of incidence", 0, 90)
    words.expect("ScatterAzimuth")
    azimuths = words.angles("azimuths", -180, 360)
    words.expect("ScatterRadial")
    radials = words.angles("radial angles", 0, 180)
    shape = rotations.size, incidences.size, azimuths.size, radials.size
    if np.prod(shape, dtype=float) * len(blocks) > MAX_ENTRIES:
        raise file.error(f"describes {' x '.join(map(str, shape))} entries, more than any measurement")
    channels = np.stack([_block(words, name, shape) for name in blocks], -1)
    file.check_values(channels)
    grid = SpecularGrid(rotations, incidences, azimuths, radials, to_rgb(channels), symmetry == "plane")
    facts: dict[str, Any] = {"format": "Zemax tabular BSDF", "origin": origin[:40], "colour": len(blocks) == 3}
    if rotations.size > 1:
        facts["rotation_read_as"] = "azimuth of the plane of incidence; by the specification 90 degrees further"
    return grid.source(file, facts)


def _block(words: Words, name: str, shape: tuple[int, int, int, int]) -> Array:
    """Values of one channel, (rotation, incidence, azimuth, radial)."""
    words.expect(name)
    words.expect("DataBegin")
    table = np.empty(shape)
    for rotation in range(shape[0]):
        for incidence in range(shape[1]):
            words.expect("TIS")
            words.take("the total scatter")
            table[rotation, incidence] = words.numbers(shape[2] * shape[3], "values").reshape(shape[2:])
    words.expect("DataEnd")
    return table


def _matches(path: Path, head: bytes) -> bool:
    """Comments of any length may come first, hence the longer look."""
    return has_keywords(path, (b"source", b"symmetry", b"spectralcontent", b"angleofincidence"))


def has_keywords(path: Path, wanted: tuple[bytes, ...]) -> bool:
    """Whether lines outside comments begin with all of these words, in lower case, near the file's beginning."""
    data = beginning(path, 1 << 16)
    first = {line.split(None, 1)[0].lower() for line in data.splitlines() if line.strip() and line[:1] != b"#"}
    return all(word in first for word in wanted)


READER = Reader("Zemax BSDF", (".bsdf",), _matches, lambda path, reading: read(path))
