"""MERL isotropic BRDF files (Matusik et al. 2003, A Data-Driven Reflectance Model).

Layout: three little-endian int32 (90, 90, 180), then the red, green and blue planes as float64, each
[theta_h, theta_d, phi_d]. theta_h is sampled at (i / 90)^2 90 degrees, theta_d and phi_d in steps of one
degree; phi_d covers half a turn, reciprocity gives the other half. Numbers are BRDF values divided by 1/1500,
1.15/1500 and 1.66/1500; a negative number marks an entry without a measurement.

The authors' code rounds an angle down to its entry, so that an entry stands for a cell above its index (a "bin");
readers that interpolate mostly take it for a "node" at the index itself, half a step from the cell's centre: 0.7
degrees at theta_h = 45, half a degree of phi_d. The file tells which it is: a material that is its own mirror image
pairs entry j of phi_d with 179 - j where entries are bins, with 180 - j where they are nodes. Variants that are read
too: 360 steps of phi_d over the whole turn (LIRIS), big-endian, float32.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BakeError
from ..reading import Reading
from ..source import Array, BrdfSource, Reader
from .merl_file import DIMENSIONS, HEADER, is_header, raw_planes

SCALES = (1 / 1500, 1.15 / 1500, 1.66 / 1500)
OFFSETS = {"nodes": 0.0, "bins": 0.5}
_USUAL = Reading()
_LARGEST = 1e30  # beyond this a number is damage, and its float32 square would overflow
_CHUNK = 1 << 14  # directions per pass; its temporaries stay in the cache
_HOLE_PASSES = 16


@dataclass
class MerlSource:
    """A MERL table without holes, trilinear between its nodes.

    Parameters
    ----------
    table : (90, 90, 91 or 90, 3) float32, BRDF in 1/sr over [theta_h, theta_d, phi_d folded to 0..pi/2, rgb]
    offset : of an entry from its index: 0 for nodes, 0.5 for bins
    """

    name: str
    table: Array
    facts: dict[str, Any] = field(default_factory=dict)
    isotropic: bool = True
    bilateral: bool = True
    offset: float = 0.0

    def __post_init__(self) -> None:
        rows = np.ascontiguousarray(self.table, np.float32).reshape(-1, 3)
        # A row and its phi_d successor lie side by side, so one gather of six numbers brings both.
        self._pairs = np.concatenate([rows, np.roll(rows, -1, 0)], 1)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr, (..., 3) float32, of unit directions (..., 3); 0 on and below the horizon."""
        wi, wo = np.broadcast_arrays(np.asarray(wi), np.asarray(wo))
        shape, count = wi.shape, wi.size // 3
        wi, wo = wi.reshape(-1, 3), wo.reshape(-1, 3)
        result = np.empty((count, 3), np.float32)
        for start in range(0, count, _CHUNK):
            part = slice(start, start + _CHUNK)
            result[part] = self._lookup(wi[part], wo[part])
        return result.reshape(shape)

    def _lookup(self, wi: Array, wo: Array) -> Array:
        theta_h, theta_d, phi_d = grid_coordinates(wi, wo)
        folded = self.table.shape[2]
        i, u = _cell(theta_h, DIMENSIONS[0], self.offset)
        j, v = _cell(theta_d, DIMENSIONS[1], self.offset)
        k, w = _cell(phi_d, folded, self.offset)
        base = (i * DIMENSIONS[1] + j) * folded + k
        u, v, w = u[:, None], v[:, None], w[:, None]
        pairs = np.zeros((len(base), 6), np.float32)
        next_theta_h = DIMENSIONS[1] * folded
        for step, weight in (
            (0, (1 - u) * (1 - v)),
            (folded, (1 - u) * v),
            (next_theta_h, u * (1 - v)),
            (next_theta_h + folded, u * v),
        ):
            pairs += weight * np.take(self._pairs, base + step, 0, mode="clip")
        value = pairs[:, :3] + w * (pairs[:, 3:] - pairs[:, :3])
        value[(wi[:, 2] <= 0) | (wo[:, 2] <= 0)] = 0
        return value


