"""Parameters of the OSL shaders that describe a table, its grid, its cells and its textures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..bake.brdf.parts import StoredTableRecord
from ..bake.brdf.samplers import Layout
from ..bake.envelope import ShareLayout, SlopeShareLayout
from ..bake.errors import BakeError
from ..bake.sampling.half_vector_cells import SamplerLayout
from ..bake.sampling.half_vector_warp import HalfVectorWarp
from ..bake.sampling.slope_warp import SlopeWarp
from ..bake.tables.atlas import AtlasLayout
from ..bake.tables.grids.grid import Grid
from ..bake.tables.log_codes import LogCodes

# Parameters of a sampler's bins and cells.
CELLS = ("Bins", "BinsPhi", "CellRows", "CellColumns", "Warp", "WidthX", "WidthY", "HalfTurn", "Strata", "Linear")


def texture_file(file: Path) -> str:
    """Whole path of an image, for OSL to read. Raises BakeError."""
    path = file.resolve()
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
    layout = AtlasLayout.of(grid)
    return {**grid.shader_constants(), "Columns": layout.columns, "Rows": layout.rows}


def cell_constants(layout: Layout) -> dict[str, Any]:
    """Those of a sampler's bins and cells."""
    if isinstance(layout, (SamplerLayout, HalfVectorWarp)):
        sizes = {"Bins": layout.n_o, "CellRows": layout.n_h, "CellColumns": layout.n_phi}
        if isinstance(layout, SamplerLayout):
            return {**sizes, "Warp": layout.warp_power}
        return {**sizes, "Strata": layout.strata, "Linear": layout.linear}
    return {
        "Bins": layout.n_theta,
        "BinsPhi": layout.n_phi,
        "CellRows": layout.n_y,
        "CellColumns": layout.n_x,
        "WidthX": layout.width_x,
        "WidthY": layout.width_y,
        "HalfTurn": int(layout.folded),
        **({"Strata": layout.strata} if isinstance(layout, SlopeWarp) else {}),
    }


def share_constants(layout: ShareLayout | SlopeShareLayout) -> dict[str, Any]:
    """Those that say where the shares of one lamp's light lie in their image."""
    if isinstance(layout, SlopeShareLayout):
        return {f"Share{name}": value for name, value in cell_constants(layout.slopes).items()}
    return {"ShareBins": layout.n_o, "ShareCellRows": layout.n_d, "ShareCellColumns": layout.n_h}
