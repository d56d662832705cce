"""Photographs of a known colour, coded by matrices and curves that standards print, and how they are read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.photographs import read_stack

from . import color_files as files
from .photo_files import encode_srgb, write_photo

SWATCH = np.array([0.35, 0.07, 0.035])  # a red that is inside Rec.709 and near its border

# To linear Rec.709 (IEC 61966-2-1) from XYZ of D65, as printed there.
FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
# From XYZ of D50, with Bradford's adaptation, as B. Lindbloom prints it.
FROM_XYZ_D50 = np.array(
    [[3.1338561, -1.6168667, -0.4906146], [-0.9787684, 1.9161415, 0.0334540], [0.0719453, -0.2289914, 1.4052427]]
)
# Adobe RGB (1998) Color Image Encoding, 4.3.5.3; CSS Color 4, display-p3; ITU-R BT.2087; ACES (Bradford).
ADOBE = FROM_XYZ @ [[0.57667, 0.18556, 0.18823], [0.29734, 0.62736, 0.07529], [0.02703, 0.07069, 0.99134]]
DISPLAY_P3 = FROM_XYZ @ [
    [0.4865709, 0.2656677, 0.1982173],
    [0.2289746, 0.6917385, 0.0792869],
    [0.0000000, 0.0451134, 1.0439444],
]
BT2020 = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])
AP0 = np.array(
    [
        [2.52164943, -1.13688855, -0.38491759],
        [-0.27521355, 1.36970515, -0.09439245],
        [-0.01592501, -0.14780637, 1.16380582],
    ]
)
AP1 = np.array([[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]])
PRIMARIES = {
    "AP0": ((0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767), AP0),
    "AP1": ((0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767), AP1),
    "BT.2020": ((0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290), BT2020),
    "Display P3": ((0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290), DISPLAY_P3),
    "Adobe RGB (1998)": ((0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290), ADOBE),
}


def within(matrix: np.ndarray, linear: np.ndarray = SWATCH) -> np.ndarray:
    """The linear values that the matrix to Rec.709 takes to `linear`."""
    return np.linalg.solve(matrix, linear)


def codes(values: np.ndarray, gamma: float | None = None, dtype: type = np.uint16) -> np.ndarray:
    """(8, 10, 3) even codes by a gamma, None for sRGB's curve."""
    even = np.broadcast_to(values, (8, 10, 3))
    if gamma is None:
        return encode_srgb(even, dtype)
    return np.rint(even ** (1 / gamma) * np.iinfo(dtype).max).astype(dtype)


def read(folder: Path, capsys: pytest.CaptureFixture[str] | None = None) -> tuple[np.ndarray, dict, list[str]]:
    """Average of the second of two photographs, the first's being half of it, how it was decoded, warnings."""
    stack = read_stack(folder)
    first, second = stack.images.mean(axis=(1, 2))
    assert first == pytest.approx(second / 2, abs=0.004)
    used = stack.facts["decoding"]["used"]
    assert len(used) == 1 and used[0]["photographs"] == 2
    if capsys is not None:  # as a user sees it
        assert main(["inspect", str(folder), "--json"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["source"]["facts"]["decoding"]["used"] == used
        assert main(["inspect", str(folder)]) == 0
        told = " ".join(capsys.readouterr().out.split())
        assert ("converted" in used[0]) == ("Converted" in told)
        assert used[0].get("converted", "") in told
    return second, used[0], list(stack.warnings)


def pngs(folder: Path, values: np.ndarray, gamma: float | None, *marks: bytes) -> Path:
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        files.write_png(folder / f"{name}.png", codes(values * gain, gamma), *marks)
    return folder


def exrs(folder: Path, values: np.ndarray, channels: tuple[str, ...] = ()) -> list[Path]:
    made = []
    for name, gain in (("el30", 0.5), ("el70", 1.0)):
        even = np.broadcast_to(values * gain, (8, 10, 3)).astype(np.float32)
        made.append(write_photo(folder / f"{name}.exr", even, channels))
    return made
