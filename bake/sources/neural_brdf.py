"""Weights of Neural-BRDF (Sztrajman, Rainer, Ritschel & Weyrich 2021, "Neural BRDF Representation and Importance
Sampling"): the published networks of one material each.

Layouts, from asztr/Neural-BRDF (MIT): a Keras `.h5` with the groups dense_1 to dense_3, each a kernel (in, out) and a
bias; or six files NAMEfc1.npy to NAMEfc3.npy, NAMEb1.npy to NAMEb3.npy, of which any may be given. Two hidden layers
with ReLU, output exp(x) - 1, read as 0 where it is below (as its Mitsuba plugin does; Keras does not). Input are the
half vector, its azimuth set to 0, and the difference vector of the *light*; the value is in 1/sr, linear RGB.

The networks were trained on MERL tables whose entries were taken at their lower edges, half a step from where the
measurement's authors have them; `facts` say so.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BakeError
from ..source import Array, Json, Reader
from .lookup.lookup_source import LookupSource
from .lookup.npy_file import load_npy
from .lookup.text_file import widened

LAYERS = 3
_INPUTS, _OUTPUTS, _MOST_UNITS = 6, 3, 1024
_MOST_BYTES = 64 << 20
_MOST_WEIGHT, _MOST_EXPONENT = 1e6, 18.0
_HDF5 = b"\x89HDF\r\n\x1a\n"
_PART = re.compile(r"^(?P<base>.*?)(?P<kind>fc|b)(?P<layer>[123])\.npy$")
_REMEDY = "give the weights as Neural-BRDF publishes them: an .h5, or six .npy files of one name"

Layer = tuple[Array, Array]


def read(path: Path) -> LookupSource:
    """Read a network.

    Raises
    ------
    BakeError : damaged, of other layers, a part is missing, or an .h5 where no library reads these
    """
    layers = _checked(path, _from_npy(path) if path.suffix.lower() == ".npy" else _from_h5(path))
    match = _PART.match(path.name)
    name = (match["base"].rstrip("_-. ") if match else "") or path.stem

    def lookup(wi: Array, wo: Array) -> Array:
        return network(layers, half_and_difference(wi, wo))

    facts: dict[str, Json] = {
        "format": "Neural-BRDF",
        "weights": int(sum(kernel.size + bias.size for kernel, bias in layers)),
        "layers": [int(kernel.shape[1]) for kernel, _ in layers],
        "trained_on": "MERL entries at their lower edges, half a step from their centres",
    }
    return LookupSource(name, lookup, facts, isotropic=True, bilateral=False)


def half_and_difference(wi: Array, wo: Array) -> Array:
    """(n, 6): half vector with its azimuth set to 0, and the light in the half vector's frame."""
    half = wi + wo
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    sine = np.hypot(half[:, 0], half[:, 1])
    safe = np.where(sine > 0, sine, 1.0)
    c, s = np.where(sine > 0, half[:, 0] / safe, 1.0), half[:, 1] / safe
    x, y = c * wi[:, 0] + s * wi[:, 1], c * wi[:, 1] - s * wi[:, 0]
    z = half[:, 2]
    difference = z * x - sine * wi[:, 2], y, sine * x + z * wi[:, 2]
    return np.stack([sine, np.zeros_like(sine), z, *difference], -1)


def network(layers: list[Layer], x: Array) -> Array:
    """BRDF in 1/sr of inputs (n, 6), (n, 3) >= 0."""
    for number, (kernel, bias) in enumerate(layers, 1):
        x = x @ kernel + bias
        if number < LAYERS:
            x = np.maximum(x, 0)
    return np.maximum(np.expm1(np.minimum(x, _MOST_EXPONENT)), 0)


def _from_npy(path: Path) -> list[Layer]:
    match = _PART.match(path.name)
    if match is None:
        raise BakeError(path, "is not named as a part of a network (fc1 to fc3, b1 to b3)", _REMEDY)
    return [
        (_part(path, f"{match['base']}fc{n}.npy"), _part(path, f"{match['base']}b{n}.npy"))
        for n in range(1, LAYERS + 1)
    ]


def _part(path: Path, name: str) -> Array:
    """One of the six arrays, which stand beside each other."""
    return load_npy(path.with_name(name), _MOST_BYTES, _REMEDY)


def _from_h5(path: Path) -> list[Layer]:
    library = _hdf5_library()
    if library is None:
        cause = "is an HDF5 file, which neither Blender nor numpy reads"
        raise BakeError(path, cause, "install h5py or pyfive, or give the network's six .npy files")
    try:
        with path.open("rb") as stream, library.File(stream) as file:
            return [
                (_dataset(file, f"dense_{n}/dense_{n}/kernel:0"), _dataset(file, f"dense_{n}/dense_{n}/bias:0"))
                for n in range(1, LAYERS + 1)
            ]
    except BakeError:
        raise
    # Both libraries raise whatever a damaged file leads them to.
    except Exception as error:
        raise BakeError(path, f"is no such network ({type(error).__name__}: {str(error)[:60]})", _REMEDY) from error


def _hdf5_library() -> Any:
    """h5py, or pyfive, which is pure Python; neither comes with Blender."""
    try:
        import h5py

        return h5py
    except ImportError:
        pass
    try:
        import pyfive

        return pyfive
    except ImportError:
        return None


def _dataset(file: Any, name: str) -> Array:
    """A dataset, whether Keras put the weights below `model_weights` or not."""
    root = file["model_weights"] if "model_weights" in file else file
    return np.asarray(root[name][...])


def _checked(path: Path, layers: list[Layer]) -> list[Layer]:
    width = _INPUTS
    result = []
    for number, (kernel, bias) in enumerate(layers, 1):
        shapes = f"{kernel.shape} and {bias.shape}"
        if kernel.ndim != 2 or bias.shape != kernel.shape[1:] or kernel.shape[0] != width:
            raise BakeError(path, f"layer {number} has shapes {shapes}, {width} inputs are expected", _REMEDY)
        if kernel.dtype.kind != "f" or bias.dtype.kind != "f" or not 0 < kernel.shape[1] <= _MOST_UNITS:
            raise BakeError(path, f"layer {number} holds no usable weights", _REMEDY)
        if not (np.abs(kernel).max() <= _MOST_WEIGHT and np.abs(bias).max() <= _MOST_WEIGHT):
            raise BakeError(path, f"layer {number} holds weights that are not finite or out of range", _REMEDY)
        width = kernel.shape[1]
        result.append((widened(kernel), widened(bias)))
    if width != _OUTPUTS:
        raise BakeError(path, f"the network has {width} outputs instead of {_OUTPUTS}", _REMEDY)
    return result


def _matches(path: Path, head: bytes) -> bool:
    if head.startswith(_HDF5):
        return True
    return head.startswith(b"\x93NUMPY") and _PART.match(path.name) is not None


READER = Reader("Neural-BRDF", (".h5", ".npy"), _matches, lambda path, reading: read(path))
