"""Integra's detailed reflectance files (`.ddr`, text).

Layout as libbsdf's reader and writer have it: keywords without case, `;;` begins a comment; angles in degrees around
the mirror direction, like Zemax'. The order of values is psi (azimuth of the light), sigma (its elevation), phi,
theta fastest. *Luminance* values are pi times the BRDF; *Intensity* values contain cos(theta_o) and no pi. *Absolute*
ones are multiplied with a factor `kbdf` per light; of *Relative* ones, kbdf is the reflectance that each light's
values are scaled to.

No measured file was to be had: reading is tested with files written by that layout.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...source import Array, Reader
from ..lookup.lookup_source import LookupSource
from ..lookup.text_file import TextFile, beginning
from .keywords import MAX_ENTRIES, Words, to_rgb
from .specular_frame import SpecularGrid, direction_around

_REMEDY = "give a .ddr file of reflection as Integra's programs write it"
_SYMMETRIES = {"planesymmetrical": "plane", "asymmetrical": "none"}
_CHANNELS = {"bw": "grey", "red": "r", "gre": "g", "green": "g", "blu": "b", "blue": "b"}
_LEAST_COS = 0.02


def read(path: Path) -> LookupSource:
    """Read a .ddr file. Raises BakeError: damaged, of a symmetry or colour that is not known."""
    file = TextFile(path, _REMEDY, comment=";;")
    words = Words.of(file)
    if words.accept("Source"):
        words.take("the source")
    words.expect("TypeSym")
    mirrored = words.choice("the symmetry", _SYMMETRIES) == "plane"
    words.accept("4D")
    words.expect("TypeColorModel")
    grey = words.choice("the colour model", {"rgb": "rgb", "bw": "bw"}) == "bw"
    words.expect("TypeData")
    luminance = words.choice("the quantity", {"luminance": "yes", "intensity": ""})
    absolute = words.choice("how values are scaled", {"absolute": "yes", "relative": ""})
    psi = words.angles("azimuths of the light", -360, 720) if words.accept("psi") else np.zeros(1)
    words.expect("sigma")
    sigma = words.angles("elevations of the light", 0, 90)
    if words.accept("sigmat"):
        words.angles("true mirror angles", 0, 180)
    words.expect("phi")
    phi = words.angles("azimuths", -180, 360)
    words.expect("theta")
    theta = words.angles("radial angles", 0, 180)
    shape = psi.size, sigma.size, phi.size, theta.size
    if np.prod(shape, dtype=float) > MAX_ENTRIES:
        raise file.error(f"describes {' x '.join(map(str, shape))} entries, more than any measurement")
    blocks = dict(_block(words, shape) for _ in range(1 if grey else 3))
    wanted = ("grey",) if grey else ("r", "g", "b")
    if set(blocks) != set(wanted):
        raise file.error(f"holds the channels {', '.join(blocks)}, not {', '.join(wanted)}")
    outgoing = direction_around(sigma[:, None, None], theta, phi[:, None])[..., 2]
    channels = []
    for name in wanted:
        values, factor = blocks[name]
        values = values / np.pi if luminance else values / np.maximum(outgoing, _LEAST_COS)
        if not absolute:
            values = values / _reflectance(values, sigma, phi, theta, outgoing, mirrored)[..., None, None]
        channels.append(values * factor[..., None, None])
    table = np.stack(channels, -1)
    file.check_values(table)
    rgb = to_rgb(table) if grey else table
    facts: dict[str, Any] = {
        "format": "Integra DDR",
        "quantity": ("luminance" if luminance else "intensity") + (", absolute" if absolute else ", relative"),
        "colour": not grey,
    }
    return SpecularGrid(psi, sigma, phi, theta, rgb, mirrored).source(file, facts)


def _block(words: Words, shape: tuple[int, int, int, int]) -> tuple[str, tuple[Array, Array]]:
    """Name of a channel, its values (psi, sigma, phi, theta) and its factors (psi, sigma)."""
    name = words.choice("the channel", _CHANNELS)
    factors = np.ones(shape[:2])
    if words.accept("kbdf"):
        factors = words.numbers(shape[0] * shape[1], "factors").reshape(shape[:2])
    words.expect("def")
    values = words.numbers(int(np.prod(shape)), "values").reshape(shape)
    words.expect("enddef")
    return name, (values, factors)


def _reflectance(values: Array, sigma: Array, phi: Array, theta: Array, outgoing: Array, mirrored: bool) -> Array:
    """Directional reflectance of each light (psi, sigma), by trapezoids over the stored angles above the horizon."""
    cosine = np.maximum(outgoing, 0.0) * np.sin(theta)
    inner = (
        np.trapezoid(values * cosine, theta, axis=-1) if hasattr(np, "trapezoid") else np.trapz(values * cosine, theta)
    )
    span = (phi, inner)
    if phi.size == 1:
        total = inner[..., 0] * 2 * np.pi
    else:
        weight = np.zeros(phi.size)
        weight[:-1] += np.diff(phi) / 2
        weight[1:] += np.diff(phi) / 2
        if mirrored:
            weight *= 2
        elif phi[-1] - phi[0] < 2 * np.pi - 1e-6:
            gap = 2 * np.pi - (phi[-1] - phi[0])
            weight[[0, -1]] += gap / 2
        total = (span[1] * weight).sum(-1)
    return np.maximum(total, 1e-12)


def _matches(path: Path, head: bytes) -> bool:
    data = beginning(path).lower()
    return b"typesym" in data and b"typecolormodel" in data


READER = Reader("Integra DDR", (".ddr",), _matches, lambda path, reading: read(path))
