"""Measured materials as assets: what they state, their picture, and a library's catalogues, which others write too."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import measured_materials
import numpy as np
import pytest
from measured_materials.addon.assets import mark as assets
from measured_materials.addon.assets.catalogue import FILE, add_catalogue, catalogue_id, library_of
from measured_materials.addon.assets.words import Rights, rights_of, words_of
from measured_materials.addon.material.facts import FACTS_KEY, record_of
from measured_materials.addon.ui.assets import folder_to_open
from measured_materials.bake.bundle.bundle import PREVIEW, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import read_image
from measured_materials.bake.shading_maps.record import parse_record, read_record
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl
from support.coarse_bakes import coarse  # noqa: F401
from support.records import ANISOTROPIC, changed

SHELF = "Measured Materials/Formulas"


@pytest.fixture(autouse=True)
def empty_file() -> Iterator[None]:
    """A file that was never saved, with the extension in it."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    measured_materials.register()
    yield
    measured_materials.unregister()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


@pytest.fixture
def gold(library: Path, tmp_path: Path) -> bpy.types.Material:
    """On the active object, of a bundle of its own."""
    shutil.copytree(library / "gold.mmat", tmp_path / "gold.mmat")
    obj = bpy.data.objects.new("plate", bpy.data.meshes.new("plate"))
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.measured_materials.import_bundle(filepath=str(tmp_path / "gold.mmat"))
    return obj.active_material


def save(folder: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "library.blend"))


def listed(folder: Path) -> dict[str, str]:
    """Paths of catalogues and their numbers, as Blender reads the file."""
    lines = [line.strip() for line in (folder / FILE).read_text(encoding="utf-8").splitlines()]
    entries = [line.split(":") for line in lines if line and not line.startswith(("#", "VERSION"))]
    assert all(len(entry) == 3 and uuid.UUID(entry[0]) for entry in entries)
    return {path: uid for uid, path, _ in entries}


def test_a_marked_material_states_its_source_and_error(gold: Any, tmp_path: Path) -> None:
    save(tmp_path)
    assert bpy.ops.measured_materials.mark_asset() == {"FINISHED"}
    data = gold.asset_data
    assert data.catalog_id == listed(tmp_path)[SHELF] == catalogue_id(SHELF)
    assert data.description.startswith("Reflectance by the formula ggx: ggx. RMS error ") and "1/sr" in data.description
    assert [tag.name for tag in data.tags] == ["Formula"]
    assert (data.author, data.license, data.copyright) == ("", "", ""), "nobody said"


def test_the_picture_is_the_bundles(gold: Any, tmp_path: Path) -> None:
    save(tmp_path)
    bpy.ops.measured_materials.mark_asset()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    preview = bpy.data.materials["ggx"].preview
    width, height = preview.image_size
    shown = np.array(preview.image_pixels_float).reshape(height, width, 4)[::-1]
    wanted = read_image(tmp_path / "gold.mmat" / PREVIEW)[..., :3]
    assert shown.shape[:2] == wanted.shape[:2] and np.ptp(wanted) > 0.3
    assert np.abs(shown[..., :3] - wanted).max() < 1e-3 and (shown[..., 3] == 1).all()


def test_a_library_gives_the_asset_to_another_file(gold: Any, tmp_path: Path) -> None:
    """As the asset browser does: appended with its textures, which are packed."""
    save(tmp_path)
    bpy.ops.measured_materials.mark_asset(author="A. Weaver", license="CC0")
    bpy.ops.wm.save_mainfile()
    file = bpy.data.filepath
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(file, assets_only=True) as (there, wanted):
        assert there.materials == ["ggx"]
        wanted.materials = there.materials
    (material,) = wanted.materials
    assert material.asset_data is None or material.asset_data.author == "A. Weaver"
    assert record_of(material).name == "ggx"
    assert all(image.packed_file for image in bpy.data.images if image.name.startswith("ggx"))


def test_what_a_person_states_is_kept_and_can_be_taken_back(gold: Any, tmp_path: Path) -> None:
    save(tmp_path)
    bpy.ops.measured_materials.mark_asset(author="A. Weaver", license="CC0", copyright="")
    bpy.ops.measured_materials.mark_asset()
    assert (gold.asset_data.author, gold.asset_data.license) == ("A. Weaver", "CC0")
    assert assets.stated_rights(gold) == Rights("A. Weaver", "CC0")
    bpy.ops.measured_materials.mark_asset(author="", license="CC0", copyright="")
    assert gold.asset_data.author == ""
    assert len(gold.asset_data.tags) == 1 and len(listed(tmp_path)) == 2, "once, however often it is marked"


