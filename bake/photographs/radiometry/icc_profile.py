"""ICC profiles of the kinds that photographs carry: primaries and curves. Format: ICC.1:2022.

A profile of this kind is exact: value, curve, matrix, XYZ. Others hold tables for four inks or for a printer, which say
how colours look there; such a profile is named and not applied.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .response import LINEAR, SRGB, Response

_MOST_TAGS, _MOST_SAMPLES = 256, 1 << 16
_COLORANTS, _CURVES = (b"rXYZ", b"gXYZ", b"bXYZ"), (b"rTRC", b"gTRC", b"bTRC")
_SAME = 3e-4
"""Curves closer than this over the whole range are one; 1024 samples of sRGB in 16 bits are."""
_READ = frozenset({*_COLORANTS, *_CURVES, b"kTRC", b"cicp", b"desc"})
# Places among g, a, b, c, d, e, f of the numbers of each parametric type (ICC.1:2022, table 68).
_PARAMETRIC = {0: "g", 1: "gab", 2: "gabe", 3: "gabcd", 4: "gabcdef"}


@dataclass(frozen=True, eq=False)
class IccProfile:
    """A profile's name, code points of H.273, curves (one or three) and colorants, columns of a matrix to XYZ of D50.

    `curves` is empty where the profile works by tables, `colorants` None there and for grey.
    """

    name: str
    color_space: str
    cicp: tuple[int, int, int, int] | None
    curves: tuple[Response, ...]
    colorants: NDArray[np.float64] | None


def parse_icc(data: bytes) -> IccProfile | None:
    """A profile, None where the bytes are none or it is damaged."""
    try:
        if data[36:40] != b"acsp":
            return None
        tags = _tags(data)
        space, connection = data[16:20].decode("latin-1").strip(), data[20:24]
        curves: tuple[Response, ...] = ()
        colorants = None
        if space == "GRAY" and b"kTRC" in tags:
            curves = (_curve(tags[b"kTRC"]),)
        elif space == "RGB" and connection == b"XYZ " and all(tag in tags for tag in (*_COLORANTS, *_CURVES)):
            curves = tuple(_curve(tags[tag]) for tag in _CURVES)
            curves = curves[:1] if curves[0] == curves[1] == curves[2] else curves
            colorants = np.array([_xyz(tags[tag]) for tag in _COLORANTS]).T
            if not abs(np.linalg.det(colorants)) > 1e-6 or not (colorants.sum(axis=1) > 0).all():
                return None
        cicp = tags.get(b"cicp", b"")
        codes = (cicp[8], cicp[9], cicp[10], cicp[11]) if len(cicp) >= 12 else None
        return IccProfile(_name(tags.get(b"desc", b"")), space, codes, curves, colorants)
    except (struct.error, ValueError, IndexError, KeyError, OverflowError):
        return None


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, 128)
    found: dict[bytes, bytes] = {}
    for k in range(min(count, _MOST_TAGS)):
        tag, offset, size = struct.unpack_from(">4sII", data, 132 + 12 * k)
        if tag in _READ and offset + size <= len(data):
            found.setdefault(tag, data[offset : offset + size])
    return found


def _name(tag: bytes) -> str:
    if tag[:4] == b"desc":
        (length,) = struct.unpack_from(">I", tag, 8)
        text = tag[12 : 12 + min(length, 256)].split(b"\0")[0].decode("latin-1")
    elif tag[:4] == b"mluc":
        length, offset = struct.unpack_from(">II", tag, 20)
        text = tag[offset : offset + min(length, 512)].decode("utf-16-be", "replace")
    else:
        text = ""
    return "".join(c for c in text if c.isprintable()).strip()[:80] or "without a name"


def _xyz(tag: bytes) -> tuple[float, float, float]:
    x, y, z = struct.unpack_from(">3i", tag, 8)
    return x / 65536, y / 65536, z / 65536


def _curve(tag: bytes) -> Response:
    if tag[:4] == b"para":
        (kind,) = struct.unpack_from(">H", tag, 8)
        names = _PARAMETRIC[kind]
        numbers = dict(zip(names, (value / 65536 for value in struct.unpack_from(f">{len(names)}i", tag, 12))))
        return _known(_parametric(kind, numbers))
    if tag[:4] != b"curv":
        raise ValueError
    (count,) = struct.unpack_from(">I", tag, 8)
    if count == 0:
        return LINEAR
    if count == 1:
        return _known(_parametric(0, {"g": struct.unpack_from(">H", tag, 12)[0] / 256}))
    if count > _MOST_SAMPLES:
        raise ValueError
    values = struct.unpack_from(f">{count}H", tag, 12)
    return _known(Response("profile", samples=tuple(value / 65535 for value in values)))


def _parametric(kind: int, n: dict[str, float]) -> Response:
    """Y = (a X + b)^g + e from X = d on, c X + f below."""
    g, a, b = n["g"], n.get("a", 1.0), n.get("b", 0.0)
    c, d, e, f = n.get("c", 0.0), n.get("d", 0.0), n.get("e", 0.0), n.get("f", 0.0)
    if kind in (1, 2):  # constant below the zero of a X + b
        d, f = -b / a, e
    if not 0 < g < 20 or not a > 0:
        raise ValueError
    if kind == 0:
        return Response(f"gamma:{g:g}", gamma=g)
    return Response("profile", parameters=(g, a, b, c, d, e, f))


def _known(curve: Response) -> Response:
    """The curve, or the named one that it cannot be distinguished from."""
    x = np.linspace(0, 1, 1025)
    for known in (SRGB, LINEAR):
        if np.abs(curve.linear(x) - known.linear(x)).max() < _SAME:
            return known
    return curve
