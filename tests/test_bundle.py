"""Bundles: whole or absent whatever interrupts the writer, and never trusted by the reader."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from measured_materials.bake.bundle import bundle
from measured_materials.bake.bundle.bundle import StoredImage, read_bundle, require, write_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import IMAGE_STORAGES, Storage, quantize
from support.bundle_files import edit, stored

TABLE = np.random.default_rng(11).random((6, 10, 3)).astype(np.float32)
SAMPLER = np.random.default_rng(12).normal(size=(4, 4, 4)).astype(np.float32)
PREVIEW = np.zeros((2, 2, 3), np.uint8)


def write(path: Path, version: int = 1, storage: str = "half") -> Path:
    images = {
        "table": StoredImage(TABLE * version, Storage(storage)),
        "sampler": StoredImage(SAMPLER, Storage.FLOAT32),
    }
    return write_bundle(path, {"source": {"name": "felt"}, "version": version}, images, PREVIEW)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path / "felt.mmat")


# --- the ordinary way -------------------------------------------------------------------------------------


@pytest.mark.parametrize("storage", IMAGE_STORAGES)
def test_round_trip(tmp_path: Path, storage: Storage) -> None:
    path = write(tmp_path / "felt", storage=storage)
    assert path == tmp_path / "felt.mmat" and list(tmp_path.iterdir()) == [path]
    found = read_bundle(path)
    np.testing.assert_array_equal(found.load("table"), quantize(TABLE, storage))
    np.testing.assert_array_equal(found.load("sampler"), SAMPLER)
    digest = found.material["images"]["table"]["sha256"][:12]
    assert found.image_path("table") == path / f"felt_{digest}_table{storage.suffix}"
    assert found.has("table") and not found.has("slices")
    assert found.preview == path / "preview.png"
    assert (found.material["schema"], found.material["kind"]) == (4, "brdf")
    assert set(found.material["images"]["table"]) == {
        "file",
        "width",
        "height",
        "channels",
        "storage",
        "sha256",
    }
    names = {"material.json", "preview.png", stored(path).name, stored(path, "sampler").name}
    assert {file.name for file in path.iterdir()} == names


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_byte_images_of_a_shading_map(tmp_path: Path, channels: int) -> None:
    pixels = np.random.default_rng(13).random((5, 7, channels)).astype(np.float32)
    images = {name: StoredImage(pixels, Storage.BYTE) for name in ("slices", "power", "coefficients")}
    path = write_bundle(tmp_path / "cloth", {}, images, PREVIEW, kind="shading_map")
    found = read_bundle(path)
    for name in images:
        np.testing.assert_array_equal(found.load(name), quantize(pixels, Storage.BYTE))
    assert found.material["images"]["power"]["channels"] == channels and found.preview == path / "preview.png"
    stored(path, "power").write_bytes((path / "preview.png").read_bytes())
    with pytest.raises(BakeError, match=r"power\.png: has (width|height|channels) "):
        read_bundle(path)


def test_equal_input_makes_equal_bundles(tmp_path: Path) -> None:
    first, second = write(tmp_path / "a"), write(tmp_path / "b")
    for file in first.iterdir():
        assert file.read_bytes() == (second / file.name).read_bytes()


def test_json_is_sorted_and_floats_come_back(tmp_path: Path) -> None:
    material = {
        "z": 0.1,
        "a": np.float32(0.1),
        "n": np.int64(7),
        "list": np.arange(3) / 3,
        "text": "Stoff é \ud800",
        "none": None,
        "yes": np.bool_(True),
        "tiny": 5e-324,
        "tuple": (1, 2.5),
    }
    path = write_bundle(tmp_path / "x", material, {})
    text = (path / "material.json").read_text()
    assert text.index('"a"') < text.index('"kind"') < text.index('"z"') and "\n  " in text
    found = read_bundle(path).material
    assert (found["z"], found["a"], found["n"]) == (0.1, float(np.float32(0.1)), 7)
    assert found["list"] == [0.0, 1 / 3, 2 / 3] and found["tuple"] == [1, 2.5]
    assert (found["text"], found["none"], found["yes"], found["tiny"]) == (
        material["text"],
        None,
        True,
        5e-324,
    )


def test_what_was_read_can_be_written_again(path: Path, tmp_path: Path) -> None:
    found = read_bundle(path)
    again = write_bundle(tmp_path / "again", found.material, {"table": StoredImage(TABLE, Storage.HALF)})
    assert set(read_bundle(again).material["images"]) == {"table"}
    assert read_bundle(again).material["source"] == {"name": "felt"}


def test_exr_headers_repeat_the_parameters(path: Path) -> None:
    attributes = bundle.read_header(stored(path)).attributes
    assert (attributes["image"], attributes["storage"]) == ("table", "half")
    repeated = json.loads(attributes["material"])
    assert repeated == {"source": {"name": "felt"}, "version": 1, "schema": 4, "kind": "brdf"}


def test_replacing_leaves_nothing_of_the_old(path: Path) -> None:
    images = {"table": StoredImage(TABLE, Storage.RGBE)}
    write_bundle(path, {}, images)
    assert {file.name for file in path.iterdir()} == {stored(path).name, "material.json"}
    assert list(path.parent.iterdir()) == [path]
    assert read_bundle(path).preview is None


@pytest.mark.parametrize(
    "material, word",
    [
        ({"a": {"b": [1, math.nan]}}, r"'a\.b\[1\]' is nan"),
        ({"a": np.float64("inf")}, "'a' is inf"),
        ({"a": np.array([np.inf])}, r"'a\[0\]' is inf"),
        ({"a": {1: 2}}, "'a' has the key 1"),
        ({"a": object()}, "'a' holds a object"),
        ({"a": "x" * (5 << 20)}, "exceed 4 MiB"),
    ],
)
def test_what_json_cannot_hold(tmp_path: Path, material: dict[str, Any], word: str) -> None:
    with pytest.raises(BakeError, match=word):
        write_bundle(tmp_path / "x", material, {"table": StoredImage(TABLE, Storage.HALF)})
    assert not list(tmp_path.iterdir())


def test_unusable_names_and_images(tmp_path: Path) -> None:
    for name in ("../table", "material", ""):
        with pytest.raises(BakeError, match="cannot hold"):
            write_bundle(tmp_path / "x", {}, {name: StoredImage(TABLE, Storage.HALF)})
    with pytest.raises(BakeError, match=r"x\.mmat/table\.exr: values above 65504 overflow half"):
        write_bundle(tmp_path / "x", {}, {"table": StoredImage(TABLE * 1e6, Storage.HALF)})
    for path in ("", "/", "a\0b"):
        with pytest.raises(BakeError):
            write_bundle(path, {}, {})
    with pytest.raises(BakeError, match="cannot be written"):
        write(tmp_path / "absent" / "x")
    assert not list(tmp_path.iterdir())


# --- what is never replaced -------------------------------------------------------------------------------


def test_only_bundles_are_replaced(tmp_path: Path) -> None:
    (tmp_path / "file.mmat").write_text("mine")
    (tmp_path / "folder.mmat").mkdir()
    (tmp_path / "other.mmat").mkdir()
    (tmp_path / "other.mmat" / "material.json").write_text('{"mine": 1}')
    (tmp_path / "link.mmat").symlink_to(write(tmp_path / "real"))
    write(tmp_path / "guest")
    (tmp_path / "guest.mmat" / "notes.txt").write_text("mine")
    before = snapshot(tmp_path)
    for name in ("file", "folder", "other", "link", "guest"):
        with pytest.raises(BakeError, match="is not replaced"):
            write(tmp_path / name, 2)
    assert snapshot(tmp_path) == before


def snapshot(folder: Path) -> dict[str, bytes | None]:
    files = sorted(folder.rglob("*"))
    return {str(f.relative_to(folder)): f.read_bytes() if f.is_file() else None for f in files}


def test_litter_of_file_browsers_does_not_hinder(path: Path) -> None:
    (path / ".DS_Store").write_bytes(b"x")
    assert read_bundle(write(path, 2)).material["version"] == 2


# --- hostile bundles --------------------------------------------------------------------------------------


def table(**changes: Any) -> Callable[[dict[str, Any]], None]:
    return lambda document: document["images"]["table"].update(changes)


@pytest.mark.parametrize(
    "change, word",
    [
        (lambda d: d.update(schema=8), "newer version .schema 8, known here: 7.*update"),
        (lambda d: d.update(schema=0), "'schema' is 0, below 1"),
        (lambda d: d.update(schema=True), "'schema' is not a whole number"),
        (lambda d: d.update(schema=1.0), "'schema' is not a whole number"),
        (lambda d: d.pop("schema"), "'schema' is missing"),
        (lambda d: d.update(kind="shader"), "'kind' is 'shader', not one of brdf, shading_map"),
        (lambda d: d.update(images=[]), "'images' is not an object"),
        (lambda d: d["images"].update(sampler=1), r"images\.sampler: is not an object"),
        (lambda d: d["images"].update(virus=d["images"]["table"]), "'images' names 'virus'"),
        (table(file="../x.exr"), "'file' is '../x.exr', not one of table.exr"),
        (table(file="/etc/passwd"), "'file' is '/etc/passwd'"),
        (table(file="sampler.exr"), "'file' is 'sampler.exr'"),
        (table(file="table.hdr"), "'file' is 'table.hdr'"),
        (table(storage="double"), "'storage' is 'double', not one of float32, half, rgbe, byte"),
        (table(storage="float32"), "has storage half, but material.json says float32"),
        (table(width=11), "has width 10, but material.json says 11"),
        (table(width=0), "'width' is 0, below 1"),
        (table(width=10.0), "'width' is not a whole number"),
        (table(width=10**400), "'width' is a huge number, above 16777216"),
        (table(width=1 << 20, height=1 << 20), "declares more than 1024 MiB"),
        (table(storage="byte"), "'file' is 'felt_.*_table.exr', not one of table.png"),
        (table(storage="byte", file="table.png"), "table.png: is missing"),
        (table(channels=2), "'channels' is 2, not one of 1, 3, 4"),
        (table(channels=4), "has channels 3, but material.json says 4"),
        (table(sha256="f" * 63), "length of 'sha256' is 63, below 64"),
        (table(sha256="g" * 64), "'sha256' is not 64 hexadecimal digits"),
        (table(sha256=None), "'sha256' is not a text"),
    ],
)
def test_hostile_material(path: Path, change: Callable[[dict[str, Any]], None], word: str) -> None:
    edit(path, change)
    with pytest.raises(BakeError, match=word) as caught:
        read_bundle(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text, word",
    [
        (b"", "not valid JSON"),
        (b"[]", "not a JSON object"),
        (b"\xff\xfe", "not valid JSON"),
        (b'{"schema": NaN}', "holds NaN"),
        (b'{"schema": -Infinity}', "holds -Infinity"),
        (b'{"schema": 1e999}', "number 1e999 is too large"),
        (b'{"schema": 1, "schema": 1}', "key is repeated"),
        (b'{"schema": ' + b"9" * 5000 + b"}", "not valid JSON"),
        (b'{"a": ' + b"[" * 1_000_000, "nested too deeply"),
        (b"[" * (50 << 20), "larger than 4 MiB"),
    ],
)
def test_hostile_json(path: Path, text: bytes, word: str) -> None:
    (path / "material.json").write_bytes(text)
    with pytest.raises(BakeError, match=word):
        read_bundle(path)


@pytest.mark.parametrize("name", ["table", "material.json"])
def test_links_pipes_and_folders_are_refused(path: Path, name: str) -> None:
    file = stored(path) if name == "table" else path / name
    elsewhere = file.rename(path.parent / name)
    for make in (lambda: file.symlink_to(elsewhere), lambda: os.mkfifo(file), file.mkdir, lambda: None):
        make()
        with pytest.raises(BakeError, match="missing or not an ordinary file"):
            read_bundle(path)
        if os.path.lexists(file):
            file.rmdir() if file.is_dir() else file.unlink()


def test_preview_link_is_not_followed(path: Path) -> None:
    (path / "preview.png").rename(path.parent / "p.png")
    (path / "preview.png").symlink_to(path.parent / "p.png")
    assert read_bundle(path).preview is None


def test_changed_and_damaged_pixels(path: Path) -> None:
    file = stored(path)
    data = bytearray(file.read_bytes())
    data[-3] ^= 1
    file.write_bytes(data)
    found = read_bundle(path)
    with pytest.raises(BakeError, match="was changed after it was baked"):
        found.load("table")
    file.write_bytes(data[: len(data) // 3])
    with pytest.raises(BakeError, match=r"table\.exr"):
        read_bundle(path)
    file.unlink()
    with pytest.raises(BakeError, match="missing"):
        found.load("table")


def test_pixels_that_are_not_finite(path: Path) -> None:
    # A half of bits 0x7e00 is NaN; such a small image is stored as it is, so the bytes can be found.
    write_bundle(path, {}, {"table": StoredImage(TABLE[:1, :1], Storage.HALF)})
    file, one = stored(path), np.float16(TABLE[0, 0, 0]).tobytes()
    data = file.read_bytes()
    file.write_bytes(data[:-6] + data[-6:].replace(one, b"\x00\x7e"))
    edit(path, lambda d: d["images"]["table"].update(sha256=bundle._sha256(file)))
    with pytest.raises(BakeError, match="not finite"):
        read_bundle(path).load("table")


def test_what_is_no_bundle(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "empty.mmat").mkdir()
    for name, word in (
        ("absent", "not a bundle"),
        ("file", "not a bundle"),
        ("empty.mmat", "missing"),
        ("a\0", "not a bundle"),
    ):
        with pytest.raises(BakeError, match=word):
            read_bundle(tmp_path / name)
    with pytest.raises(BakeError, match="has no image 'slices'"):
        read_bundle(write(tmp_path / "x")).load("slices")
    with pytest.raises(BakeError, match="has no image"):
        read_bundle(tmp_path / "x.mmat").image_path("../../secret")
    with pytest.raises(BakeError, match="has no image 'through_slices'"):
        read_bundle(tmp_path / "x.mmat").part("through", {"images": {}}).load("slices")


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
PLACES = [("schema",), ("kind",), ("images",), ("images", "table"), ("source",)]
PLACES += [("images", "table", key) for key in ("file", "width", "height", "channels", "storage", "sha256")]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.sampled_from(PLACES), value=json_values)
def test_any_value_anywhere(path: Path, place: tuple[str, ...], value: Any) -> None:
    original = (path / "material.json").read_text()

    def change(document: dict[str, Any]) -> None:
        for key in place[:-1]:
            document = document[key]
        document[place[-1]] = value

    edit(path, change)
    try:
        found = read_bundle(path)
        found.load("table")
    except BakeError as error:
        assert "\n" not in str(error) and len(str(error)) < 600
    else:
        assert place == ("source",) or value in json.loads(original).values() or value == 1
    finally:
        (path / "material.json").write_text(original)


# --- require ----------------------------------------------------------------------------------------------

VALUES = {"n": 64, "x": 0.5, "flag": True, "name": "felt", "list": [1, 2], "big": 10**400, "none": None}


def test_require_returns_what_is_right() -> None:
    assert require(VALUES, "n", int, "f", 1, 64) == 64
    whole = require(VALUES, "n", float, "f")
    assert whole == 64.0 and type(whole) is float
    assert require(VALUES, "flag", bool, "f") is True
    assert require(VALUES, "name", str, "f", choices=("felt", "silk")) == "felt"
    assert require(VALUES, "list", list, "f", minimum=2, maximum=2) == [1, 2]


@pytest.mark.parametrize(
    "key, expected, limits, word",
    [
        ("absent", int, {}, "f: 'absent' is missing"),
        ("flag", int, {}, "not a whole number"),
        ("flag", float, {}, "not a number"),
        ("x", int, {}, "not a whole number"),
        ("n", bool, {}, "not true or false"),
        ("big", float, {}, "not a number"),
        ("none", dict, {}, "not an object"),
        ("n", int, {"maximum": 63}, "'n' is 64, above 63"),
        ("x", float, {"minimum": 0.6}, "'x' is 0.5, below 0.6"),
        ("big", int, {"maximum": 63}, "'big' is a huge number, above 63"),
        ("list", list, {"minimum": 3}, "length of 'list' is 2, below 3"),
        ("name", str, {"choices": ["silk"]}, "'name' is 'felt', not one of silk"),
    ],
)
def test_require_names_what_is_wrong(key: str, expected: type, limits: dict[str, Any], word: str) -> None:
    with pytest.raises(BakeError, match=word):
        require(VALUES, key, expected, "f", **limits)