def test_what_a_measurement_says_of_itself_is_stated() -> None:
    facts = {"format": "RGL tensor file", "description": "brushed\nmetal", "author": "B. Smith", "license": "CC-BY 4.0"}
    record = parse_record(changed(ANISOTROPIC, source={"name": "brushed_steel", "facts": facts}), "here")
    words = words_of(record)
    assert words.catalogue == "Measured Materials/Measurements"
    assert words.tags == ("Measured", "RGL tensor file", "Anisotropic", "Metal")
    assert words.rights == Rights("B. Smith", "CC-BY 4.0", "") == rights_of(record)
    assert words.description.startswith("Measured reflectance (RGL tensor file): brushed_steel. Brushed metal.")


@pytest.mark.parametrize(
    "name, tag",
    [
        ("gold-metallic-paint", "Paint"),
        ("chrome-steel", "Metal"),
        ("acrylic_felt_orange", "Cloth"),
        ("steelyard", None),
    ],
)
def test_a_class_is_told_by_words_of_the_name_alone(name: str, tag: str | None) -> None:
    words = words_of(parse_record(changed(ANISOTROPIC, source={"name": name}), "here"))
    assert words.tags == tuple(filter(None, ("Measured", "Anisotropic", tag)))


def test_photographs_have_their_own_shelf(library: Path) -> None:
    words = words_of(read_record(read_bundle(library / "felt.mmat")))
    assert words.catalogue == "Measured Materials/Photographs" and words.tags == ("Photographed", "Cloth")
    assert words.description.startswith("Flat swatch, photographed under a moved lamp: felt. Error of a photograph")


def test_before_the_file_is_saved_there_is_no_catalogue(gold: Any, tmp_path: Path) -> None:
    assert "Save the .blend file and mark again" in assets.mark(gold)
    assert gold.asset_data is not None and not any(tmp_path.glob("*.txt"))
    assert bpy.ops.measured_materials.mark_asset() == {"FINISHED"}, "a warning, and no failure"
    save(tmp_path)
    assert assets.mark(gold) == "" and gold.asset_data.catalog_id == catalogue_id(SHELF)


def test_without_its_bundle_it_keeps_the_picture_that_it_has(gold: Any, tmp_path: Path) -> None:
    save(tmp_path)
    bpy.ops.measured_materials.mark_asset()
    before = list(gold.preview.image_pixels)
    shutil.rmtree(tmp_path / "gold.mmat")
    assert assets.mark(gold) == "" and list(gold.preview.image_pixels) == before
    gold.preview.image_size = 0, 0
    copy = gold.copy()
    copy.preview_ensure().is_image_custom = False
    assert "picture" in assets.mark(copy)


def test_a_damaged_record_marks_nothing(gold: Any) -> None:
    gold[FACTS_KEY] = "{"
    with pytest.raises(RuntimeError, match="kind"):
        bpy.ops.measured_materials.mark_asset()
    assert gold.asset_data is None and "kind" in assets.mark_or_say(gold)


def test_cleared_it_is_an_ordinary_material_that_stays(gold: Any, tmp_path: Path) -> None:
    save(tmp_path)
    bpy.ops.measured_materials.mark_asset()
    assert bpy.ops.measured_materials.clear_asset() == {"FINISHED"}
    assert gold.asset_data is None and not gold.use_fake_user and SHELF in listed(tmp_path)
    bpy.context.object.active_material = None
    assets.mark(gold)
    assets.unmark(gold)
    assert gold.use_fake_user, "or it would be gone from the saved file"


def test_an_asset_follows_its_bake_and_nothing_else_does(gold: Any, tmp_path: Path) -> None:
    save(tmp_path)
    assert assets.refresh(gold) == "" and gold.asset_data is None
    assets.mark(gold, Rights("A. Weaver"))
    gold.asset_data.description = "older"
    gold.measured_materials.resolution = 7
    bpy.ops.measured_materials.bake_again()
    assert gold.asset_data.description.startswith("Reflectance by") and gold.asset_data.author == "A. Weaver"


