"""Spoiled files for readers: how they are spoiled, read and looked at, by one process or by several."""

from __future__ import annotations

import multiprocessing
import re
import resource
import shutil
import sys
import tempfile
import time
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.source import Array
from measured_materials.bake.sources import cornell, merl, merl_file, read_source, utia
from measured_materials.bake.sources.goniometer import scattered_source
from measured_materials.bake.sources.lookup.scattered import MIN_SAMPLES
from measured_materials.bake.sources.lookup.scattered_coordinates import Coordinates

from . import format_files as files
from . import format_variants
from .format_files import GLOSSY
from .rgl_writer import write_anisotropic_rgl

# Of one file's reading, whatever it holds: far more than any of these takes, far less than a hang.
MOST_SECONDS, MOST_BYTES = 5.0, 300 << 20
# Every so many, the memory of one reading is traced, which makes it ten times slower.
TRACED = 500
# What a process may grow by over all its files, once it has read some: caches of numpy and of Python's parser.
MOST_GROWTH = 64 << 20

_WORDS = (
    b"nan inf -inf -1 0 1e400 -1e300 999999999999 4294967296 2147483647 1e-400 0x10 1_000 \xff\xfe \x00 { } </a> <!-- "
    b"# ; , \xc2\xb2 DataBegin DataEnd enddef TIS AOI kbdf <?xml&#0; 00000000000000000000000001 .. -- +-1 1e1e1 [ ] "
    b'"materials": null true [1,2,3] #BEGIN_STREAM #FORMAT'
).split()
_WIDTH = np.array([1, 2, 4, 8, 16, 64, 1024])


@dataclass(frozen=True)
class Tally:
    """What became of spoiled files: how many were tried and read; the slowest in seconds; memory in bytes.

    peak : most that reading one of the traced files took
    growth : of the process from a tenth of the files to the end
    hangs : files that took more than `MOST_SECONDS` of processor, which are kept
    """

    tried: int
    read: int
    slowest: float
    peak: int
    growth: int
    hangs: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.tried + other.tried,
            self.read + other.read,
            max(self.slowest, other.slowest),
            max(self.peak, other.peak),
            max(self.growth, other.growth),
            self.hangs + other.hangs,
        )

    @property
    def told(self) -> str:
        """One line."""
        return (
            f"{self.tried} tried, {self.tried - self.read} clean errors, {self.read} read, {self.hangs} hangs, "
            f"slowest {self.slowest:.2f} s, peak {self.peak / 2**20:.1f} MiB, growth {self.growth / 2**20:.1f} MiB"
        )


# UTIA's files are told by their size: with these few directions they are as small as others.
FEW_UTIA: dict[str, Any] = {"THETAS": 3, "PHIS": 4, "SIDE": 12, "FILE_BYTES": 3 * 12**2 * 8}

# MERL's too, of 34 MB: these have 5.8 kB.
_FEW_MERL = (5, 6, 8)


@contextmanager
def _small_tables() -> Iterator[None]:
    """UTIA's and MERL's files are of few directions."""
    head = np.array(_FEW_MERL, "<i4").tobytes()
    with (
        mock.patch.multiple(utia, **FEW_UTIA),
        mock.patch.multiple(merl_file, DIMENSIONS=_FEW_MERL, HEADER=head),
        mock.patch.multiple(merl, DIMENSIONS=_FEW_MERL, HEADER=head),
    ):
        yield


@contextmanager
def no_fit() -> Iterator[None]:
    """Samples are not fitted, which takes seconds and is tested elsewhere: what matters is what reaches the fit.

    UTIA's files and pictures, and MERL's files, are of few directions.
    """

    def fit(wi: Array, wo: Array, values: Array) -> Any:
        assert len(wi) == len(wo) == len(values) >= MIN_SAMPLES
        assert np.isfinite(wi).all() and np.isfinite(wo).all() and np.isfinite(values).all()
        assert (wi[:, 2] > 0).all() and (wo[:, 2] > 0).all() and values.ndim == 2 and values.shape[1] in (1, 3)

        def ones(light: Array, viewer: Array) -> Array:
            above = (light[:, 2:] > 0) & (viewer[:, 2:] > 0)
            return np.repeat(above, values.shape[1], 1).astype(float)

        return SimpleNamespace(facts={}, coordinates=Coordinates(0.1), evaluate=ones)

    with (
        mock.patch.object(scattered_source, "fit_samples", fit),
        mock.patch.object(cornell, "fit_scattered", fit),
        _small_tables(),
    ):
        yield


