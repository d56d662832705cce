"""Bundles that are there already, loaded in the window: as chosen, dropped, bad ones among them."""

from __future__ import annotations

import json
import shutil
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from measured_materials.addon.material.facts import facts_of
from measured_materials.addon.material.kinds import BRDF, SHADING_MAP, kind_of
from measured_materials.addon.ui.background import window as background
from measured_materials.addon.ui.background.load_bundle import bundles_meant
from measured_materials.addon.ui.drop_files import problems_of, sorted_by_kind
from measured_materials.bake.bundle.bundle import MATERIAL
from measured_materials.bake.photographs.settings import StackSettings
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.sources import measurements_in
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl
from measured_materials.nodes.material_tree import BUNDLE_KEY
from support.coarse_bakes import coarse  # noqa: F401


def load(**chosen: Any) -> Any:
    return bpy.ops.measured_materials.import_bundle(**chosen)


def test_a_bundle_becomes_the_objects_material(library: Path, plate: Any) -> None:
    assert load(filepath=str(library / "gold.mmat")) == {"FINISHED"}
    material = plate.active_material
    assert kind_of(material) is BRDF and material[BUNDLE_KEY] == str(library / "gold.mmat")
    assert material.measured_materials.resolution == 6 and material.measured_materials.basis == "half"
    assert all(image.packed_file for image in bpy.data.images if image.name.startswith("ggx"))
    assert BRDF.why_not_bakeable(material) == ""  # of a model, which the bundle tells


def test_a_script_in_a_window_closes_a_step_of_undo(
    monkeypatch: pytest.MonkeyPatch, library: Path, measurement: Path, plate: Any, tmp_path: Path
) -> None:
    """Without one Blender 4.3 crashes at an undo that takes the new materials away."""
    pushed: list[str] = []
    monkeypatch.setattr(background, "bpy", SimpleNamespace(app=SimpleNamespace(background=False)))
    monkeypatch.setattr(background, "window", nullcontext)
    monkeypatch.setattr(background, "push", pushed.append)
    load(filepath=str(library / "gold.mmat"))
    bpy.ops.measured_materials.import_brdf(
        filepath=str(measurement), bundles=str(tmp_path), resolution=8, envelope=False
    )
    assert pushed == ["Import Measured Material", "Import BRDF"]
    again: Any = SimpleNamespace(options=SimpleNamespace(is_repeat=True), bl_label="Again")
    background.push_for_script(again)
    assert len(pushed) == 2  # done again from its panel: Blender's own step


def test_photographs_are_asked_for_before_they_are_baked_again(library: Path, plate: Any) -> None:
    load(filepath=str(library / "felt.mmat"), pack=False)
    material = plate.active_material
    assert kind_of(material) is SHADING_MAP and not facts_of(material)["packed"]
    assert "does not say what it was baked from" in SHADING_MAP.why_not_bakeable(material)


def test_several_at_once_as_a_browser_gives_them(library: Path, plate: Any) -> None:
    known = set(bpy.data.materials)
    load(directory=str(library), dirs=[{"name": "gold.mmat"}, {"name": "felt.mmat"}])
    made = set(bpy.data.materials) - known
    assert len(made) == 2 and plate.active_material in made
    assert [material.use_fake_user for material in made].count(True) == 1


def test_what_an_artist_may_choose_instead_of_the_folder(library: Path) -> None:
    gold, felt = library / "gold.mmat", library / "felt.mmat"
    for chosen, meant in (
        ([gold], [gold]),
        ([gold / MATERIAL, gold / "preview.png"], [gold]),
        ([library], [felt, gold]),
        ([library, gold], [felt, gold]),
    ):
        assert bundles_meant(chosen) == (meant, [])
    found, errors = bundles_meant([library / "felt", library / "absent.mmat", gold])
    assert found == [gold] and len(errors) == 2


