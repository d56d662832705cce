"""The bytes of MERL's binary files: three numbers and three planes, in the variants that occur."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BakeError
from ..source import Array
from .lookup.text_file import widened

DIMENSIONS = (90, 90, 180)
HEADER = np.array(DIMENSIONS, "<i4").tobytes()
_REMEDY = "use an undamaged MERL .binary file"
# Numbers of another byte order have any exponent: almost half of them are larger than any measurement.
_MOST_DAMAGED, _LARGEST = 0.2, 1e30


def is_header(head: bytes) -> bool:
    """Whether a file begins with MERL's numbers, of either byte order."""
    return _steps(head) is not None


def _steps(head: bytes) -> tuple[int, str] | None:
    """Steps of phi_d, over half a turn, or a whole one where light and viewer are told apart (LIRIS); byte order."""
    steps = DIMENSIONS[2]
    for order in "<>":
        numbers = np.frombuffer(head[:12], f"{order}i4") if len(head) >= 12 else np.zeros(0)
        if numbers.size == 3 and tuple(numbers[:2]) == DIMENSIONS[:2] and numbers[2] in (steps, 2 * steps):
            return int(numbers[2]), order
    return None


def raw_planes(path: Path) -> tuple[list[Array], dict[str, Any]]:
    """The three planes as stored, (90, 90, 180) float64, and what is unusual about the file.

    Of 360 steps, phi_d and phi_d + 180 degrees are one pair of directions with light and viewer exchanged: of two valid
    entries the mean is taken, else the one that is valid.

    Raises
    ------
    BakeError : unreadable, not of MERL's size and header, its numbers are those of another byte order
    """
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            head = stream.read(len(HEADER))
            found, usual = _steps(head), DIMENSIONS[2]
            if found is None and len(head) == len(HEADER):
                told = " x ".join(str(n) for n in np.frombuffer(head, "<i4"))
                cause = f"the header says {told}, MERL's is 90 x 90 x 180 ({_bytes(usual, 8)} bytes, found {size})"
                raise BakeError(path, cause, _REMEDY)
            steps, order = found or (usual, "<")
            width = next((w for w in (8, 4) if size == _bytes(steps, w)), 0)
            if not width:
                kind = "truncated" if size < _bytes(steps, 8) else "too long"
                raise BakeError(path, f"{kind}: expected {_bytes(steps, 8)} bytes, found {size}", _REMEDY)
            data = np.fromfile(stream, f"{order}f{width}")
    except (OSError, ValueError) as error:
        cause = getattr(error, "strerror", None) or str(error)
        raise BakeError(path, f"cannot be read ({cause})", _REMEDY) from error
    if data.size * width + len(HEADER) != size:
        raise BakeError(path, f"read {data.size * width + len(HEADER)} of {size} bytes", _REMEDY)
    damaged = float(np.mean(~(np.abs(data) < _LARGEST)))
    if _MOST_DAMAGED < damaged < 1:
        raise BakeError(path, f"{100 * damaged:.0f} % of its numbers are none: another byte order, or damage", _REMEDY)
    planes = list(widened(data).reshape(3, *DIMENSIONS[:2], steps))
    variant: dict[str, Any] = {}
    if order == ">" or width == 4:
        variant["numbers"] = f"{'big' if order == '>' else 'little'}-endian float{8 * width}"
    if steps == 2 * DIMENSIONS[2]:
        variant["reciprocity_error"], planes = _folded(planes)
    return planes, variant


def _bytes(steps: int, width: int) -> int:
    return len(HEADER) + 3 * DIMENSIONS[0] * DIMENSIONS[1] * steps * width


def _folded(planes: list[Array]) -> tuple[float, list[Array]]:
    """Planes of half a turn, and by how much, relatively, light and viewer cannot be exchanged."""
    difference = total = 0.0
    folded = []
    for plane in planes:
        near, far = np.split(plane, 2, -1)
        near_valid, far_valid = ((half >= 0) & (half < _LARGEST) for half in (near, far))
        both = near_valid & far_valid
        difference += float(np.abs(near - far)[both].sum())
        total += float((near + far)[both].sum()) / 2
        folded.append(np.where(both, (near + far) / 2, np.where(far_valid, far, near)))
    return difference / max(total, 1e-30), folded
