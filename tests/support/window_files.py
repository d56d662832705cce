"""WINDOW's XML files, written from any BRDF or sheet: Klems' matrices and Radiance's tensor trees."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.source import Array, BrdfSource, SheetSource
from measured_materials.bake.sources.radiance.klems import BASES


def text(values: Array) -> str:
    """Numbers as files hold them."""
    return " ".join(f"{v:.9g}" for v in np.asarray(values).reshape(-1))


def klems_centres(name: str = "Full") -> Array:
    """Directions of the bins of Klems' bases; of the full one (145, 3)."""
    basis = BASES[f"klems {name.lower()}"]
    lower = np.array([0.0, *basis.bounds[:-1]])
    middle = (lower + np.array(basis.bounds)) / 2
    middle[0] = 0.0
    parts = [
        spherical(np.radians(theta), np.arange(n) * (2 * np.pi / n))
        for theta, n in zip(middle, basis.azimuths, strict=True)
    ]
    return np.concatenate(parts)


_XML = """<?xml version="1.0" encoding="UTF-8"?>
<WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer><Material><Name>a test</Name></Material>
<DataDefinition><IncidentDataStructure>{structure}</IncidentDataStructure></DataDefinition>
{blocks}</Layer></Optical></WindowElement>
"""
_BLOCK = """<WavelengthData><Wavelength unit="Integral">{wavelength}</Wavelength><WavelengthDataBlock>
<WavelengthDataDirection>{side}</WavelengthDataDirection>{basis}
<ScatteringDataType>BTDF</ScatteringDataType><ScatteringData>
{data}
</ScatteringData></WavelengthDataBlock></WavelengthData>
"""
_KLEMS = "<ColumnAngleBasis>LBNL/Klems {0}</ColumnAngleBasis><RowAngleBasis>LBNL/Klems {0}</RowAngleBasis>"


def write_klems(
    path: Path, source: BrdfSource, side: str = "Reflection Back", structure: str = "Columns", basis: str = "Full"
) -> Path:
    """A Klems matrix of what is seen above the horizon, whatever the block is called."""
    return _klems_file(path, {side: (source.evaluate, 1.0, 1.0)}, structure, basis)


def write_klems_sheet(path: Path, sheet: SheetSource, sides: Sequence[str], structure: str = "Columns") -> Path:
    """Klems matrices of these blocks of a sheet, light and viewer above or below the horizon of Radiance's front."""
    blocks: dict[str, Block] = {
        "Reflection Back": (sheet.evaluate, 1.0, 1.0),
        "Reflection Front": (sheet.reflected_behind, -1.0, -1.0),
        "Transmission Front": (sheet.transmitted, -1.0, 1.0),
        "Transmission Back": (sheet.transmitted, 1.0, -1.0),
    }
    return _klems_file(path, {side: blocks[side] for side in sides}, structure)


# Values of (wi, wo), and the signs of the heights of both.
Block = tuple[Callable[[Array, Array], Array], float, float]


def _klems_file(path: Path, blocks: Mapping[str, Block], structure: str, basis: str = "Full") -> Path:
    """Rows are outgoing, and incident bins are named by where the light travels to."""
    bins, texts = klems_centres(basis), []
    for side, (evaluate, lit, seen) in blocks.items():
        values = np.asarray(evaluate((bins * [-1.0, -1.0, lit])[None], (bins * [1.0, 1.0, seen])[:, None]))[..., 1]
        if structure == "Rows":
            values = values.T
        data = ",\n".join(text(row).replace(" ", ", ") for row in values)
        texts.append(_BLOCK.format(wavelength="Visible", side=side, basis=_KLEMS.format(basis), data=data + ","))
    path.write_text("a line that a program logged\n" + _XML.format(structure=structure, blocks="".join(texts)))
    return path


def write_tree(path: Path, source: BrdfSource, depth: int = 3, side: str = "Reflection Back") -> Path:
    """A tensor tree of rank 4: one branch at the top, its children grids of values at the centres of their cells."""
    n = 1 << depth
    centre = (np.arange(n) + 0.5) / n
    square = np.stack(np.meshgrid(centre, centre, indexing="ij"), -1).reshape(-1, 2)
    disk = square_to_disk(square)
    up = np.sqrt(np.maximum(1 - (disk**2).sum(-1), 0))
    out = np.column_stack([disk, up])
    wi = out * np.array([-1.0, -1.0, 1.0])
    values = np.asarray(source.evaluate(wi[:, None], out[None]))[..., 1].reshape(n, n, n, n)
    half = n // 2
    children = []
    for child in range(16):
        # The first coordinate is the lowest bit of a branch, and the slowest of a leaf's values.
        at = tuple(slice((child >> d & 1) * half, ((child >> d & 1) + 1) * half) for d in range(4))
        children.append("{ " + text(values[at]) + " }")
    data = "{\n" + "\n".join(children) + "\n}"
    block = _BLOCK.format(
        wavelength="Visible", side=side, basis="<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>", data=data
    )
    path.write_text(_XML.format(structure="TensorTree4", blocks=block))
    return path


def square_to_disk(square: Array) -> Array:
    """Shirley & Chiu's concentric map (1997), (n, 2) in [0, 1] to the unit disk."""
    a, b = 2 * square[:, 0] - 1, 2 * square[:, 1] - 1
    wide = np.abs(a) > np.abs(b)
    radius = np.where(wide, a, b)
    ratio = np.where(wide, b / np.where(a == 0, 1, a), a / np.where(b == 0, 1, b))
    phi = np.where(wide, np.pi / 4 * ratio, np.pi / 2 - np.pi / 4 * ratio)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi)], -1)