def small_files(folder: Path) -> dict[str, Path]:
    """A small file of each format, so that a mistake in its head is as likely as one in its values."""
    made: dict[str, Path] = {}

    def place(name: str, file: str) -> Path:
        own = folder / re.sub(r"\W+", "_", name)
        own.mkdir()
        return own / file

    few = {"THETAS": [10.0, 50.0], "_OUT_THETAS": [0.0, 30.0, 60.0], "_OUT_PHIS": [0.0, 90.0, 180.0]}
    with (
        mock.patch.multiple(files, **{key: np.array(value) for key, value in few.items()}),
        _small_tables(),
    ):
        for name, (suffix, write) in files.WRITERS.items():
            target = place(name, f"sample{suffix}")
            if name == "NVIDIA MBSDF":
                made[name] = files.write_mbsdf(target, GLOSSY, 3, 4)
            elif name == "numpy array":
                np.save(target, np.full((3, 3, 4, 3), 0.2))
                made[name] = target
            elif name == "WINDOW or Radiance XML":
                made[name] = files.write_klems(target, GLOSSY, basis="Quarter")
            elif name == "UTIA":
                made[name] = target
                target.write_bytes(np.full(FEW_UTIA["FILE_BYTES"] // 8, 0.1).tobytes())
            else:
                made[name] = write(target, GLOSSY)
        made["ALTA stream"] = format_variants.write_alta_stream(place("ALTA stream", "sample.alta"), GLOSSY)
        made["Cornell goniometer"] = format_variants.write_cornell(place("Cornell goniometer", "paint.brdf"), GLOSSY)
        picture = place("UTIA picture", "m.exr")
        made["MERL"] = place("MERL", "sample.binary")
        merl.write_merl(made["MERL"], GLOSSY, "bins")
        made["UTIA picture"] = format_variants.write_utia_picture(picture, files.by_name("lambert"))
    made["tensor tree"] = files.write_tree(place("tensor tree", "tree.xml"), GLOSSY, 1)
    made["EPFL/RGL tensor"] = place("EPFL/RGL tensor", "brushed.bsdf")
    write_anisotropic_rgl(made["EPFL/RGL tensor"], GLOSSY, (0.3, 0.3), azimuths=3, elevations=3, size=4)
    made["published SGD"] = files.write_published(place("published SGD", "sgd.json"), entries=files.SGD_SET)
    return made


NAMES = (
    *files.WRITERS,
    "ALTA stream",
    "tensor tree",
    "UTIA picture",
    "Cornell goniometer",
    "EPFL/RGL tensor",
    "published SGD",
    "MERL",
)


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


def beside(original: Path, folder: Path) -> Path:
    """The path of a copy in `folder`, with the other parts of one measurement there."""
    for other in original.parent.iterdir():
        if other.is_file() and other != original:
            shutil.copy(other, folder / other.name)
    return folder / original.name


def try_many(name: str, original: Path, folder: Path, count: int, seed: int = 0) -> Tally:
    """Read so many spoiled copies. The one that raises anything else than BakeError is kept, and named."""
    data = original.read_bytes()
    path = beside(original, folder)

    def spoil(rng: np.random.Generator) -> None:
        path.write_bytes(spoiled(data, rng))

    return tallied(name, path, spoil, lambda: read_and_look(path), count, seed)


def tallied(
    name: str,
    path: Path,
    spoil: Callable[[np.random.Generator], None],
    read: Callable[[], bool],
    count: int,
    seed: int,
) -> Tally:
    """Call `spoil`, which leaves another copy at `path`, and `read`, so many times.

    A copy that raises is kept beside it, one that hangs in a new temporary folder `hang...`; both are named.
    """

    def keep(number: int, folder: str | Path) -> None:
        kept = shutil.move(path, Path(folder, f"spoiled_{seed}_{number}{path.suffix}"))
        print(f"{name}: {kept}", file=sys.stderr)

    rng = np.random.default_rng((len(name), seed))
    found, slowest, peak, settled, hangs = 0, 0.0, 0, 0, 0
    for number in range(count):
        spoil(rng)
        traced = number % TRACED == 0
        if traced:
            tracemalloc.start()
        started = time.process_time()
        try:
            found += read()
        except BaseException:
            keep(number, path.parent)
            raise
        seconds = time.process_time() - started
        slowest = max(slowest, seconds)
        if seconds > MOST_SECONDS:
            hangs += 1
            keep(number, tempfile.mkdtemp(prefix="hang"))
        if traced:
            peak = max(peak, tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        if number == count // 10:
            settled = _resident()
    tally = Tally(count, found, slowest, peak, max(_resident() - settled, 0), hangs)
    assert peak < MOST_BYTES, (name, seed, tally.told)
    return tally


def _resident() -> int:
    """Most bytes that this process has ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _part(task: tuple[str, Path, Path, int, int]) -> Tally:
    name, original, folder, count, seed = task
    own = Path(tempfile.mkdtemp(dir=folder))
    warnings.simplefilter("error")  # as pytest has it: what a reader warns of, it has not looked at
    with no_fit():
        tally = try_many(name, original, own, count, seed)
    shutil.rmtree(own)
    return tally


def try_in_parts(
    name: str,
    original: Path,
    folder: Path,
    count: int,
    processes: int,
    part: int = 12_500,
    seed: int = 0,
    one_part: Callable[[tuple[str, Path, Path, int, int]], Tally] = _part,
) -> Tally:
    """`try_many` in parts of a seed each, by so many processes; each part in a process of its own start."""
    sizes = [min(part, count - start) for start in range(0, count, part)]
    tasks = [(name, original, folder, size, seed + number) for number, size in enumerate(sizes)]
    context = multiprocessing.get_context("spawn")
    total = Tally(0, 0, 0.0, 0, 0)
    with context.Pool(processes) as pool:
        for tally in pool.imap_unordered(one_part, tasks):
            total += tally
    return total


@contextmanager
def fast_folder() -> Iterator[Path]:
    """A new temporary folder, in memory where there is such a place: half of a small file's time is its disk.

    It goes with the block, however that ends; but it stays where the block fails, for the file that did it.
    """
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="spoiled", dir=memory if memory.is_dir() else None))
    failed = False
    try:
        yield folder
    except Exception:
        failed = True
        raise
    finally:
        if not failed:
            shutil.rmtree(folder, ignore_errors=True)
