"""Archives of the University of Bonn: UBO2003 (Sattler, Sarlette & Klein 2003), a zip of rectified JPEGs.

A picture's name ends in its directions in whole degrees, light before view, polar angle before azimuth:
`tl015 pl060 tv030 pv090.jpg`. The package btf-extractor 1.7.0 reads them so too; for Python 3.11 it has no wheel, nor
has the numpy below 1.20 that its build asks for.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections import defaultdict
from pathlib import Path

import numpy as np
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs.radiometry.response import SRGB
from PIL import Image, UnidentifiedImageError

from .btf import Btf, whole
from .rings import Rings

_NAME = re.compile(r"tl(\d{3}) pl(\d{3}) tv(\d{3}) pv(\d{3})\.jpg$")
# Azimuths are written in whole degrees.
_ROUNDED = 0.51
# What zipfile and PIL raise for files that are damaged, encrypted or hostile.
_SPOILED = (
    zipfile.BadZipFile,
    zlib.error,
    RuntimeError,
    NotImplementedError,
    UnidentifiedImageError,
    Image.DecompressionBombError,
)
# A JPEG's header tells its size before it is decoded.
_LARGEST_EDGE = 4096


def read_ubo2003(path: Path, edge: int = 64) -> Btf:
    """The middle of every picture, `edge` texels wide and high, its sRGB made linear.

    Its scale is unknown, as are exposures; the swatch does not repeat.

    Raises
    ------
    BakeError : no such archive, directions that are no rings or without a picture, or pictures of different sizes
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(path, archive, edge)
    except (OSError, *_SPOILED) as error:
        raise BakeError(path, f"is no archive of UBO2003 ({error})", "give its zip of JPEGs") from error


def _read(path: Path, archive: zipfile.ZipFile, edge: int) -> Btf:
    files = {}
    for name in archive.namelist():
        if found := _NAME.search(name):
            light, view = (int(found[1]), int(found[2])), (int(found[3]), int(found[4]))
            if (view, light) in files:
                raise BakeError(path, f"has {name} twice", "keep one of them")
            files[view, light] = name
    if not files:
        raise BakeError(path, "holds no picture named as in UBO2003", "name them tl000 pl000 tv000 pv000.jpg")
    (views, seen), (lights, lit) = (_rings(path, {pair[k] for pair in files}) for k in (0, 1))
    pictures = np.empty((len(views.angles), len(lights.angles), edge, edge, 3), np.float32)
    for k, view in enumerate(seen):
        for j, light in enumerate(lit):
            pair = view, light
            if pair not in files:
                raise BakeError(path, f"has no picture of view {pair[0]} under light {pair[1]}", "give all pairs")
            pictures[k, j] = _middle(path, archive, files[pair], edge)
    return whole(pictures, views, lights)


def _rings(path: Path, angles: set[tuple[int, int]]) -> tuple[Rings, list[tuple[int, int]]]:
    """Of whole degrees, azimuths of a ring at equal steps from 0; and the directions in their order, as read."""
    by_theta = defaultdict(list)
    for theta, phi in sorted(angles):
        by_theta[theta].append(phi)
    for theta, phis in by_theta.items():
        even = np.arange(len(phis)) * 360 / len(phis)
        if np.abs(np.array(phis) - even).max() > _ROUNDED:
            cause = f"has directions at {theta} degrees that are not evenly around the normal"
            raise BakeError(path, cause, "give a whole archive")
    try:
        rings = Rings(tuple((float(theta), len(phis)) for theta, phis in by_theta.items()))
    except ValueError as error:
        cause = f"has directions that do not form rings about the normal ({error})"
        raise BakeError(path, cause, "give a whole archive") from error
    return rings, sorted(angles)


def _middle(path: Path, archive: zipfile.ZipFile, name: str, edge: int) -> np.ndarray:
    with archive.open(name) as stream, Image.open(stream) as opened:
        if not edge <= min(opened.size) <= max(opened.size) <= _LARGEST_EDGE:
            cause = f"has {name} of {opened.size[0]} x {opened.size[1]} pixels"
            raise BakeError(path, cause, f"give pictures of {edge} to {_LARGEST_EDGE} pixels")
        left, top = ((size - edge) // 2 for size in opened.size)
        coded = np.asarray(opened.convert("RGB").crop((left, top, left + edge, top + edge)), np.float32) / 255
    return SRGB.linear(coded)