def grid_coordinates(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    """Fractional indices on MERL's grid, each (n,) float32, of unit directions (n, 3), phi_d folded to 0..90.

    Built on s = wi + wo and d = wi - wo, which are perpendicular: tan theta_h = |s_xy| / s_z,
    tan theta_d = |d| / |s|, tan phi_d = (s_x d_y - s_y d_x) / -(|s| d_z). No cosine is inverted and the only
    differences are taken in the precision of the input, so theta_h keeps its relative accuracy down to zero.
    """
    sx, sy, sz = (_single(wi[:, a] + wo[:, a]) for a in range(3))
    dx, dy, dz = (_single(wi[:, a] - wo[:, a]) for a in range(3))
    radius = np.hypot(sx, sy)
    length = np.hypot(radius, sz)
    theta_h = np.arctan2(radius, np.maximum(sz, 0))
    theta_d = np.arctan2(np.sqrt(dx * dx + dy * dy + dz * dz), length)
    phi_d = np.arctan2(np.abs(sx * dy - sy * dx), length * np.abs(dz))
    rows, columns, steps = DIMENSIONS
    return (
        np.sqrt(theta_h * np.float32(rows**2 * 2 / np.pi)),
        theta_d * np.float32(columns * 2 / np.pi),
        phi_d * np.float32(steps / np.pi),
    )


def _single(values: Array) -> Array:
    return values.astype(np.float32, copy=False)


def _cell(coordinate: Array, nodes: int, offset: float) -> tuple[Array, Array]:
    """Lower entry and fraction; beyond the first and the last their values hold."""
    if offset:
        coordinate = np.maximum(coordinate - np.float32(offset), 0)
    lower = np.minimum(coordinate.astype(np.int32), nodes - 2)
    return lower, np.minimum(coordinate - lower, np.float32(1))


def read(path: Path, reading: Reading = _USUAL) -> MerlSource:
    """Read a MERL `.binary` file, average its two mirror halves and fill the entries without a measurement.

    Parameters
    ----------
    reading : its `merl` says whether entries are bins or nodes

    Returns
    -------
    MerlSource whose `facts` count, among the entries above the horizon, the invalid, negative and non-finite
    ones per channel, and apart from them the cells below the horizon, which every MERL file marks invalid.

    Raises
    ------
    BakeError : unreadable, not of MERL's exact size and header, a channel without any valid entry, all zero
    """
    path = Path(path)
    planes, variant = raw_planes(path)
    asymmetry = {name: _asymmetry(planes, offset) for name, offset in OFFSETS.items()}
    entries = min(asymmetry, key=lambda name: asymmetry[name]) if reading.merl == "auto" else reading.merl
    offset = OFFSETS[entries]
    values, valid, facts = _planes(path, planes, offset)
    facts |= variant | {"entries_read_as": entries, "asymmetry_of_readings": asymmetry}
    table, valid, facts["phi_d_asymmetry"] = _mirror_average(values, valid, offset)
    if not offset:
        _collapse_poles(table, valid)
    above = ~below_horizon(offset)[:, :, : table.shape[2]]
    facts["filled_from_neighbours"] = _fill_holes(table, valid, above)
    facts["filled_by_holding"] = int(np.count_nonzero(~valid & above[..., None]))
    table = _hold_nearest(table, valid)
    return MerlSource(path.stem, table, facts, offset=offset)


def _asymmetry(planes: list[Array], offset: float) -> float:
    """Relative difference of the entries that mirror each other in phi_d, if they lie at this offset."""
    count, index = DIMENSIONS[2], np.arange(1, DIMENSIONS[2] // 2)
    other = count - 1 - index if offset else count - index
    difference = total = 0.0
    for plane in planes:
        # Every fourth row tells as much as all of them.
        left, right = plane[::4, :, index], plane[::4, :, other]
        both = (left > 0) & (right > 0) & (left < _LARGEST) & (right < _LARGEST)
        left, right = left[both], right[both]
        # Relative entry by entry: else a mirror's peak alone would decide.
        difference += float((np.abs(left - right) / (left + right)).sum())
        total += left.size
    return difference / max(total, 1.0)


def _planes(path: Path, planes: list[Array], offset: float) -> tuple[Array, Array, dict[str, Any]]:
    """BRDF values (90, 90, 180, 3) float32 with 0 where invalid, the validity of each, and the counts."""
    values = np.empty((*DIMENSIONS, 3), np.float32)
    valid = np.empty(values.shape, bool)
    below = below_horizon(offset)
    not_finite, negative, invalid, below_valid = [], [], [], []
    for channel, plane in enumerate(planes):
        finite = np.isfinite(plane) & (np.abs(plane) < _LARGEST)
        # Some writers put 0 below the horizon; read as a value it would draw a black ring at grazing angles.
        good = finite & np.where(below, plane > 0, plane >= 0)
        if not good.any():
            cause = f"the {('red', 'green', 'blue')[channel]} plane holds no valid entry"
            raise BakeError(path, cause, "use a complete copy of the measurement")
        values[..., channel] = np.where(good, plane, 0) * SCALES[channel]
        valid[..., channel] = good
        not_finite.append(int(np.count_nonzero(~finite & ~below)))
        negative.append(int(np.count_nonzero(finite & ~good & ~below)))
        invalid.append(int(np.count_nonzero(~good & ~below)))
        below_valid.append(int(np.count_nonzero(good & below)))
    if not values.any():
        raise BakeError(path, "every entry is zero", "use a complete copy of the measurement")
    facts = {
        "format": "MERL",
        "interpolation": "trilinear in sqrt(theta_h), theta_d, phi_d",
        "entries_per_channel": below.size,
        "below_horizon": int(np.count_nonzero(below)),
        "below_horizon_with_value": below_valid,
        "invalid": invalid,
        "negative": negative,
        "not_finite": not_finite,
    }
    return values, valid, facts


def grid_angles(offset: float = 0.0) -> tuple[Array, Array, Array]:
    """theta_h (90, 1, 1), theta_d (90, 1) and phi_d (180,) of the entries, in radians."""
    rows, columns, steps = DIMENSIONS
    theta_h = ((np.arange(rows) + offset) / rows) ** 2 * (np.pi / 2)
    theta_d = np.radians((np.arange(columns) + offset) * (90 / columns))
    return theta_h[:, None, None], theta_d[:, None], np.radians((np.arange(steps) + offset) * (180 / steps))


def below_horizon(offset: float = 0.0) -> Array:
    """(90, 90, 180) bool: cells whose light or viewer lies below the surface or, up to rounding, in it."""
    theta_h, theta_d, phi_d = grid_angles(offset)
    level = np.cos(theta_h) * np.cos(theta_d)
    tilt = np.sin(theta_h) * np.sin(theta_d) * np.cos(phi_d)
    return level <= np.abs(tilt) + 1e-9


def _mirror_average(values: Array, valid: Array, offset: float) -> tuple[Array, Array, float]:
    """Mean over phi_d and pi - phi_d of the valid entries, folded to 91 nodes or 90 bins.

    The third result is sum |f(phi_d) - f(pi - phi_d)| / sum (f(phi_d) + f(pi - phi_d)) where both are valid.
    """
    steps = DIMENSIONS[2]
    mirror = steps - 1 - np.arange(steps // 2) if offset else -np.arange(steps // 2 + 1) % steps
    left, right = values[:, :, : mirror.size], values[:, :, mirror]
    left_valid, right_valid = valid[:, :, : mirror.size], valid[:, :, mirror]
    total = left + right
    both = left_valid & right_valid
    scale = float(np.sum(total[both], dtype=np.float64))
    difference = float(np.sum(np.abs(left - right)[both], dtype=np.float64))
    total[both] *= 0.5
    return total, left_valid | right_valid, difference / scale if scale > 0 else 0.0


def _collapse_poles(table: Array, valid: Array) -> None:
    """One value over phi_d, which has no meaning there, where theta_h = 0 or theta_d = 0; in place."""
    share = np.full((table.shape[2], 1), 2.0, np.float32)
    share[[0, -1]] = 1
    for pole in (np.s_[0], np.s_[:, 0]):
        weight = valid[pole] * share
        total = weight.sum(1, keepdims=True)
        mean = (table[pole] * weight).sum(1, keepdims=True) / np.maximum(total, 1)
        table[pole], valid[pole] = mean, total > 0


def _fill_holes(table: Array, valid: Array, above: Array) -> int:
    """Give holes above the horizon the mean of their valid neighbours, pass by pass; in place.

    Neighbours at the same theta_h come first, those across it for what is left: a BRDF varies slowest
    when the half vector stays (Rusinkiewicz 1998), and a mean across theta_h would flatten a highlight.
    Returns how many entries were filled.
    """
    holes = np.argwhere(~valid & above[..., None])
    missing = len(holes)
    for steps in (((0, 1), (0, -1), (1, 1), (1, -1)), ((2, 1), (2, -1))):
        for _ in range(_HOLE_PASSES):
            total, count = _neighbour_sum(table, valid, holes, steps)
            ready = count > 0
            if not ready.any():
                break
            at = tuple(holes[ready].T)
            table[at], valid[at] = total[ready] / count[ready], True
            holes = holes[~ready]
    return missing - len(holes)


def _neighbour_sum(table: Array, valid: Array, holes: Array, steps: tuple[tuple[int, int], ...]) -> tuple[Array, Array]:
    """Sum and number of the valid neighbours of holes (n, 4).

    A step is (0 for theta_d, 1 for phi_d or 2 for theta_h; +1 or -1).
    """
    total, count = np.zeros(len(holes), np.float32), np.zeros(len(holes), np.int32)
    i, j, k, c = holes.T
    for kind, step in steps:
        # phi_d continues as its own mirror image; where a theta axis ends the hole meets its invalid self.
        last = table.shape[2] - 1
        mirrored = last - np.abs(last - np.abs(k + step)) if last == DIMENSIONS[2] // 2 else np.clip(k + step, 0, last)
        near_k = mirrored if kind == 1 else k
        near_j = np.clip(j + step, 0, DIMENSIONS[1] - 1) if kind == 0 else j
        near_i = np.clip(i + step, 0, DIMENSIONS[0] - 1) if kind == 2 else i
        known = valid[near_i, near_j, near_k, c]
        total += np.where(known, table[near_i, near_j, near_k, c], 0)
        count += known
    return total, count


def _hold_nearest(table: Array, valid: Array) -> Array:
    """Continue the last valid value along theta_d; lines without any, along theta_h, then phi_d."""
    for axis in (1, 0, 2):
        if valid.all():
            break
        shape = [1, 1, 1, 1]
        shape[axis] = table.shape[axis]
        index = np.arange(table.shape[axis], dtype=np.int16).reshape(shape)
        last = np.maximum.accumulate(np.where(valid, index, np.int16(-1)), axis)
        after = np.flip(np.minimum.accumulate(np.flip(np.where(valid, index, np.int16(999)), axis), axis), axis)
        nearest = np.where(last >= 0, last, after)
        found = nearest < 999
        table = np.take_along_axis(table, np.where(found, nearest, 0).astype(np.intp), axis)
        valid = found
    return table


def grid_directions(row: int, phi_h: float = 0.0, offset: float = 0.0) -> tuple[Array, Array]:
    """wi and wo, (90, 180, 3) each, of the entries with one theta_h index."""
    theta_h, theta_d, phi_d = grid_angles(offset)
    cos_h, sin_h = np.cos(theta_h[row, 0]), np.sin(theta_h[row, 0])
    along, across, up = np.sin(theta_d) * np.cos(phi_d), np.sin(theta_d) * np.sin(phi_d), np.cos(theta_d)
    cos_p, sin_p = np.cos(phi_h), np.sin(phi_h)
    pair = []
    for sign in (1, -1):
        x, y, z = cos_h * sign * along + sin_h * up, sign * across, cos_h * up - sin_h * sign * along
        pair.append(np.stack([cos_p * x - sin_p * y, sin_p * x + cos_p * y, z], -1))
    return pair[0], pair[1]


def write_merl(path: str | Path, source: BrdfSource, entries: str = "nodes") -> None:
    """Sample a BRDF on MERL's grid and write the file, as a measurement of it would be, its entries nodes or bins.

    Cells below the horizon are written as -1. An anisotropic source is averaged over 8 azimuths of the
    half vector. The file appears complete or not at all.

    Raises
    ------
    BakeError : the file cannot be written
    """
    path = Path(path)
    offset = OFFSETS[entries]
    azimuths = [0.0] if source.isotropic else list(np.arange(8) * (np.pi / 4))
    planes = np.empty((3, *DIMENSIONS))
    for row in range(DIMENSIONS[0]):
        pairs = (grid_directions(row, phi_h, offset) for phi_h in azimuths)
        mean = sum(source.evaluate(wi, wo).astype(np.float64) for wi, wo in pairs) / len(azimuths)
        planes[:, row] = np.moveaxis(mean / np.array(SCALES), -1, 0)
    planes[:, below_horizon(offset)] = -1
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as stream:
            stream.write(HEADER)
            planes.astype("<f8", copy=False).tofile(stream)
        os.replace(temporary, path)
    except OSError as error:
        cause = f"cannot be written ({error.strerror or error})"
        raise BakeError(path, cause, "choose a folder you may write to, with 35 MB free") from error
    finally:
        temporary.unlink(missing_ok=True)


READER = Reader("MERL", (".binary",), lambda path, head: is_header(head), read)
