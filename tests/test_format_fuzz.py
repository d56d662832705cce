"""Spoiled files of every further format: a clean error or a source, never a crash, a hang or much memory."""

from __future__ import annotations

import re
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.source import Array
from measured_materials.bake.sources import READERS, merl, read_source
from measured_materials.bake.sources.goniometer import scattered_source
from measured_materials.bake.sources.lookup.scattered import MIN_SAMPLES
from measured_materials.bake.sources.lookup.scattered_coordinates import Coordinates
from support import format_files as files
from support.format_files import GLOSSY

FEW, MANY = 150, 100_000
# Of one file's reading, whatever it holds: far more than any of these takes, far less than a hang.
MOST_SECONDS, MOST_BYTES = 5.0, 300 << 20

_WORDS = (
    b"nan inf -inf -1 0 1e400 -1e300 999999999999 4294967296 2147483647 1e-400 0x10 1_000 \xff\xfe \x00 { } </a> <!-- "
    b"# ; , \xc2\xb2 DataBegin DataEnd enddef TIS AOI kbdf <?xml&#0; 00000000000000000000000001 .. -- +-1 1e1e1"
).split()
_WIDTH = np.array([1, 2, 4, 8, 16, 64, 1024])


@pytest.fixture(autouse=True)
def no_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples are not fitted, which takes seconds and is tested elsewhere: what matters is what reaches the fit."""

    def fit(wi: Array, wo: Array, values: Array) -> Any:
        assert len(wi) == len(wo) == len(values) >= MIN_SAMPLES
        assert np.isfinite(wi).all() and np.isfinite(wo).all() and np.isfinite(values).all()
        assert (wi[:, 2] > 0).all() and (wo[:, 2] > 0).all() and values.ndim == 2 and values.shape[1] in (1, 3)

        def ones(light: Array, viewer: Array) -> Array:
            return np.ones((len(light), values.shape[1]))

        return SimpleNamespace(facts={}, coordinates=Coordinates(0.1), evaluate=ones)

    monkeypatch.setattr(scattered_source, "fit_samples", fit)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A small file of each format, so that a mistake in its head is as likely as one in its values."""
    folder, made = tmp_path_factory.mktemp("small"), {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "THETAS", np.array([10.0, 50.0]))
        patch.setattr(files, "_OUT_THETAS", np.array([0.0, 30.0, 60.0]))
        patch.setattr(files, "_OUT_PHIS", np.array([0.0, 90.0, 180.0]))
        for name, (suffix, write) in files.WRITERS.items():
            if name == "NVIDIA MBSDF":
                made[name] = files.write_mbsdf(folder / f"{name}{suffix}", GLOSSY, 3, 4)
            elif name == "numpy array":
                np.save(folder / "array.npy", np.full((3, 3, 4, 3), 0.2))
                made[name] = folder / "array.npy"
            elif name != "UTIA":  # its size alone makes it one
                (folder / name.split()[0]).mkdir()
                made[name] = write(folder / name.split()[0] / f"sample{suffix}", GLOSSY)
    made["tensor tree"] = files.write_tree(folder / "tree.xml", GLOSSY, 1)
    return made


def spoiled(data: bytes, rng: np.random.Generator) -> bytes:
    """One to four changes: bytes, words of a text, pieces lost, doubled, exchanged or put elsewhere."""
    for _ in range(rng.integers(1, 5)):
        if not data:
            break
        at, kind = int(rng.integers(0, len(data))), rng.integers(0, 7)
        # Half of the changes happen in the head.
        at = at % min(len(data), 600) if rng.random() < 0.5 else at
        width = int(rng.choice(_WIDTH))
        piece = data[at : at + width]
        if kind == 0:
            data = data[:at] + bytes([int(rng.integers(0, 256))]) + data[at + 1 :]
        elif kind == 1:
            data = data[:at] + data[at + width :]
        elif kind == 2:
            data = data[:at] + piece * int(rng.integers(2, 5)) + data[at:]
        elif kind == 3:
            to = int(rng.integers(0, len(data)))
            data = data[:to] + piece + data[to:]
        elif kind == 4:
            words = list(re.finditer(rb"[^\s,;{}<>]+", data[at : at + 400]))
            if words:
                word = words[int(rng.integers(0, len(words)))]
                data = data[: at + word.start()] + _WORDS[int(rng.integers(0, len(_WORDS)))] + data[at + word.end() :]
        elif kind == 5:
            data = data[:at]
        else:
            number = int(rng.integers(-(2**31), 2**31)) if rng.random() < 0.5 else int(rng.integers(-3, 300))
            data = data[:at] + int(number).to_bytes(4, "little", signed=True) + data[at + 4 :]
    return data


def read_and_look(path: Path) -> bool:
    """Whether it was read; then its values are finite, of the right shape, and 0 below the horizon."""
    wi, wo = spherical(np.array([0.1, 0.8, 2.0]), np.array([0.0, 2.0, 1.0])), spherical(0.6, np.array([0.3, 4.0, 1.0]))
    try:
        source = read_source(path)
        value = source.evaluate(wi, wo)
    except BakeError as error:
        assert "\n" not in str(error) and str(path.parent) in str(error)
        return False
    assert value.shape == (3, 3) and np.isfinite(value).all() and (value[2] == 0).all()
    assert np.isfinite(np.array([v for v in source.facts.values() if isinstance(v, float)])).all()
    return True


