"""The largest table of codes whose file takes no more than so many bytes.

What PNG makes of a table is not known before it is written, and resolutions are steps: from N = 7 to 8 a file grows by
a half. So the sizes of all axes are scaled, written and scaled again, and what is left is spent on the axis that gains
most.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...images.png import png_bytes
from ...images.storage import Storage
from ...source import Array, BrdfSource
from ..accuracy import DirectionPairs
from ..grids.half_vector_grid import HalfVectorGrid
from ..grids.normal_vector_grid import MAX_RESOLUTION
from ..stored_table import StoredTable, store_table
from ..table import tabulate
from .coded_grid import CodedErrors

LEAST_BYTES = 1024
_LEAST = 4  # samples of an axis
# A file of N = 8 takes about so many bytes. An axis grows with this power of them, where warps stay as they are; N, of
# tables that each have their own, with the other.
_BYTES_OF_8, _POWER, _POWER_OF_N = 2700, 0.36, 0.43
_TRIES, _SPENT, _STEP = 8, 3, 1.03


def resolution_for(most_bytes: int) -> int:
    """N of a table of codes of about so many bytes."""
    return int(np.clip(round(8 * (most_bytes / _BYTES_OF_8) ** _POWER_OF_N), _LEAST, MAX_RESOLUTION))


def file_bytes(kept: StoredTable) -> int:
    """Of a table of codes, as `image_io.write_image` writes it."""
    return len(png_bytes(np.rint(kept.image().pixels * 255).astype(np.uint8)))


def grid_within(source: BrdfSource, grid: Any, most_bytes: float, pairs: DirectionPairs, truth: Array) -> Any:
    """An isotropic grid with as many samples as fit, in about the same proportions.

    Parameters
    ----------
    most_bytes : of the file of codes of samples; fitted ones take 0 to 10 % more
    pairs, truth : as of `stored_table.store_table`
    """
    measured: dict[Any, tuple[int, float]] = {}

    def measure(trial: Any) -> tuple[int, float]:
        """Bytes, and the range of codes."""
        if trial not in measured:
            kept = store_table(tabulate(source, trial), Storage.LOG, pairs, truth)
            assert kept.table.log is not None
            measured[trial] = file_bytes(kept), float(np.mean(kept.table.log.ranges))
        return measured[trial]

    scale, best = 1.0, _scaled(grid, 0.0)
    trial = grid
    for _ in range(_TRIES):
        size, _range = measure(trial)
        if size <= most_bytes and np.prod(trial.shape) >= np.prod(best.shape):
            best = trial
        ratio = (most_bytes / size) ** _POWER
        scale *= ratio
        # Small sizes are rounded to the same ones again.
        while (following := _scaled(grid, scale)) == trial:
            scale *= _STEP if ratio > 1 else 1 / _STEP
        if following in measured:
            break
        trial = following
    if not isinstance(best, HalfVectorGrid):
        return best
    errors = CodedErrors(source, pairs, truth, measure(best)[1])
    for _ in range(_SPENT):
        grown = [trial for trial in map(_one_more(best), range(3)) if measure(trial)[0] <= most_bytes]
        better = min(grown, key=errors, default=best)
        if errors(better) >= errors(best):
            break
        best = better
    return best


def _scaled(grid: Any, scale: float) -> Any:
    """With each axis so many times as long."""
    if not isinstance(grid, HalfVectorGrid):
        return replace(grid, n=int(np.clip(round(grid.n * scale), _LEAST, MAX_RESOLUTION)))
    return replace(grid, sizes=tuple(max(round(n * scale), _LEAST) for n in grid.sizes))  # type: ignore[arg-type]


def _one_more(grid: HalfVectorGrid) -> Any:
    """Of an axis, a sixteenth more samples."""

    def grown(axis: int) -> HalfVectorGrid:
        sizes = tuple(n + max(n // 16, 1) * (k == axis) for k, n in enumerate(grid.sizes))
        return replace(grid, sizes=sizes)  # type: ignore[arg-type]

    return grown
