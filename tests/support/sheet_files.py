"""Files of sheets that let light through, by the layouts of `format_files`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.source import SheetSource

from .format_files import Block, klems_file, write_mbsdf


def write_mbsdf_sheet(path: Path, sheet: SheetSource, n_theta: int = 45, n_phi: int = 90) -> Path:
    """NVIDIA's MBSDF of both hemispheres: transmission follows without a line's end, phi 180 degrees straight on."""
    write_mbsdf(path, sheet, n_theta, n_phi)
    theta = (np.arange(n_theta) + 0.5) * (np.pi / 2 / n_theta)
    phi = (np.arange(n_phi) + 0.5) * (np.pi / n_phi)
    lit = spherical(theta[:, None, None], 0.0) * np.array([1.0, 1.0, -1.0])
    values = sheet.transmitted(lit, spherical(theta[:, None], phi))
    sizes = np.array([1, n_theta, n_phi], "<u4").tobytes()
    head = b"MBSDF_DATA_TRANSMISSION=\n" + sizes
    path.write_bytes(path.read_bytes() + head + values.astype("<f4").tobytes())
    return path


def write_klems_sheet(path: Path, sheet: SheetSource, sides: Sequence[str], structure: str = "Columns") -> Path:
    """Klems matrices of these blocks of a sheet, light and viewer above or below the horizon of Radiance's front."""
    blocks: dict[str, Block] = {
        "Reflection Back": (sheet.evaluate, 1.0, 1.0),
        "Reflection Front": (sheet.reflected_behind, -1.0, -1.0),
        "Transmission Front": (sheet.transmitted, -1.0, 1.0),
        "Transmission Back": (sheet.transmitted, 1.0, -1.0),
    }
    return klems_file(path, {side: blocks[side] for side in sides}, structure)
