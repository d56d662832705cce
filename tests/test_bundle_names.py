"""File names of a bundle's images: unlike any other material's, plain, and those of older bundles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.bundle.bundle import StoredImage, read_bundle, write_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage
from support.bundle_files import edit, stored

TABLE = np.linspace(0, 1, 180, dtype=np.float32).reshape(6, 10, 3)
SAMPLER = np.linspace(-1, 1, 64, dtype=np.float32).reshape(4, 4, 4)


def write(path: Path, version: int = 1) -> Path:
    images = {
        "table": StoredImage(TABLE * version, Storage.HALF),
        "sampler": StoredImage(SAMPLER, Storage.FLOAT32),
    }
    return write_bundle(path, {"source": {"name": "felt"}, "version": version}, images)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path / "felt.mmat")


def as_schema_2(path: Path) -> None:
    """What older versions wrote: files called after the image alone."""

    def change(document: dict[str, Any]) -> None:
        document["schema"] = 2
        for name, entry in document["images"].items():
            file = (path / entry["file"]).rename(path / f"{name}{Path(entry['file']).suffix}")
            entry["file"] = file.name

    edit(path, change)


def test_schema_1_is_read(path: Path) -> None:
    """It is no longer written: its readers know neither codes nor raised half floats, and would not miss them."""
    as_schema_2(path)
    edit(path, lambda document: document.update(schema=1))
    assert read_bundle(path).has("table")


def test_schema_2_is_read_and_replaced(path: Path) -> None:
    """Its images are called alike in every bundle; a new bake in its place gives them names of their own."""
    as_schema_2(path)
    assert read_bundle(path).image_path("table") == path / "table.exr"
    np.testing.assert_array_equal(read_bundle(path).load("sampler"), SAMPLER)
    write(path, 2)
    assert not (path / "table.exr").exists() and stored(path).name.endswith("_table.exr")


@pytest.mark.parametrize(
    "title", ["felt", "Gold paint (2).v3", "Ölfarbe blau", "漆", "../../etc", "con", "x" * 300, ""]
)
def test_no_two_materials_images_are_called_alike(tmp_path: Path, title: str) -> None:
    """Blender's *Unpack Resources*, *Find Missing Files* and packers of farms go by base names."""
    names: set[str] = set()
    for version in (1, 2):
        images = {
            name: StoredImage(TABLE * (version + k), Storage.HALF) for k, name in enumerate(("table", "residual"))
        }
        path = write_bundle(tmp_path / f"b{version}", {"source": {"name": title}}, images)
        found = {entry["file"] for entry in read_bundle(path).material["images"].values()}
        assert found == {file.name for file in path.iterdir()} - {"material.json"}
        assert all(name.isascii() and "/" not in name and len(name) < 100 for name in found)
        assert not {name.casefold() for name in found} & names and len(found) == 2
        names |= {name.casefold() for name in found}


@pytest.mark.parametrize(
    "file, word",
    [
        ("../felt_0123456789ab_table.exr", "'file' is '../felt_0123456789ab_table.exr'"),
        ("a/felt_0123456789ab_table.exr", "'file' is 'a/felt_0123456789ab_table.exr'"),
        (".felt_0123456789ab_table.exr", "'file' is '.felt_0123456789ab_table.exr'"),
        ("felt_0123456789ab_sampler.exr", "'file' is 'felt_0123456789ab_sampler.exr'"),
        ("felt_0123456789ab_table.exr\n", "'file' is "),
        ("felt_0123456789ab_table.exr", "felt_0123456789ab_table.exr: is missing"),
        (7, "'file' is not a text"),
    ],
)
def test_no_other_name_is_followed(path: Path, file: Any, word: str) -> None:
    edit(path, lambda document: document["images"]["table"].update(file=file))
    with pytest.raises(BakeError, match=word) as caught:
        read_bundle(path)
    assert "\n" not in str(caught.value)


def test_older_schemas_have_their_own_names_only(path: Path) -> None:
    """A bundle that says schema 2 was not written with the new names."""
    edit(path, lambda document: document.update(schema=2))
    with pytest.raises(BakeError, match=r"'file' is 'felt_\w+\.exr', not one of (table|sampler)\.exr"):
        read_bundle(path)
