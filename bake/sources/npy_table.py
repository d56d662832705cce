"""A BRDF as a numpy array (`.npy`) in our own order of axes: what a program of one's own can write in a line.

(theta_o, theta_i, phi_delta, 3) is isotropic, phi_delta over [0, pi] with both ends; (theta_o, phi_o, theta_i, phi_i,
3) is anisotropic, azimuths over a whole turn without its end. Elevations go from 0 to pi / 2 with both ends, all
evenly; values are in 1/sr without the cosine, linear Rec.709. Linear between the entries.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..directions import polar_angle
from ..errors import BakeError
from ..source import Array, Json, Reader
from .lookup.lookup_source import Axis, LookupSource, azimuth_between, azimuth_of, interpolate, negative_facts
from .lookup.npy_file import load_npy
from .lookup.text_file import LARGEST_VALUE
from .neural_brdf import READER as NETWORK

MAX_BYTES = 2 << 30
_REMEDY = (
    "save an array (theta_o, theta_i, phi_delta, 3) or (theta_o, phi_o, theta_i, phi_i, 3) of floats by numpy.save"
)


def read(path: Path) -> LookupSource:
    """Read an array. Raises BakeError: damaged, of other axes, not finite."""
    table = _table(path)
    elevation = [Axis(np.linspace(0, np.pi / 2, n)) for n in table.shape]
    isotropic = table.ndim == 4
    if isotropic:
        axes = (elevation[0], elevation[1], Axis(np.linspace(0, np.pi, table.shape[2])))

        def lookup(wi: Array, wo: Array) -> Array:
            return interpolate(axes, table, polar_angle(wo), polar_angle(wi), azimuth_between(wi, wo))

        exchanged = table.swapaxes(0, 1)
    else:
        turns = [Axis(np.arange(n) * (2 * np.pi / n), 2 * np.pi) for n in table.shape]
        four = (elevation[0], turns[1], elevation[2], turns[3])

        def lookup(wi: Array, wo: Array) -> Array:
            return interpolate(four, table, polar_angle(wo), azimuth_of(wo), polar_angle(wi), azimuth_of(wi))

        exchanged = table.transpose(2, 3, 0, 1, 4)
    facts: dict[str, Json] = {
        "format": "numpy array",
        "entries": list(table.shape[:-1]),
        "interpolation": "linear",
        **negative_facts(table),
    }
    if exchanged.shape == table.shape:
        facts["reciprocity_error"] = float(np.abs(table - exchanged).sum() / max(np.abs(table).sum(), 1e-30))
    return LookupSource(path.stem, lookup, facts, isotropic, isotropic)


def _table(path: Path) -> Array:
    table = load_npy(path, MAX_BYTES, _REMEDY)
    if table.ndim not in (4, 5) or table.shape[-1] != 3 or min(table.shape) < 2:
        raise BakeError(path, f"holds an array of shape {table.shape}", _REMEDY)
    if table.dtype.kind != "f":
        raise BakeError(path, f"holds {table.dtype}, not floats", _REMEDY)
    if not np.isfinite(table).all() or np.abs(table).max() > LARGEST_VALUE:
        raise BakeError(path, f"holds values that are not finite or exceed {LARGEST_VALUE:g} 1/sr", _REMEDY)
    return table


def _matches(path: Path, head: bytes) -> bool:
    return head.startswith(b"\x93NUMPY") and not NETWORK.matches(path, head)


READER = Reader("numpy array", (".npy",), _matches, lambda path, reading: read(path))
