"""Numpy's own files from anybody: no pickled objects, nothing allocated that the file does not hold."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy_format

from ...errors import BakeError
from ...source import Array
from .text_file import widened

_LONGEST_HEAD = 1 << 14


def load_npy(path: Path, most: int, remedy: str) -> Array:
    """The array of numbers in a `.npy` file of at most so many bytes, float64 if it is of floats.

    Raises
    ------
    BakeError : missing, unreadable, damaged, larger, of anything else than numbers
    """
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > most:
                raise BakeError(path, f"has {size >> 20} MiB, more than {most >> 20}", remedy)
            shape, fortran, dtype = _head(path, stream, remedy)
            count = math.prod(shape)
            if dtype.hasobject or dtype.kind not in "fiu":
                # Objects are pickled, and could run code of the file's author.
                raise BakeError(path, f"cannot be read: it holds {dtype}, not numbers", remedy)
            if count * dtype.itemsize != size - stream.tell():
                held = size - stream.tell()
                raise BakeError(
                    path, f"is damaged: {count} numbers take {count * dtype.itemsize} bytes, not {held}", remedy
                )
            values = np.fromfile(stream, dtype, count).reshape(shape, order="F" if fortran else "C")
    except FileNotFoundError:
        raise BakeError(path, "is missing", remedy) from None
    except (OSError, ValueError) as error:
        raise BakeError(path, f"cannot be read ({error})", "check the path and its permissions") from error
    return widened(values) if dtype.kind == "f" else values


def _head(path: Path, stream: BinaryIO, remedy: str) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and kind of the numbers. Numpy parses a text of Python here, and raises what that leads it to."""
    try:
        version = npy_format.read_magic(stream)
        # Numpy reads as many bytes as the head claims to have, of up to 4 GiB, before it looks at their number.
        start = stream.tell()
        if int.from_bytes(stream.read(2 if version == (1, 0) else 4), "little") > _LONGEST_HEAD:
            raise ValueError
        stream.seek(start)
        read = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, fortran, dtype = read(stream)
    except Exception as error:
        raise BakeError(path, f"cannot be read ({type(error).__name__} in its head)", remedy) from error
    return tuple(int(n) for n in shape), bool(fortran), np.dtype(dtype)
