"""Folders of bundles as asset libraries: what each .blend holds, what is written again, and what is left alone."""

from __future__ import annotations

import contextlib
import json
import resource
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.asset_library import library as asset_library
from measured_materials.addon.asset_library.blend_file import AssetSettings
from measured_materials.addon.asset_library.written import FILE as INDEX
from measured_materials.addon.asset_library.written import Written
from measured_materials.addon.assets.catalogue import FILE as CATALOGUES
from measured_materials.addon.assets.catalogue import catalogue_id
from measured_materials.addon.cli.main import main
from measured_materials.addon.library.lock import LOCK
from measured_materials.addon.material.facts import record_of
from measured_materials.bake.bundle.bundle import MATERIAL, PREVIEW
from measured_materials.bake.bundle.checked_json import MAX_JSON_BYTES
from measured_materials.bake.images.image_io import read_image
from support.imports import datablocks

FORMULAS, PHOTOGRAPHS = "Measured Materials/Formulas", "Measured Materials/Photographs"
QUICK = ["--preview", "bundle"]
pytestmark = pytest.mark.usefixtures("registered")


@pytest.fixture
def shelf(library: Path, tmp_path: Path) -> Path:
    """A folder with a measured BRDF, a folder below it with a swatch, and a bundle that is cut short."""
    folder = tmp_path / "shelf"
    shutil.copytree(library / "gold.mmat", folder / "gold.mmat")
    shutil.copytree(library / "felt.mmat", folder / "cloth" / "felt.mmat")
    shutil.copytree(library / "gold.mmat", folder / "spoiled.mmat")
    document = folder / "spoiled.mmat" / MATERIAL
    document.write_bytes(document.read_bytes()[:1000])
    return folder


@contextlib.contextmanager
def opened(file: Path) -> Iterator[Any]:
    """The asset of a .blend, as the asset browser appends it; gone afterwards."""
    known = datablocks()
    with bpy.data.libraries.load(str(file), assets_only=True) as (there, wanted):
        assert len(there.materials) == 1
        wanted.materials = there.materials
    yield wanted.materials[0]
    for kind, before in known.items():
        bpy.data.batch_remove(set(getattr(bpy.data, kind)) - before)


def shown(material: Any) -> Any:
    """The asset's picture, (H, W, 3), row 0 on top."""
    width, height = material.preview.image_size
    return np.array(material.preview.image_pixels_float).reshape(height, width, 4)[::-1, :, :3]


def states(folder: Path, out: Path, capsys: Any, *options: str, expect: int = 0) -> dict[str, str]:
    """Of a run: what became of each file."""
    assert main(["assets", str(folder), "--out", str(out), "--json", *QUICK, *options]) == expect
    return {one["file"]: one["state"] for one in json.loads(capsys.readouterr().out)["assets"]}


def test_each_bundle_becomes_an_asset_and_a_bad_one_keeps_none_away(shelf: Path, tmp_path: Path, capsys: Any) -> None:
    out, known = tmp_path / "out", datablocks()
    assert main(["assets", str(shelf), "--out", str(out), *QUICK]) == 1
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1] == f"{out}: 2 written, 1 failed"
    assert [line for line in printed.err.splitlines() if line.startswith("measured_materials: ")] == [
        line for line in printed.err.splitlines() if str(shelf / "spoiled.mmat") in line
    ], "one line, of the bad one"
    assert {file.relative_to(out).as_posix() for file in out.rglob("*") if file.is_file()} == {
        "gold.blend",
        "cloth/felt.blend",
        CATALOGUES,
        INDEX,
        LOCK,
    }
    listed = (out / CATALOGUES).read_text(encoding="utf-8")
    for file, name, shelf_of_it in (("gold", "gold", FORMULAS), ("cloth/felt", "felt", PHOTOGRAPHS)):
        with opened(out / f"{file}.blend") as material:
            data = material.asset_data
            assert material.name == name and record_of(material).name
            assert data.catalog_id == catalogue_id(shelf_of_it) and f"{data.catalog_id}:{shelf_of_it}:" in listed
            assert "rror" in data.description and data.tags
            kept = read_image(shelf / f"{file}.mmat" / PREVIEW)[..., :3]
            assert np.abs(shown(material) - kept).max() < 1e-3
            textures = [image for image in bpy.data.images if "measured_materials_part" in image]
            assert textures and all(image.packed_file for image in textures)
    made = {one.name for kind, now in datablocks().items() for one in now - known[kind]}
    assert not {name for name in made if "gold" in name or "ggx" in name or "felt" in name}, "nothing stays open"


