"""LightTools' BSDF files (`.bsdf`, `.txt`, text), reflection from the front.

Layout as libbsdf's reader has it: `Symmetry`, `SpectralContent`, `ScatterAzimuth` and `ScatterRadial` with their
lists, then blocks of `AOI`, `POI`, `Side`, `Wavelength`, `ScatterType`, `TristimulusValue`, `TIS`, each followed by
the values of every azimuth and radial angle. Unlike Zemax' of the same words, angles are spherical around the
*normal*, in degrees, and the light lies at azimuth 90. Values are in 1/sr, without the cosine.

No measured file was to be had: reading is tested with files written by that layout.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...directions import spherical
from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import TextFile
from .keywords import MAX_ENTRIES, Words
from .scattered_source import scattered_source
from .zemax import has_keywords

_REMEDY = "export the measurement again as LightTools' BSDF text"
_CHANNELS = {"trisx": "x", "trisy": "y", "trisz": "z"}


@dataclass(frozen=True)
class _Block:
    """One direction of the light: elevation, channel, and values (azimuth, radial)."""

    incidence: float
    channel: str
    values: Array


def read(path: Path) -> LookupSource:
    """Read a LightTools file. Raises BakeError: damaged, anisotropic, without reflection from the front."""
    file = TextFile(path, _REMEDY)
    words = Words.of(file)
    words.expect("Symmetry")
    symmetry = words.choice("the symmetry", {"planesymmetrical": "plane", "asymmetric": "none", "asymmetrical": "none"})
    words.expect("SpectralContent")
    xyz = words.choice("the spectral content", {"monochrome": "", "xyz": "xyz"}) == "xyz"
    words.expect("ScatterAzimuth")
    azimuths = words.angles("azimuths", -180, 360)
    words.expect("ScatterRadial")
    radials = words.angles("radial angles", 0, 180)
    words.expect("DataBegin")
    blocks, aside = [], 0
    while not words.accept("DataEnd"):
        block, used = _block(words, azimuths.size, radials.size)
        blocks += [block] if used else []
        aside += not used
        if (len(blocks) + 1) * azimuths.size * radials.size > MAX_ENTRIES:
            raise file.error("holds more values than any measurement")
    if not blocks:
        raise file.error("holds no reflection from the front")
    wanted = ("x", "y", "z") if xyz else ("",)
    by_light = {
        light: {b.channel: b.values for b in blocks if b.incidence == light}
        for light in sorted({b.incidence for b in blocks})
    }
    for light, channels in by_light.items():
        if set(channels) != set(wanted):
            raise file.error(f"at {light:g} degrees it does not hold each of its channels")
    out = spherical(radials, azimuths[:, None] - np.pi / 2).reshape(-1, 3)
    wi = np.concatenate([np.broadcast_to(spherical(np.radians(light), 0.0), out.shape) for light in by_light])
    wo = np.concatenate([out] * len(by_light))
    values = np.concatenate([np.stack([c[name].reshape(-1) for name in wanted], -1) for c in by_light.values()])
    file.check_values(values)
    facts: dict[str, Any] = {"format": "LightTools", "symmetry": symmetry, "blocks_left_out": aside}
    return scattered_source(file, wi, wo, values, "xyz" if xyz else "grey", facts)


def _block(words: Words, azimuths: int, radials: int) -> tuple[_Block, bool]:
    """The next block, and whether it is reflection from the front."""
    words.expect("AOI")
    incidence = float(words.numbers(1, "angles of incidence")[0])
    front, reflected, channel = True, True, ""
    while words.peek() != "tis":
        keyword = words.take("TIS").lower()
        if keyword == "side":
            front = words.choice("the side", {"front": "f", "back": "b"}) == "f"
        elif keyword == "scattertype":
            reflected = words.choice("the scatter type", {"brdf": "r", "btdf": "t"}) == "r"
        elif keyword == "tristimulusvalue":
            channel = words.choice("the channel", _CHANNELS)
        elif keyword in ("poi", "wavelength"):
            words.take(keyword)
        else:
            words.file.refuse(words.line, f"{keyword[:20]!r} is no keyword of such a file")
    words.expect("TIS")
    words.take("the total scatter")
    values = words.numbers(azimuths * radials, "values").reshape(azimuths, radials)
    return _Block(incidence, channel, values), front and reflected and 0 <= incidence < 90


def _matches(path: Path, head: bytes) -> bool:
    return has_keywords(path, (b"symmetry", b"scatterazimuth", b"scatterradial", b"aoi"))


READER = Reader("LightTools", (".bsdf", ".txt"), _matches, lambda path, reading: read(path))
