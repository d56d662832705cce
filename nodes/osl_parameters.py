"""Parameters of the OSL shaders that describe a table, its grid, its cells and its textures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..bake.alias_sampler import SamplerLayout
from ..bake.anisotropic.atlas import SliceLayout
from ..bake.atlas import AtlasLayout
from ..bake.brdf.baked_table import Layout
from ..bake.brdf.grids import AnisotropicGrid, Grid, basis_of
from ..bake.brdf.parts import StoredTableRecord
from ..bake.bundle import Bundle
from ..bake.errors import BakeError
from ..bake.half_grid import HalfGrid
from ..bake.log_storage import LogCodes
from ..bake.parameterization import shape_constants


def texture_file(bundle: Bundle, name: str) -> str:
    """Whole path of a bundle's image, for OSL to read. Raises BakeError."""
    path = Path(bundle.image_path(name)).resolve()
    # OpenImageIO, which reads textures for OSL, takes these for patterns and options.
    if odd := sorted(set("?%<#") & set(str(path))):
        raise BakeError(path, f"OSL cannot read a texture whose path holds {odd[0]!r}", "rename the folder")
    return str(path)


def texel_constants(stored: StoredTableRecord) -> dict[str, Any]:
    """Those that turn texels into values."""
    log = stored.log or LogCodes((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    return {
        "Scale": 1 / stored.scale,
        "Offset": stored.offset,
        "LogRange": log.ranges,
        "LogGain": log.gains,
    }


def grid_constants(grid: Grid) -> dict[str, Any]:
    """Those that say where the samples of a table lie, in its grid and in its atlas. Raises BakeError."""
    layout = SliceLayout.of(grid) if isinstance(grid, AnisotropicGrid) else AtlasLayout(grid.shape)
    return {
        "Basis": basis_of(grid),
        "Azimuths": grid.shape[0] if len(grid.shape) > 3 else 0,
        **dict(zip(("Slices", "SliceRows", "SliceColumns"), grid.shape[-3:], strict=True)),
        "Columns": layout.columns,
        "Rows": layout.rows,
        "Parameterization": grid.parameterization,
        "Reciprocal": int(isinstance(grid, HalfGrid) and grid.reciprocal),
        "Folded": int(isinstance(grid, AnisotropicGrid) and grid.folded),
        **{name: shape_constants(shape) for name, shape in _shapes(grid).items()},
    }


def _shapes(grid: Grid) -> dict[str, Any]:
    """Of the axes across slices, of rows and of columns."""
    names = "ShapeSlice", "ShapeRow", "ShapePhi"
    if isinstance(grid, HalfGrid):
        return dict(zip(names, grid.shapes, strict=True))
    first, second = grid.axis_shapes if isinstance(grid, AnisotropicGrid) else grid.shapes
    if basis_of(grid) == "half":
        # Widths of the half vector's slopes, along the tangent and across it; theta_d has no shape.
        return {"ShapeRow": second, "ShapePhi": first}
    # In the normal-vector basis both elevations share a shape.
    return dict(zip(names, (first, first, second), strict=True))


def cell_constants(layout: Layout) -> dict[str, Any]:
    """Those of alias tables' bins and cells."""
    if isinstance(layout, SamplerLayout):
        return {"Bins": layout.n_o, "CellRows": layout.n_h, "CellColumns": layout.n_phi, "Warp": layout.warp_power}
    return {
        "Bins": layout.n_theta,
        "BinsPhi": layout.n_phi,
        "CellRows": layout.n_y,
        "CellColumns": layout.n_x,
        "WidthX": layout.width_x,
        "WidthY": layout.width_y,
        "HalfTurn": int(layout.folded),
    }
