"""Spoiled bundles: documents, images and folders as an attacker leaves them, checksums made right again.

What a bundle can do to its reader is a BakeError of one line, or to be read; it takes bounded time and memory, and
nothing outside its folder is touched.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.addon.summary.parts import parts_of
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import MATERIAL, PREVIEW, move_bundle, read_bundle, staging
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import read_image, write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.record import ShadingMapRecord, read_record
from measured_materials.bake.source import SHEET_PARTS
from measured_materials.bake.sources.analytic import by_name

from .coarse_bakes import coarse_bakes
from .fuzz import Tally, spoiled, tallied
from .relief import bumps, lights, photographs

_SAMPLER = SamplerLayout(n_o=4, n_h=4, n_phi=4)
_SMALL: dict[str, Any] = {"resolution": 4, "sampler": _SAMPLER}
_LARGEST_PREVIEW = 1 << 24
# In the place of a value of the document.
HOSTILE: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 3, 0.5, -0.5, 1e-300, 1e300, -1e300, 1 << 31, 1 << 53, 10**40, 10**400),
    *(
        "",
        "a",
        "..",
        "../outside/canary.txt",
        "/etc/passwd",
        "table",
        "half",
        "log",
        "\x00",
        "a\nb",
        "\ud800",
        "x" * 5000,
    ),
    *([], [0], [[]], [1e308] * 4, [None], [[1, 2], [3]], [0.0] * 10_000, {}, {"a": {}}, {"images": {}}),
)
# In the place of all values of an image.
_PIXELS: tuple[float, ...] = (0.0, 1.0, -1.0, 6e4, np.nan, np.inf, 1e-7)


_GOLD: dict[str, Any] = {"alpha": 0.3, "f0": (0.9, 0.6, 0.3)}
# What is not searched for is not spoiled less.
_QUICK: dict[str, Any] = {"basis": "normal", "parameterization": "bezier", "alpha": (0.5, 0.3)}
# Formulas, their parameters and the settings of a kind's bundle, which together have all images and entries.
_BRDFS: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "isotropic": ("ggx", _GOLD, {"basis": "half", "parameterization": "fitted"}),
    "codes": ("ggx", _GOLD, _QUICK | {"storage": Storage.LOG}),
    "spline": ("lambert", {}, _QUICK | {"envelope": False, "filter": "bspline"}),
    "anisotropic": ("ggx", _GOLD | {"alpha_y": 0.5}, {"viewers": (3, 2)}),
    "sheet": ("thin-cloth", {}, _QUICK),
}


def small_bundle(kind: str, folder: Path) -> Path:
    """A small bundle of one of `KINDS`, made in a folder of its own there."""
    own = folder / kind.replace(", ", "_")
    own.mkdir()
    name = kind.removeprefix("bundle, ")
    if name == "azimuth":
        around = lights((30, 60), 4)
        look = PhotoStack(photographs(bumps(4, 0.4), around), tuple("abcdefghi"), around, True, ())
        return bake_stack(look, own / "azimuth.mmat", ArcSettings(azimuths="all", azimuth_rank=3)).path
    if name != "swatch":
        return _brdf(name, own / f"{name}.mmat")
    levels = np.linspace(0.1, 1, 6, dtype=np.float32)[:, None, None, None]
    even = np.broadcast_to(levels * np.float32([0.3, 0.2, 0.1]), (6, 4, 4, 3))
    cloth = PhotoStack(even, tuple("abcdef"), None, True, ())
    settings = ArcSettings(slices=4, brdf=_brdf("spline", own / "lobe.mmat"))
    return bake_stack(cloth, own / "swatch.mmat", settings, through=cloth).path


def _brdf(name: str, target: Path) -> Path:
    model, parameters, settings = _BRDFS[name]
    with coarse_bakes():
        return bake_source(by_name(model, **parameters), target, BakeSettings(**{**_SMALL, **settings})).path


class Spoiler:
    """Copies of one bundle, spoiled one after the other in one place.

    Parameters
    ----------
    original : the bundle
    folder : for the copies; beside them lies `outside`, which nobody may touch
    """

    def __init__(self, original: Path, folder: Path) -> None:
        self.files = {file.name: file.read_bytes() for file in original.iterdir()}
        self.document = json.loads(self.files[MATERIAL])
        self.places = list(_places(self.document))
        self.path = folder / original.name
        self.outside = folder / "outside"
        self.outside.mkdir()
        (self.outside / "canary.txt").write_bytes(b"untouched")
        (self.outside / MATERIAL).write_bytes(self.files[MATERIAL])

    def spoil(self, rng: np.random.Generator) -> None:
        """Leave another spoiled copy in place."""
        _clear(self.path)
        self.path.mkdir()
        files, document = dict(self.files), json.loads(self.files[MATERIAL])
        kind = rng.random()
        if kind < 0.45:
            for _ in range(rng.integers(1, 4)):
                _change(document, self.places[int(rng.integers(len(self.places)))], rng)
        elif kind < 0.6:
            files[MATERIAL] = spoiled(files[MATERIAL], rng)
        elif kind < 0.85:
            self._spoil_image(files, document, rng)
        else:
            files[PREVIEW] = spoiled(files[PREVIEW], rng)
        if files[MATERIAL] is self.files[MATERIAL]:
            files[MATERIAL] = json.dumps(document).encode("utf-8", "surrogatepass")
        for name, data in files.items():
            (self.path / name).write_bytes(data)
        if rng.random() < 0.15:
            self._spoil_folder(rng)

    def _spoil_image(self, files: dict[str, bytes], document: dict[str, Any], rng: np.random.Generator) -> None:
        """Other bytes, pixels or another image's file, mostly with the checksum made right, at times the size too."""
        entries = list(document["images"].values())
        entry = entries[int(rng.integers(len(entries)))]
        data = files[entry["file"]]
        how = rng.random()
        if how < 0.5:
            data = spoiled(data, rng)
        elif how < 0.6:
            data = files[entries[int(rng.integers(len(entries)))]["file"]]
        else:
            data = self._other_pixels(entry, rng)
        files[entry["file"]] = data
        if rng.random() < 0.9:
            entry["sha256"] = hashlib.sha256(data).hexdigest()
        if rng.random() < 0.1:
            entry[("width", "height", "channels")[int(rng.integers(3))]] = int(rng.integers(0, 1 << 25))

    def _other_pixels(self, entry: dict[str, Any], rng: np.random.Generator) -> bytes:
        """A valid image of the same size, some of its values others."""
        storage = Storage(entry["storage"])
        file = self.outside.parent / f"pixels{storage.suffix}"
        file.write_bytes(self.files[entry["file"]])
        pixels = read_image(file)
        chosen = rng.random(pixels.shape) < rng.choice([0.01, 0.5, 1.0])
        values = _PIXELS[:4] if storage in (Storage.BYTE, Storage.RGBE) else _PIXELS
        pixels[chosen] = rng.choice(values)
        if storage in (Storage.BYTE, Storage.RGBE):
            pixels = np.clip(pixels, 0, 1 if storage is Storage.BYTE else None)
        try:
            write_image(file, pixels, storage)
        except BakeError:  # values that no writer takes
            return spoiled(self.files[entry["file"]], rng)
        return file.read_bytes()

    def _spoil_folder(self, rng: np.random.Generator) -> None:
        """A file that is gone, a link out of the folder, a pipe, a folder, or one that is no bundle's."""
        names = sorted(file.name for file in self.path.iterdir())
        file = self.path / names[int(rng.integers(len(names)))]
        how = int(rng.integers(6))
        if how == 5:
            (self.path / "../..".replace("/", "_")).write_bytes(b"foreign")
            return
        file.unlink()
        if how == 1:
            file.symlink_to(self.outside / ("canary.txt" if rng.random() < 0.5 else MATERIAL))
        elif how == 2:
            os.mkfifo(file)
        elif how == 3:
            file.mkdir()
        elif how == 4:
            file.write_bytes(b"")

    def look(self) -> bool:
        """Whether the copy is read, with all that is loaded of it; nothing outside may have changed."""
        read = read_and_look(self.path)
        self.check_outside()
        return read

    def replace(self) -> bool:
        """Whether the copy is replaced by a good bundle; otherwise it stays as it is. Nothing outside may change."""
        before = _listing(self.path)
        try:
            with staging(self.path) as folder:
                whole = folder / self.path.name
                whole.mkdir()
                for name, data in self.files.items():
                    (whole / name).write_bytes(data)
                move_bundle(whole, self.path)
        except BakeError as error:
            _check_words(error, self.path)
            assert _listing(self.path) == before
            return False
        finally:
            self.check_outside()
        assert {file.name: file.read_bytes() for file in self.path.iterdir()} == self.files
        return True

    def check_outside(self) -> None:
        """Whoever follows a link out of the bundle is caught here."""
        assert sorted(os.listdir(self.outside)) == ["canary.txt", MATERIAL]
        assert (self.outside / "canary.txt").read_bytes() == b"untouched"
        assert (self.outside / MATERIAL).read_bytes() == self.files[MATERIAL]
        names = {self.path.name, "outside"}
        assert {name for name in os.listdir(self.outside.parent) if not name.startswith("pixels")} == names


