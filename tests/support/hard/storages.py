"""Cases of the storages: a texel from the array through the file to the shader."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.bake.images.image_io import read_image, write_image
from measured_materials.bake.images.storage import HALF_LARGEST, IMAGE_STORAGES, Storage, offset_for, raised, scale_for
from measured_materials.nodes import expr
from measured_materials.nodes.data_image import load_data_image

from .case import Array, Case, Osl

COUNT = 12
TINY = 2.0**-126  # the smallest float32 that shaders and fast arithmetic keep
# What is within reach of one scale; a texel of each is a grey and a colour.
SETS: dict[str, tuple[float, ...]] = {
    "ordinary": (0, 1e-3, 0.18, 0.5, 1, 3),
    "all zero": (0,),
    "all equal": (0.18,),
    "chrome": (0, 1e-2, 0.3, 10, 9999, 1e4),
    "above half's largest": (0, 1, HALF_LARGEST, 65520, 1e5),
    "1e30": (0, 1e26, 1e29, 1e30),
    "denormal": (0, 1e-45, 1e-40, 1e-38),
    "one bright texel": (0, 1e-6, 1e6),
}
# Half a step of each, relative to what `_step` says.
STEPS = {Storage.FLOAT32: 2.0**-24, Storage.HALF: 2.0**-11, Storage.RGBE: 2.0**-8, Storage.BYTE: 0.5 / 255}


def cases() -> list[Case]:
    """Of this module."""
    return [_case(storage) for storage in IMAGE_STORAGES]


def _values(name: str) -> Array:
    """(COUNT, 3)."""
    grey = np.resize(np.array(SETS[name], np.float32), COUNT)
    return np.stack([grey, np.roll(grey, 1), grey], -1)


def _scales(storage: Storage) -> dict[str, float]:
    """What a bake multiplies each set by."""
    return {name: scale_for(_values(name), storage) for name in SETS}


def _written(storage: Storage, folder: Path) -> Path:
    """One image, a row for each set as a bake writes a table."""
    rows = [raised(_values(name), scale, storage) for name, scale in _scales(storage).items()]
    file = folder / f"hard_{storage}{storage.suffix}"
    write_image(file, np.stack(rows), storage)
    return file


def _floors(storage: Storage) -> Array:
    """(texels, 3): what a value is rounded in parts of, half's offset, RGBE's brightest channel, a byte's largest."""
    floors = []
    for name, scale in _scales(storage).items():
        values = _values(name).astype(float)
        if storage is Storage.RGBE:
            values = np.repeat(values.max(-1, keepdims=True), 3, -1)
        elif storage is Storage.BYTE:
            values = np.full(values.shape, values.max())
        floors.append(np.maximum(values + offset_for(storage) / scale, TINY / STEPS[storage]))
    return np.concatenate(floors)


def _inputs(storage: Storage) -> tuple[Array, ...]:
    """Column and row of each texel, and what undoes its scale."""
    row, column = (a.ravel() for a in np.meshgrid(range(len(SETS)), range(COUNT), indexing="ij"))
    inverse = 1 / np.array(list(_scales(storage).values()))
    return column.astype(np.float32), row.astype(np.float32), inverse[row].astype(np.float32)


def _case(storage: Storage) -> Case:
    offset = offset_for(storage)

    def numpy(folder: Path, column: Array, row: Array, inverse: Array) -> Array:
        return (read_image(_written(storage, folder)).reshape(-1, 3) - np.float32(offset)) * inverse[:, None]

    def nodes(folder: Path, column: Any, row: Any, inverse: Any) -> Any:
        image = load_data_image(_written(storage, folder), f"hard {storage}", half=storage is Storage.HALF)
        at = (column + 0.5) * (1 / COUNT), 1 - (row + 0.5) * (1 / len(SETS))
        return expr.scale(expr.image_tap(image, *at, "Closest")[0] - expr.vec(offset, offset, offset), inverse)

    def osl(folder: Path) -> Osl:
        at = f"(column + 0.5) / {COUNT}, (row + 0.5) / {len(SETS)}"
        body = f'float a; color c = mm_tap("{_written(storage, folder)}", {at}, "closest", a) - {offset:.9g};'
        return Osl(body + "for (int k = 0; k < 3; ++k) y[k] = c[k] * inverse;", 3, ("column", "row", "inverse"))

    bound = 1.01 * STEPS[storage]
    return Case(
        "storages",
        str(storage),
        "; ".join(SETS),
        "of the value, half's offset, RGBE's brightest channel, a byte's largest",
        "half a step of the storage; below 2^-126 shaders have no numbers",
        {"float32": bound, "nodes": bound, "osl": bound},
        partial(_inputs, storage),
        lambda *inputs: np.concatenate([_values(name).astype(float) for name in SETS]),
        numpy=numpy,
        nodes=nodes,
        osl=osl,
        error=lambda found, true, *inputs: np.abs(found - true) / _floors(storage),
        low=0,
    )
