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
from ..atlas import AtlasLayout
from ..grids.half_vector_grid import MAX_SAMPLES, HalfVectorGrid
from ..grids.normal_vector_grid import MAX_RESOLUTION
from ..stored_table import StoredTable, store_table
from ..table import tabulate
from .coded_grid import LEAST_SAMPLES, CodedErrors

# Well below the second, half floats err less at the same size: codes of 8 bits are rounded (`./run bench bytes`).
LEAST_BYTES, MOST_BYTES = 1024, 1 << 20
# What does not vary is compressed without end, and more samples of it serve nothing. (GGX of alpha 0.15 has five texels
# in each byte of 390 kB.)
_TEXELS_OF_BYTE = 16
# A file of N = 8 takes about so many bytes. An axis grows with this power of them, where warps stay as they are; N, of
# tables that each have their own, with the other.
_BYTES_OF_8, _POWER, _POWER_OF_N = 2700, 0.36, 0.43
_TRIES, _SPENT, _STEP = 8, 3, 1.03


def resolution_for(most_bytes: int) -> int:
    """N of a table of codes of about so many bytes."""
    return int(np.clip(round(8 * (most_bytes / _BYTES_OF_8) ** _POWER_OF_N), LEAST_SAMPLES, MAX_RESOLUTION))


def file_bytes(kept: StoredTable) -> int:
    """Of a table of codes, as `image_io.write_image` writes it."""
    return len(png_bytes(np.rint(kept.image().pixels * 255).astype(np.uint8)))


def grid_within(source: BrdfSource, grid: Any, most_bytes: float, pairs: DirectionPairs, truth: Array) -> Any:
    """An isotropic grid with as many samples as fit, in about the same proportions; `least_grid` where none does.

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

    best = least = least_grid(grid)
    most_texels = max(most_bytes * _TEXELS_OF_BYTE, np.prod(least.shape))
    widest = MAX_SAMPLES / LEAST_SAMPLES
    while not _is_held(largest := _scaled(grid, widest), most_texels):
        widest /= _STEP
    scale = min(1.0, widest)
    trial = _scaled(grid, scale)
    for _ in range(_TRIES):
        size, _range = measure(trial)
        if size <= most_bytes and np.prod(trial.shape) >= np.prod(best.shape):
            best = trial
        ratio = (most_bytes / size) ** _POWER
        if trial == (largest if ratio > 1 else least):
            break
        scale = min(scale * ratio, widest)
        # Small sizes are rounded to the same ones again.
        while (following := _scaled(grid, scale)) == trial:
            scale = min(scale * _STEP, widest) if ratio > 1 else scale / _STEP
        if following in measured:
            break
        trial = following
    if not isinstance(best, HalfVectorGrid):
        return best
    errors = CodedErrors(source, pairs, truth, measure(best)[1])
    for _ in range(_SPENT):
        larger = [trial for trial in map(_one_more(best), range(3)) if _is_held(trial, most_texels)]
        grown = [trial for trial in larger if measure(trial)[0] <= most_bytes]
        better = min(grown, key=errors, default=best)
        if errors(better) >= errors(best):
            break
        best = better
    return best


def least_grid(grid: Any) -> Any:
    """The same with as few samples as an axis may have."""
    return _scaled(grid, 0.0)


def _is_held(grid: Any, most_texels: float) -> bool:
    """By a texture, and by a bundle, whose reader refuses longer axes."""
    in_reach = max(grid.shape) <= MAX_SAMPLES and np.prod(grid.shape) <= most_texels
    return bool(in_reach and AtlasLayout(grid.shape).is_texture)


def _scaled(grid: Any, scale: float) -> Any:
    """With each axis so many times as long, within what it may have."""
    if not isinstance(grid, HalfVectorGrid):
        return replace(grid, n=int(np.clip(round(grid.n * scale), LEAST_SAMPLES, MAX_RESOLUTION)))
    sizes = tuple(int(np.clip(round(n * scale), LEAST_SAMPLES, MAX_SAMPLES)) for n in grid.sizes)
    return replace(grid, sizes=sizes)  # type: ignore[arg-type]


def _one_more(grid: HalfVectorGrid) -> Any:
    """Of an axis, a sixteenth more samples."""

    def grown(axis: int) -> HalfVectorGrid:
        sizes = tuple(n + max(n // 16, 1) * (k == axis) for k, n in enumerate(grid.sizes))
        return replace(grid, sizes=sizes)  # type: ignore[arg-type]

    return grown