def read_and_look(path: Path) -> bool:
    """Whether a bundle is read, and all that scenes, panel and `inspect` take of it; then its values are finite."""
    try:
        bundle = read_bundle(path)
        record = read_record(bundle)
        parts_of(record)
        if isinstance(record, ShadingMapRecord):
            _look_at_map(record)
        else:
            for part in (record, *filter(None, map(record.part, SHEET_PARTS))):
                _look_at_tables(part)
        if bundle.preview is not None:
            read_image(bundle.preview, _LARGEST_PREVIEW)
    except BakeError as error:
        _check_words(error, path)
        return False
    return True


def _check_words(error: BakeError, path: Path) -> None:
    assert "\n" not in str(error) and len(str(error)) < 2000, str(error)
    assert str(path) in str(error), str(error)


def _look_at_tables(record: BrdfRecord) -> None:
    wi, wo = spherical(np.array([0.1, 0.8, 1.3]), np.array([0.0, 2.0, 1.0])), spherical(0.6, np.array([0.3, 4.0, 1.0]))
    for part in ("table", *(("residual",) if record.residual is not None else ())):
        value = record.load_table(part).evaluate(wi, wo)
        assert value.shape == (3, 3) and np.isfinite(value).all()
        record.load_sampler(part)
    if record.envelope is not None:
        record.load_envelope()
    if record.preview is not None:
        record.load_preview()
    if record.has("residual_share"):
        record.check_shares()