def test_only_what_has_changed_is_written_again(shelf: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "out"
    shutil.rmtree(shelf / "spoiled.mmat")
    assert states(shelf, out, capsys) == {"gold.blend": "written", "cloth/felt.blend": "written"}
    # An artist renames the catalogue and adds one.
    text = (out / CATALOGUES).read_text(encoding="utf-8")
    text = text.replace(f":{FORMULAS}:Measured Materials-Formulas", ":Mine/Gold:Gold") + "# by hand\n"
    (out / CATALOGUES).write_text(text, encoding="utf-8")
    before = {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}
    assert set(states(shelf, out, capsys).values()) == {"unchanged"}
    document = json.loads((shelf / "gold.mmat" / MATERIAL).read_text(encoding="utf-8"))
    document["rights"] = {"author": "A. Weaver"}
    (shelf / "gold.mmat" / MATERIAL).write_text(json.dumps(document), encoding="utf-8")
    assert states(shelf, out, capsys) == {"gold.blend": "written", "cloth/felt.blend": "unchanged"}
    changed = {file.name for file in before if file.read_bytes() != before[file]}
    assert changed == {"gold.blend", INDEX}
    with opened(out / "gold.blend") as material:
        assert (material.asset_data.author, material.asset_data.catalog_id) == ("A. Weaver", catalogue_id(FORMULAS))
    (out / "gold.blend").unlink()
    shutil.rmtree(shelf / "cloth")
    assert states(shelf, out, capsys) == {"gold.blend": "written"} and (out / "cloth" / "felt.blend").exists()


def test_what_somebody_else_has_saved_is_not_replaced(library: Path, tmp_path: Path, capsys: Any) -> None:
    out, bundle = tmp_path / "out", library / "gold.mmat"
    out.mkdir()
    (out / "gold.blend").write_bytes(b"mine")
    assert main(["assets", str(bundle), "--out", str(out), *QUICK]) == 1
    assert "--replace" in capsys.readouterr().err and (out / "gold.blend").read_bytes() == b"mine"
    assert states(bundle, out, capsys, "--replace") == {"gold.blend": "written"}
    with open(out / "gold.blend", "ab") as stream:
        stream.write(b"edited")
    edited = (out / "gold.blend").read_bytes()
    assert states(bundle, out, capsys) == {"gold.blend": "unchanged"}, "the bundle is the same: it stays as edited"
    relative = ["--textures", "relative"]
    assert states(bundle, out, capsys, *relative, expect=1) == {"gold.blend": "failed"}
    assert (out / "gold.blend").read_bytes() == edited
    assert states(bundle, out, capsys, "--replace", *relative) == {"gold.blend": "written"}


def test_a_librarys_replace_is_of_bundles_alone(tmp_path: Path) -> None:
    """`bake library --replace --assets` leaves what a person has saved."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "lambert.blend").write_bytes(b"mine")
    words = ["--analytic", "lambert", "--resolution", "8", "--no-envelope", "--sampler", "16", "--jobs", "0"]
    folders = ["--out", str(tmp_path / "L"), "--assets", str(tmp_path / "assets")]
    assert main(["bake", "library", *words, *folders, "--replace"]) == 1
    assert (tmp_path / "L" / "lambert.mmat").is_dir()
    assert (tmp_path / "assets" / "lambert.blend").read_bytes() == b"mine"


def test_what_was_not_noted_is_ours_all_the_same(
    library: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full, or the run is killed, when the .blend is in its place and the index is not: twice."""
    out, bundle = tmp_path / "out", library / "gold.mmat"
    with monkeypatch.context() as patched:
        patched.setattr(asset_library.Written, "note", lambda *given: (_ for _ in ()).throw(OSError(28, "No space")))
        for textures in ("packed", "relative"):
            assert states(bundle, out, capsys, "--textures", textures, expect=1) == {"gold.blend": "failed"}
            assert (out / "gold.blend").exists()
    assert states(bundle, out, capsys) == {"gold.blend": "written"}
    assert states(bundle, out, capsys) == {"gold.blend": "unchanged"}


def test_relative_textures_move_with_the_folder(library: Path, tmp_path: Path, capsys: Any) -> None:
    before, after = tmp_path / "before", tmp_path / "after"
    shutil.copytree(library / "gold.mmat", before / "gold.mmat")
    assert main(["assets", str(before), "--textures", "relative", *QUICK]) == 0
    capsys.readouterr()
    before.rename(after)
    with opened(after / "gold.blend") as material:
        assert not material.measured_materials.pack
        textures = [image for image in bpy.data.images if "measured_materials_part" in image]
        assert textures and not any(image.packed_file for image in textures)
        assert all(Path(bpy.path.abspath(image.filepath)).parent == after / "gold.mmat" for image in textures)
        assert all(image.size[0] for image in textures)


def test_a_full_disk_leaves_the_older_file(library: Path, tmp_path: Path, capsys: Any) -> None:
    """A limit on the size of files stands for it."""
    out, bundle = tmp_path / "out", library / "gold.mmat"
    states(bundle, out, capsys)
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    limits, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before["gold.blend"]) // 2, limits[1]))
    try:
        found = main(["assets", str(bundle), "--out", str(out), "--textures", "packed", "--preview", "render"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert found == 1 and "cannot be written" in capsys.readouterr().err
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before
    assert states(bundle, out, capsys) == {"gold.blend": "unchanged"}


def test_what_a_killed_run_left_goes_and_nothing_else(library: Path, tmp_path: Path, capsys: Any) -> None:
    """Also where it writes below, but not in a library below, which has a lock of its own."""
    out, shelf, name = tmp_path / "out", tmp_path / "shelf", ".0123456789ab.partial.blend"
    for place in ("cloth", "own", "elsewhere"):
        (out / place).mkdir(parents=True)
    (out / "own" / LOCK).touch()
    for place in ("cloth", "own"):
        shutil.copytree(library / "gold.mmat", shelf / place / "gold.mmat")
    left = [out / name, out / "cloth" / name]
    others = [out / ".mine.partial.blend", out / "notes.partial.txt", out / "own" / name, out / "elsewhere" / name]
    for file in (*left, *others):
        file.write_bytes(b"half")
    states(shelf, out, capsys)
    assert not any(file.exists() for file in left) and all(file.exists() for file in others)


def test_the_picture_is_rendered_in_the_studio(library: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "out"
    call = ["assets", str(library / "gold.mmat"), "--out", str(out), "--preview-samples", "1"]
    assert main(call) == 0
    with opened(out / "gold.blend") as material:
        picture = shown(material)
    assert picture.shape == (256, 256, 3)
    lit, corner = picture[70:180, 30:140], picture[:30, :30]
    assert lit.mean() > 0.5 and lit.max() > 0.9 and abs(corner.mean() - 0.3) < 0.1, "a bright ball before the backdrop"
    capsys.readouterr()
    assert main(call) == 0 and "1 unchanged" in capsys.readouterr().out


def test_a_defect_is_of_one_material_alone(
    shelf: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = asset_library.write_asset

    def failing(bundle: Path, *rest: Any) -> str:
        if bundle.stem == "felt":
            raise RuntimeError("Blender\nhas had enough")
        return write(bundle, *rest)

    monkeypatch.setattr(asset_library, "write_asset", failing)
    found = states(shelf, tmp_path / "out", capsys, expect=1)
    assert found == {"cloth/felt.blend": "failed", "gold.blend": "written", "spoiled.blend": "failed"}


def test_an_index_of_many_assets_is_written_and_read(tmp_path: Path) -> None:
    """Of more than a bundle's document may hold: otherwise every later run would write all of them again."""
    many = {f"{k:06}{'x' * 60}.blend": ("a" * 64, "b" * 64) for k in range(20_000)}
    (tmp_path / "gold.blend").write_bytes(b"gold")
    Written(tmp_path, dict(many)).note("gold.blend", "c" * 64)
    assert (tmp_path / INDEX).stat().st_size > MAX_JSON_BYTES
    assert Written.read(tmp_path).entries.keys() == {*many, "gold.blend"}


def test_links_are_not_followed(library: Path, tmp_path: Path) -> None:
    (tmp_path / "linked").symlink_to(library, target_is_directory=True)
    (tmp_path / "gold.mmat").symlink_to(library / "gold.mmat", target_is_directory=True)
    assert asset_library.bundles_below(tmp_path) == []
    assert main(["assets", str(tmp_path)]) == 1


def test_settings_are_part_of_what_it_was_written_from(library: Path) -> None:
    bundle = library / "gold.mmat"
    origins = {
        asset_library.origin_of(bundle, settings)
        for settings in (AssetSettings(), AssetSettings("relative"), AssetSettings(preview="bundle"))
    }
    assert len(origins) == 3