def test_imports_mark_what_they_make(library: Path, tmp_path: Path) -> None:
    save(tmp_path)
    write_merl(tmp_path / "white-fabric.binary", by_name("lambert"))
    quick = {"resolution": 6, "parameterization": "bezier", "basis": "normal", "alpha": "given", "envelope": False}
    bpy.ops.measured_materials.import_brdf(filepath=str(tmp_path / "white-fabric.binary"), as_asset=True, **quick)
    bpy.ops.measured_materials.import_arc(filepath=str(library / "felt"), as_asset=True)
    bpy.ops.measured_materials.import_bundle(filepath=str(library / "gold.mmat"), as_asset=True)
    bpy.ops.measured_materials.import_bundle(filepath=str(library / "gold.mmat"))
    found = {m.name: m.asset_data and m.asset_data.catalog_id for m in bpy.data.materials if FACTS_KEY in m}
    shelves = listed(tmp_path)
    assert found == {
        "white-fabric": shelves["Measured Materials/Measurements"],
        "felt": shelves["Measured Materials/Photographs"],
        "ggx": shelves[SHELF],
        "ggx.001": None,
    }
    assert [tag.name for tag in bpy.data.materials["white-fabric"].asset_data.tags] == ["Measured", "MERL", "Cloth"]


def test_what_is_in_a_librarys_file_stays(tmp_path: Path) -> None:
    own = str(uuid.uuid4())
    before = f"# mine\r\nVERSION 1\r\n\r\n{own}:Wood/Oak: Oak \r\nnot a line of any use"
    (tmp_path / FILE).write_bytes(before.encode())
    assert add_catalogue(tmp_path, SHELF) == catalogue_id(SHELF)
    after = (tmp_path / FILE).read_bytes().decode()
    assert after.startswith(before) and after.count("\n") == after.count("\r\n")
    assert add_catalogue(tmp_path, SHELF) == catalogue_id(SHELF)
    assert (tmp_path / FILE).read_bytes().decode() == after
    assert [file.name for file in tmp_path.iterdir()] == [FILE]


def test_a_catalogue_is_known_by_its_number_or_its_path(tmp_path: Path) -> None:
    theirs = str(uuid.uuid4())
    (tmp_path / FILE).write_text(f"VERSION 1\n{catalogue_id('Measured Materials')}:Mine:Mine\n{theirs}:{SHELF}:x\n")
    before = (tmp_path / FILE).read_bytes()
    assert add_catalogue(tmp_path, SHELF) == theirs and (tmp_path / FILE).read_bytes() == before


@pytest.mark.parametrize("content", [b"VERSION 2\n", b"\xff\xfe\x00", b"x" * ((1 << 24) + 1)])
def test_files_that_are_not_understood_are_left_alone(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE).write_bytes(content)
    with pytest.raises(BakeError):
        add_catalogue(tmp_path, SHELF)
    assert (tmp_path / FILE).read_bytes() == content


def test_a_folder_that_cannot_be_written_is_told(gold: Any, tmp_path: Path) -> None:
    save(tmp_path)
    (tmp_path / FILE).mkdir()
    assert FILE in assets.mark(gold) and gold.asset_data is not None


def test_the_library_is_the_one_that_the_file_lies_in(tmp_path: Path) -> None:
    blend = tmp_path / "a" / "b" / "x.blend"
    assert library_of(blend, []) == blend.parent
    assert library_of(blend, [tmp_path / "c", tmp_path / "a"]) == tmp_path / "a"
    assert library_of(blend, [tmp_path / "a" / "b" / "x.blend" / "c"]) == blend.parent
    assert library_of(blend, [Path(os.sep)]) == Path(os.sep)


def test_the_folder_to_open(gold: Any, tmp_path: Path) -> None:
    assert folder_to_open(gold) == tmp_path
    assert folder_to_open(None) is None
    with pytest.raises(RuntimeError, match=r"save the \.blend file first"):
        with bpy.context.temp_override(object=None, active_object=None, material=None):
            bpy.ops.measured_materials.open_library()
    save(tmp_path / "..")
    assert folder_to_open(None) == (tmp_path / "..").resolve() or folder_to_open(None) == tmp_path / ".."