def _look_at_map(record: ShadingMapRecord) -> None:
    for one in (record, record.transmitted()):
        if one is not None:
            assert np.isfinite(one.load_map().slices).all()
            if one.map.model == "azimuth":
                assert np.isfinite(one.load_azimuth().evaluate(0.3, 2.0)).all()
    if record.has("table"):
        record.baked_lobe().load()


def _places(value: Any, before: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a document, as keys and numbers."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, one in inner:
        yield (*before, key)
        yield from _places(one, (*before, key))


def _change(document: Any, place: tuple[Any, ...], rng: np.random.Generator) -> None:
    """Another value in a place, none, or one of another place's."""
    owner = document
    for key in place[:-1]:
        try:
            owner = owner[key]
        except (KeyError, IndexError, TypeError):  # changed before
            return
    try:
        old = owner[place[-1]]
        how = rng.random()
        if how < 0.15:
            del owner[place[-1]]
        elif how < 0.3 and isinstance(old, int | float):
            owner[place[-1]] = type(old)(old * float(rng.choice([-1, 2, 0.5, 1000])) + int(rng.integers(-1, 2)))
        elif how < 0.35 and isinstance(old, list) and old:
            owner[place[-1]] = old * int(rng.integers(2, 50))
        else:
            owner[place[-1]] = HOSTILE[int(rng.integers(len(HOSTILE)))]
    except (KeyError, IndexError, TypeError):
        return


def _clear(path: Path) -> None:
    if path.is_symlink() or path.is_file():
        path.unlink()
    elif path.exists():
        shutil.rmtree(path)


def _listing(path: Path) -> list[tuple[str, int, int]]:
    """Names, inodes and times, for a copy that must stay as it is."""
    found = (file.lstat() for file in sorted(path.iterdir()))
    return [(name, stat.st_ino, stat.st_mtime_ns) for name, stat in zip(sorted(os.listdir(path)), found)]


def try_bundles(kind: str, original: Path, folder: Path, count: int, seed: int = 0) -> Tally:
    """As `fuzz.try_many`, of the bundle `original`; some copies are replaced by a good bundle once they were read."""
    spoiler = Spoiler(original, folder)
    tried = iter(range(count))

    def look() -> bool:
        read = spoiler.look()
        if next(tried) % REPLACED == 0:
            spoiler.replace()
        return read

    return tallied(kind, spoiler.path, spoiler.spoil, look, count, seed)


def one_part(task: tuple[str, Path, Path, int, int]) -> Tally:
    """A part of `fuzz.try_in_parts`, in a process of its own, where OpenEXR says nothing of what it meets."""
    kind, original, folder, count, seed = task
    own = Path(tempfile.mkdtemp(dir=folder))
    warnings.simplefilter("error")
    silence = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silence, stream)
    tally = try_bundles(kind, original, own, count, seed)
    shutil.rmtree(own)
    return tally


KINDS = tuple(
    f"bundle, {kind}" for kind in ("isotropic", "codes", "spline", "anisotropic", "sheet", "swatch", "azimuth")
)
# Every so many, a copy is replaced as a bake does it, which takes as long as ten looks.
REPLACED = 20
