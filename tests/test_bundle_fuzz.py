"""Spoiled bundles of every kind: a clean error or a material, never a crash, a hang, much memory, or a way out."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.bundle.bundle import MATERIAL, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_png
from measured_materials.bake.shading_maps.record import read_record
from support import bundle_fuzz, fuzz
from support.bundle_files import edit, stored
from support.bundle_fuzz import KINDS, Spoiler, read_and_look

FEW, MANY, PROCESSES = 60, 100_000, 2


# The others bake longer, and repeat what these have.
LONGER = ("bundle, isotropic", "bundle, anisotropic")
ALL = [pytest.param(kind, marks=pytest.mark.slow) if kind in LONGER else kind for kind in KINDS]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A small bundle of a kind, made once."""
    folder = tmp_path_factory.mktemp("small")
    return functools.cache(lambda kind: bundle_fuzz.small_bundle(kind, folder))


@pytest.mark.parametrize("kind", ALL)
def test_spoiled_bundles_end_in_a_clean_error_or_a_material(
    kind: str, small: Callable[[str], Path], tmp_path: Path
) -> None:
    """Of a fixed seed; `./run fuzz bundle` tries 100,000 of each."""
    tally = bundle_fuzz.try_bundles(kind, small(kind), tmp_path, FEW)
    assert not tally.hangs and FEW // 2 < tally.tried - tally.read < FEW, "the changes are too weak or too strong"
    assert read_and_look(small(kind))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_hundred_thousand_spoiled_bundles(kind: str, small: Callable[[str], Path]) -> None:
    with fuzz.fast_folder() as folder:
        tally = fuzz.try_in_parts(kind, small(kind), folder, MANY, PROCESSES, one_part=bundle_fuzz.one_part)
    print(f"{kind}: {tally.told}")
    assert 0 < tally.read < tally.tried == MANY and tally.growth < fuzz.MOST_GROWTH and not tally.hangs


@pytest.mark.parametrize("kind", ("bundle, sheet", "bundle, swatch"))
def test_every_file_of_a_bundle_may_be_gone_or_a_link(kind: str, small: Callable[[str], Path], tmp_path: Path) -> None:
    spoiler = Spoiler(small(kind), tmp_path)
    for name in spoiler.files:
        for how in ("gone", "link", "pipe", "folder", "empty"):
            shutil.rmtree(spoiler.path, ignore_errors=True)
            shutil.copytree(small(kind), spoiler.path)
            file = spoiler.path / name
            file.unlink()
            if how == "link":  # to a file that is right
                elsewhere = tmp_path / f"pixels_{name}"
                elsewhere.write_bytes(spoiler.files[name])
                file.symlink_to(elsewhere)
            elif how == "pipe":
                os.mkfifo(file)
            elif how == "folder":
                file.mkdir()
            elif how == "empty":
                file.touch()
            # Without a picture, or with one that is not followed, a bundle is whole.
            assert spoiler.look() == (name == "preview.png" and how != "empty"), (name, how)
            spoiler.replace()


def test_what_declares_too_much_takes_no_memory(small: Callable[[str], Path], tmp_path: Path) -> None:
    """An image of one colour is a small file, and its checksum is right: nothing of it is unpacked."""
    spoiler = Spoiler(small("bundle, codes"), tmp_path)
    shutil.copytree(small("bundle, codes"), spoiler.path)
    table = stored(spoiler.path)
    write_png(table, np.zeros((4096, 4096, 3), np.uint8))

    def claim(document: dict) -> None:
        entry = document["images"]["table"]
        entry |= {"width": 4096, "height": 4096, "channels": 3}
        entry["sha256"] = hashlib.sha256(table.read_bytes()).hexdigest()

    edit(spoiler.path, claim)
    tracemalloc.start()
    try:
        with pytest.raises(BakeError):
            record = read_record(read_bundle(spoiler.path))
            record.load_table()
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


def test_an_archive_is_no_bundle(small: Callable[[str], Path], tmp_path: Path) -> None:
    packed = Path(shutil.make_archive(str(tmp_path / "gold"), "zip", small("bundle, spline")))
    named = packed.rename(tmp_path / "gold.mmat")
    with pytest.raises(BakeError, match="is not a bundle"):
        read_bundle(named)
    assert main(["inspect", str(named)]) == 1


def test_an_error_of_a_setting_names_the_document(small: Callable[[str], Path], tmp_path: Path) -> None:
    """Seen by `./run fuzz`: of "render" it named the setting alone."""
    for kind, key, name, value in (
        ("swatch", "render", "sigma", -1.0),
        ("codes", "settings", "basis", "a\nb"),
        ("codes", "rights", "author", "x" * 5000),
    ):
        path = tmp_path / f"{kind}_{name}.mmat"
        shutil.copytree(small(f"bundle, {kind}"), path)
        edit(path, lambda document, key=key, name=name, value=value: document.setdefault(key, {}).update({name: value}))
        with pytest.raises(BakeError) as caught:
            read_record(read_bundle(path))
        text = str(caught.value)
        assert str(path / MATERIAL) in text and name in text and "\n" not in text and len(text) < 1000
        assert json.dumps(vars(caught.value))