def try_many(name: str, original: Path, folder: Path, count: int) -> tuple[int, int]:
    """How many of so many spoiled copies were read and refused."""
    data, rng = original.read_bytes(), np.random.default_rng(len(name))
    path = folder / original.name
    for other in original.parent.iterdir():  # the other parts of one measurement
        if other.is_file() and other != original:
            (folder / other.name).write_bytes(other.read_bytes())
    read = 0
    for number in range(count):
        path.write_bytes(spoiled(data, rng))
        started = time.process_time()
        try:
            read += read_and_look(path)
        except BaseException:
            kept = folder / f"spoiled_{number}{path.suffix}"
            kept.write_bytes(path.read_bytes())
            print(f"{name}: {kept}")
            raise
        assert time.process_time() - started < MOST_SECONDS, (name, number)
    return read, count - read


NAMES = [*(name for name in files.WRITERS if name != "UTIA"), "tensor tree"]


@pytest.mark.parametrize("name", NAMES)
def test_spoiled_files_end_in_a_clean_error_or_a_source(name: str, small: dict[str, Path], tmp_path: Path) -> None:
    read, refused = try_many(name, small[name], tmp_path, FEW)
    # Else the changes are too weak, or the original is refused too.
    assert refused > FEW // 10 and read + refused == FEW
    path = tmp_path / small[name].name
    path.write_bytes(small[name].read_bytes())
    assert read_and_look(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_hundred_thousand_spoiled_files(name: str, small: dict[str, Path], tmp_path: Path) -> None:
    tracemalloc.start()
    read, refused = try_many(name, small[name], tmp_path, MANY)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"{name}: {MANY} tried, {refused} clean errors, {read} read, peak {peak >> 20} MiB")
    assert peak < MOST_BYTES


@pytest.mark.parametrize("name", NAMES)
def test_every_truncation_is_clean(name: str, small: dict[str, Path], tmp_path: Path) -> None:
    data = small[name].read_bytes()
    path = tmp_path / small[name].name
    for other in small[name].parent.iterdir():
        if other.is_file() and other != small[name]:
            (tmp_path / other.name).write_bytes(other.read_bytes())
    for size in np.unique(np.linspace(0, len(data) - 1, 60).astype(int)):
        path.write_bytes(data[:size])
        read_and_look(path)


def _claims() -> Iterator[tuple[str, bytes]]:
    """Heads that promise far more than there is."""
    huge = np.array([1, 2**31 - 1, 2**31 - 1], "<u4").tobytes()
    yield ".mbsdf", b"NVIDIA ARC MBSDF V1\nMBSDF_DATA_REFLECTION=\n" + huge
    yield ".npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (9999, 9999, 9999, 3), }\n"
    zemax = "Source M Symmetry PlaneSymmetrical SpectralContent Monochrome ScatterType BRDF\nSampleRotation 1\n0\n"
    lists = "".join(f"{k} 2000\n" + " ".join(f"{i * 90 / 2000}" for i in range(2000)) + "\n" for k in _ZEMAX)
    yield ".bsdf", ("\n".join(zemax.split(" M ")).replace("Source\n", "Source M\n") + lists).encode()
    yield ".xml", b"<WindowElement>" + b"<a>" * 100_000
    deep = b"<ScatteringData>" + b"{" * 100_000 + b"</ScatteringData>"
    yield ".xml", b"<WindowElement><IncidentDataStructure>TensorTree4</IncidentDataStructure>" + deep


_ZEMAX = ("AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")


@pytest.mark.parametrize(("suffix", "data"), list(_claims()))
def test_what_promises_too_much_takes_no_memory(suffix: str, data: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"huge{suffix}"
    path.write_bytes(data)
    tracemalloc.start()
    with pytest.raises(BakeError):
        read_source(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100 << 20


def test_an_entity_in_xml_is_not_expanded(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    path.write_text('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><WindowElement>&b;</WindowElement>')
    with pytest.raises(BakeError, match="declares entities"):
        read_source(path)


def test_pickled_objects_are_not_loaded(tmp_path: Path) -> None:
    path = tmp_path / "x.npy"
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(BakeError, match="cannot be read"):
        read_source(path)


def test_merl_of_any_head_is_clean(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    path = tmp_path / "x.binary"
    for _ in range(100):
        head = rng.integers(-400, 400, 3).astype(rng.choice(["<i4", ">i4"])).tobytes()
        path.write_bytes(head + rng.bytes(int(rng.integers(0, 4000))))
        with pytest.raises(BakeError):
            merl.read(path)


def test_readers_do_not_claim_each_others_files(small: dict[str, Path]) -> None:
    for name, path in small.items():
        claimed = [reader.name for reader in READERS if reader.matches(path, path.read_bytes()[:64])]
        assert claimed == ["WINDOW or Radiance XML" if name == "tensor tree" else name]
