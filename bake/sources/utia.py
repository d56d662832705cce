"""UTIA's anisotropic BRDF database (`.bin`, `.exr`): 6 elevations by 48 azimuths of light and viewer.

The file has no head: it is recognised by its size alone. Layout, by four public readers (asztr/UTIA-brdf,
jdupuy/dj_brdf, afichet/brdf-snippets, mkae/alta), which agree on it: planes red, green, blue of little-endian
float64, each [theta_i, phi_i, theta_v, phi_v]; elevations 0 to 75 degrees in steps of 15, azimuths 0 to 352.5 in
steps of 7.5, nodes, counter-clockwise from +x. The first pair is the light.

They do not agree on what a number means: linear RGB (two of them), sRGB-encoded (one), or multiplied with 1/140 first
and decoded then, times 100 (one, by "a constant by Jiri Filip", to conserve energy; 18.09 times darker below 5.25).
Nothing in the file tells. It is read as linear, unless its albedo then exceeds 1; `facts` give the albedo of all
three readings.

The database's pictures hold the same numbers as 288 x 288 pixels of R, G, B: rows are the light, columns the viewer, as
in the mosaic of asztr/UTIA-brdf. ALTA's writer of them turns the rows upside down. A measurement tells which: values
are the same with light and viewer exchanged, but for its error, so the order of rows that is more nearly reciprocal is
taken, and `facts` give the error of both. Light and viewer themselves cannot be told apart by that.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..directions import polar_angle
from ..errors import BakeError
from ..images.image_io import read_header, read_image
from ..reading import Reading
from ..source import Array, Json, Reader
from .lookup.lookup_source import Axis, LookupSource, azimuth_of, interpolate, negative_facts

THETAS, PHIS = 6, 48
SIDE = THETAS * PHIS
FILE_BYTES = 3 * SIDE**2 * 8
_STEP_THETA, _STEP_PHI = np.radians(15.0), np.radians(7.5)
_EXR = b"\x76\x2f\x31\x01"
_REMEDY = "give a .bin or .exr file of the UTIA BRDF database (6 x 48 directions), not one of its BTF"


def read(path: Path, reading: Reading) -> LookupSource:
    """Read a UTIA file, its numbers as `reading.utia` has them. Raises BakeError: unreadable, of another size."""
    raw, told = _picture(path) if _is_picture(path) else (_raw(path), {})
    readings = {name: decode(raw) for name, decode in READINGS.items()}
    albedos = {name: _largest_albedo(table) for name, table in readings.items()}
    fitting = next((name for name, albedo in albedos.items() if albedo <= 1.0), "scaled")
    chosen = fitting if reading.utia == "auto" else reading.utia
    table = readings[chosen]
    axes = (
        Axis(np.arange(THETAS) * _STEP_THETA),
        Axis(np.arange(PHIS) * _STEP_PHI, 2 * np.pi),
    ) * 2

    def lookup(wi: Array, wo: Array) -> Array:
        return interpolate(axes, table, polar_angle(wi), azimuth_of(wi), polar_angle(wo), azimuth_of(wo))

    facts: dict[str, Json] = {
        "format": "UTIA",
        "interpolation": "linear between the nodes; held beyond 75 degrees",
        "values_read_as": chosen,
        "largest_albedo_of_readings": albedos,
        "reciprocity_error": _reciprocity_error(table),
        **told,
        **negative_facts(table),
    }
    return LookupSource(path.stem, lookup, facts, isotropic=False, bilateral=False)


def _raw(path: Path) -> Array:
    """The stored numbers as [theta_i, phi_i, theta_v, phi_v, channel]."""
    try:
        data = np.fromfile(path, "<f8")
        size = path.stat().st_size
    except (OSError, ValueError) as error:
        raise BakeError(path, f"cannot be read ({error})", "check the path and its permissions") from error
    if size != FILE_BYTES or data.size * 8 != FILE_BYTES:
        raise BakeError(path, f"has {size} bytes, a UTIA file {FILE_BYTES}", _REMEDY)
    if not np.isfinite(data).all() or np.abs(data).max() > 1e6:
        raise BakeError(path, "holds numbers that are not finite or out of range", _REMEDY)
    return np.moveaxis(data.reshape(3, THETAS, PHIS, THETAS, PHIS), 0, -1)


def _picture(path: Path) -> tuple[Array, dict[str, Json]]:
    """The same of a picture, and what was found of the order of its rows."""
    pixels = read_image(path, 4 * SIDE * SIDE * 3)
    if pixels.shape != (SIDE, SIDE, 3):
        raise BakeError(path, f"has {pixels.shape[1]} x {pixels.shape[0]} pixels, not {SIDE} x {SIDE}", _REMEDY)
    if not np.isfinite(pixels).all() or np.abs(pixels).max() > 1e6:
        raise BakeError(path, "holds numbers that are not finite or out of range", _REMEDY)
    orders = {"first": pixels, "last": pixels[::-1]}
    tables = {name: rows.astype(np.float64).reshape(THETAS, PHIS, THETAS, PHIS, 3) for name, rows in orders.items()}
    errors = {name: _reciprocity_error(table) for name, table in tables.items()}
    top = min(errors, key=errors.__getitem__)
    told: dict[str, Json] = {
        "light_at_the_normal_in_row": top,
        "reciprocity_error_of_rows": errors,
        "columns_read_as": "the viewer; --reciprocity exchanged reads them as the light",
    }
    return tables[top], told


def _reciprocity_error(table: Array) -> float:
    """Of [theta_i, phi_i, theta_v, phi_v, channel], relative to the sum of the values."""
    exchanged = table.transpose(2, 3, 0, 1, 4)
    return float(np.abs(table - exchanged).sum() / max(np.abs(table).sum(), 1e-30))


def _is_picture(path: Path) -> bool:
    """Whether it is an OpenEXR picture of one pixel for each pair of directions."""
    try:
        header = read_header(path, 4 * SIDE * SIDE * 3)
    except (BakeError, OSError):
        return False
    return (header.width, header.height, header.channels) == (SIDE, SIDE, 3)


def _srgb(stored: Array) -> Array:
    """IEC 61966-2-1, continued as an odd function."""
    size = np.abs(stored)
    return np.sign(stored) * np.where(size <= 0.04045, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)


def _scaled(stored: Array) -> Array:
    """By the constant of 140, decoded, times 100 (dj_brdf, whose threshold is 0.0375), negatives as they are."""
    size = np.abs(stored) / 140
    return 100 * np.sign(stored) * np.where(size <= 0.0375, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)


READINGS: dict[str, Callable[[Array], Array]] = {"linear": np.array, "sRGB": _srgb, "scaled": _scaled}


def _largest_albedo(table: Array) -> float:
    """Largest directional albedo over the stored light directions and channels, midpoints in theta.

    The cell of a node reaches half a step to both sides, the last one's to the horizon.
    """
    edges = np.concatenate([[0.0], (np.arange(THETAS - 1) + 0.5) * _STEP_THETA, [np.pi / 2]])
    weight = np.pi * np.diff(np.sin(edges) ** 2) / PHIS
    return float(np.einsum("abcdk,c->abk", table, weight).max())


def _matches(path: Path, head: bytes) -> bool:
    if head.startswith(_EXR):
        return _is_picture(path)
    try:
        return path.stat().st_size == FILE_BYTES
    except OSError:
        return False


READER = Reader("UTIA", (".bin",), _matches, read)
