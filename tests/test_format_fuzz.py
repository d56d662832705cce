"""Spoiled files of every further format: a clean error or a source, never a crash, a hang or much memory."""

from __future__ import annotations

import contextlib
import runpy
import shutil
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sources import READERS, merl, read_source
from support import fuzz
from support.fuzz import NAMES, read_and_look

FEW, MANY = 150, 100_000
PROCESSES = 2


@pytest.fixture(autouse=True)
def no_fit() -> Iterator[None]:
    with fuzz.no_fit():
        yield


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return fuzz.small_files(tmp_path_factory.mktemp("small"))


@pytest.mark.parametrize("name", NAMES)
def test_spoiled_files_end_in_a_clean_error_or_a_source(name: str, small: dict[str, Path], tmp_path: Path) -> None:
    tally = fuzz.try_many(name, small[name], tmp_path, FEW)
    # Else the changes are too weak, or the original is refused too.
    assert tally.tried - tally.read > FEW // 10 and tally.tried == FEW and not tally.hangs
    path = tmp_path / small[name].name
    path.write_bytes(small[name].read_bytes())
    assert read_and_look(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_hundred_thousand_spoiled_files(name: str, small: dict[str, Path]) -> None:
    """By two processes a minute or two for each format; what a file does alone is asserted where it is read."""
    with fuzz.fast_folder() as folder:
        tally = fuzz.try_in_parts(name, small[name], folder, MANY, PROCESSES)
    print(f"{name}: {tally.told}")
    assert tally.tried == MANY and 0 < tally.read < MANY
    assert tally.growth < fuzz.MOST_GROWTH and not tally.hangs
    shutil.rmtree(folder)  # not where a spoiled file is kept there


@pytest.mark.parametrize("name", NAMES)
def test_every_truncation_is_clean(name: str, small: dict[str, Path], tmp_path: Path) -> None:
    data = small[name].read_bytes()
    path = fuzz.beside(small[name], tmp_path)
    for size in np.unique(np.linspace(0, len(data) - 1, 60).astype(int)):
        path.write_bytes(data[:size])
        read_and_look(path)


def _claims() -> Iterator[tuple[str, bytes]]:
    """Heads that promise far more than there is."""
    huge = np.array([1, 2**31 - 1, 2**31 - 1], "<u4").tobytes()
    yield ".mbsdf", b"NVIDIA ARC MBSDF V1\nMBSDF_DATA_REFLECTION=\n" + huge
    yield ".npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (9999, 9999, 9999, 3), }\n"
    # Seen by `./run fuzz`: numpy read 1.6 GiB of head.
    yield ".npy", b"\x93NUMPY\x02\x00\x00\x00\x00\x64" + b"{'descr': '<f8'}"
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


SIGNALS = np.frombuffer(b"\x01\x00\x80\x7f", "<f4")  # a NaN that signals: numpy warns where it is made a float64


def test_a_nan_that_signals_is_refused_without_a_warning(tmp_path: Path) -> None:
    """Seen by `./run fuzz`: RuntimeWarning, invalid value encountered in cast."""
    table = SIGNALS.repeat(3 * 3 * 4 * 3).reshape(3, 3, 4, 3)
    np.save(tmp_path / "a.npy", table)
    head = b"NVIDIA ARC MBSDF V1\nMBSDF_DATA_REFLECTION=\n" + np.array([1, 3, 4], "<u4").tobytes()
    (tmp_path / "a.mbsdf").write_bytes(head + table.tobytes())
    network = fuzz.files.write_network(tmp_path / "net.npy")
    np.save(network, SIGNALS.repeat(6 * 21).reshape(6, 21))
    for path in (tmp_path / "a.npy", tmp_path / "a.mbsdf", network):
        with pytest.raises(BakeError):
            read_source(path)
    tensors = tmp_path / "a.bsdf"
    fuzz.write_anisotropic_rgl(tensors, fuzz.GLOSSY, (0.3, 0.3), azimuths=3, elevations=3, size=4)
    data = bytearray(tensors.read_bytes())
    # Behind the name: dimensions, kind, where it begins. Of several numpy makes one that does not signal.
    after = data.index(b"vndf") + len(b"vndf") + 3
    entry = int.from_bytes(data[after : after + 8], "little") + 4 * 142
    data[entry : entry + 4] = SIGNALS.tobytes()
    tensors.write_bytes(data)
    with pytest.raises(BakeError, match="'vndf' has values that are not finite"):
        read_source(tensors)
    merl.write_merl(tmp_path / "m.binary", fuzz.GLOSSY, "bins")
    data = np.fromfile(tmp_path / "m.binary", "<f8", offset=12).astype("<f4")
    data[100::7] = SIGNALS
    (tmp_path / "m.binary").write_bytes(merl.HEADER + data.tobytes())
    merl.read(tmp_path / "m.binary")


def test_merl_of_any_head_is_clean(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    path = tmp_path / "x.binary"
    for _ in range(100):
        head = rng.integers(-400, 400, 3).astype(rng.choice(["<i4", ">i4"])).tobytes()
        path.write_bytes(head + rng.bytes(int(rng.integers(0, 4000))))
        with pytest.raises(BakeError):
            merl.read(path)


VARIANTS = {
    "EPFL/RGL tensor": "RGL",
    "tensor tree": "WINDOW or Radiance XML",
    "ALTA stream": "ALTA",
    "UTIA picture": "UTIA",
    "published SGD": "published SGD or ABC fit",
}


def test_readers_do_not_claim_each_others_files(small: dict[str, Path]) -> None:
    for name, path in small.items():
        claimed = [reader.name for reader in READERS if reader.matches(path, path.read_bytes()[:64])]
        assert claimed == [VARIANTS.get(name, name)]


@pytest.mark.parametrize(
    ("ends", "stays"), [(None, False), (KeyboardInterrupt, False), (SystemExit, False), (OSError, True)]
)
def test_only_a_failure_leaves_its_folder(ends: type[BaseException] | None, stays: bool) -> None:
    with contextlib.suppress(BaseException), fuzz.fast_folder() as folder:
        (folder / "spoiled").touch()
        if ends is not None:
            raise ends
    assert folder.exists() == stays
    shutil.rmtree(folder, ignore_errors=True)


def test_a_mistyped_format_is_refused_before_any_file_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["fuzz", "no such format"])
    made: list[None] = []
    monkeypatch.setattr(fuzz, "fast_folder", lambda: made.append(None))
    with pytest.raises(SystemExit, match="no format is called no such format; there are: "):
        runpy.run_path(str(Path(__file__).parent / "fuzz" / "__main__.py"), run_name="__main__")
    assert not made


def test_a_file_that_hangs_is_counted_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the run goes on."""
    monkeypatch.setattr(fuzz, "MOST_SECONDS", 0.05)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    path, numbers = tmp_path / "a.brdf", iter(range(4))

    def spoil(rng: np.random.Generator) -> None:
        path.write_text(str(next(numbers)))

    def read() -> bool:
        until = time.process_time() + (0.1 if path.read_text() == "2" else 0)
        while time.process_time() < until:
            pass
        return True

    tally = fuzz.tallied("a", path, spoil, read, 4, 7)
    assert (tally.tried, tally.read, tally.hangs) == (4, 4, 1) and "1 hangs" in tally.told
    (kept,) = tmp_path.glob("hang*/spoiled_7_2.brdf")
    assert kept.read_text() == "2" and (tally + tally).hangs == 2


def test_of_each_format_the_most_files_are_kept_and_all_are_one_table(tmp_path: Path) -> None:
    """A shorter run does not take the place of a longer one."""
    tried = runpy.run_path(str(Path(__file__).parent / "fuzz" / "tried.py"))
    kept = tmp_path / "tried.json"
    tried["keep"].__globals__["FILE"] = kept
    tried["keep"]("UTIA", fuzz.Tally(1000, 100, 0.25, 3 << 20, 65 << 20))
    tried["keep"]("UTIA", fuzz.Tally(900, 200, 0.5, 3 << 20, 1 << 20))
    tried["keep"]("ALTA", fuzz.Tally(500, 50, 0.125, 1 << 20, 0, 2))
    assert [one["tried"] for one in tried["kept"]().values()] == [500, 1000]
    head, alta, utia, total = tried["table"]().splitlines()
    assert alta.split()[:9] == ["ALTA", "500", "450", "50", "2", "0", "0.12", "1.0", "0.0"]
    assert utia.split()[1:6] == ["1000", "900", "100", "0", "1"]
    assert head.split()[:2] == ["tried", "clean"] and total.startswith("2 formats: 1500 tried, 1350 clean errors")