def test_bad_ones_are_reported_and_the_others_are_loaded(library: Path, plate: Any, tmp_path: Path) -> None:
    shutil.copytree(library / "gold.mmat", tmp_path / "good.mmat")
    shutil.copytree(library / "gold.mmat", tmp_path / "bad.mmat")
    (tmp_path / "bad.mmat" / MATERIAL).write_text("{")
    with pytest.raises(RuntimeError) as failed:
        load(directory=str(tmp_path))
    assert str(failed.value).strip().count("\n") == 0 and "bad.mmat" in str(failed.value)
    assert plate.active_material[BUNDLE_KEY] == str(tmp_path / "good.mmat")
    with pytest.raises(RuntimeError, match="is not a bundle"):
        load(filepath=str(tmp_path / "letter.txt"))
    with pytest.raises(RuntimeError, match="No measured material was chosen"):
        load()


def test_files_of_several_kinds_can_be_dropped_together(library: Path, plate: Any, tmp_path: Path) -> None:
    names = ["gold.mmat", "a.binary", "lights.csv", "b.BSDF", "felt.MMAT", "arc.lp"]
    assert sorted_by_kind(names) == (["gold.mmat", "felt.MMAT"], ["lights.csv", "arc.lp"], ["a.binary", "b.BSDF"])
    assert sorted_by_kind(["a.binary"]) == ([], [], ["a.binary"])


def test_a_bad_one_among_those_dropped_keeps_no_other_away(library: Path, plate: Any, tmp_path: Path) -> None:
    """All that is wrong comes as one list."""
    for name in ("bad.mmat", "worse.mmat"):
        (tmp_path / name).mkdir()
    good = partial(load, filepath=str(library / "gold.mmat"))
    bad = partial(load, directory=str(tmp_path), files=[{"name": "bad.mmat"}, {"name": "worse.mmat"}])
    first, second = problems_of([bad, good])
    assert "bad.mmat: is not a bundle" in first and "worse.mmat: is not a bundle" in second
    assert not first.startswith("Error") and kind_of(plate.active_material) is BRDF


def test_a_folder_of_measurements_is_imported_whole(plate: Any, tmp_path: Path) -> None:
    """What nobody can read is named, what is of another program is left alone."""
    write_merl(tmp_path / "felt.binary", by_name("lambert"))
    (tmp_path / "cut.binary").write_bytes((tmp_path / "felt.binary").read_bytes()[:-8])
    (tmp_path / "letter.txt").write_text("Dear Ada")
    (tmp_path / "empty").mkdir()
    assert [path.name for path in measurements_in(tmp_path)] == ["cut.binary", "felt.binary"]
    with pytest.raises(RuntimeError, match=r"cut\.binary") as failed:
        bpy.ops.measured_materials.import_brdf(filepath=str(tmp_path), resolution=8, envelope=False)
    assert "letter" not in str(failed.value) and plate.active_material.name == "felt"
    with pytest.raises(RuntimeError, match="empty: holds no measurement"):
        bpy.ops.measured_materials.import_brdf(filepath=str(tmp_path / "empty"))


def test_a_loaded_swatch_shows_the_settings_that_it_was_baked_with(library: Path, plate: Any, tmp_path: Path) -> None:
    stack = StackSettings(size=12, crop=(0, 0, 14, 12), spread=33.0)
    settings = ArcSettings(slices=5, compression="basis", stack=stack)
    bake_arc(library / "felt", tmp_path / "felt.mmat", settings)
    load(filepath=str(tmp_path / "felt.mmat"))
    shown = plate.active_material.measured_arc
    assert (shown.slices, shown.compression, shown.size, shown.spread) == (5, "basis", 12, 33)
    assert shown.frame == "crop" and tuple(shown.crop) == (0, 0, 14, 12)
    document = json.loads((tmp_path / "felt.mmat" / MATERIAL).read_text())
    document["settings"]["stack"]["weather"] = "rain"
    record = ShadingMapRecord.parse(document, "felt")
    assert record.settings is None and record.map.slices == 5
