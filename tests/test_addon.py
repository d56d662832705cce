"""The add-on in Blender: registration, import, baking again, what the panel says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import measured_materials
import pytest
from measured_materials.addon.cli.inspect import inspect_bundle
from measured_materials.addon.material import bake_material
from measured_materials.addon.material.facts import FACTS_KEY, facts_of
from measured_materials.addon.material.kinds import BRDF
from measured_materials.addon.ui import drop_files, import_brdf, import_photographs
from measured_materials.addon.ui.context import shown_material
from measured_materials.addon.ui.panels import panel
from measured_materials.addon.ui.properties.bake import settings_of, show_settings
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.photographs.photograph import IMAGE_SUFFIXES
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import READERS
from measured_materials.bake.sources.analytic import by_name
from measured_materials.nodes.material_tree import BUNDLE_KEY, SOURCE_KEY
from support.coarse_bakes import baked_once, coarse  # noqa: F401

QUICK: dict[str, Any] = {
    "resolution": 8,
    "basis": "normal",
    "parameterization": "bezier",
    "alpha": "given",
    "envelope": False,
}


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    measured_materials.register()
    yield
    measured_materials.unregister()


@pytest.fixture(scope="module")
def known_bakes() -> dict[str, BakeResult]:
    """What `lacquer` has baked before."""
    return {}


@pytest.fixture
def lacquer(measurement: Path, plate: Any, tmp_path: Path, known_bakes: dict[str, BakeResult]) -> Any:
    """A measured material on the active object."""
    with baked_once(known_bakes, measurement.parent):
        bpy.ops.measured_materials.import_brdf(filepath=str(measurement), bundles=str(tmp_path), **QUICK)
    return plate.active_material


# --- registration -----------------------------------------------------------------------------------------


def test_register_unregister_register() -> None:
    for _ in range(2):
        assert hasattr(bpy.types.Material, "measured_materials")
        assert bpy.ops.measured_materials.import_brdf.idname()
        measured_materials.unregister()
        assert not hasattr(bpy.types.Material, "measured_materials")
        assert not hasattr(bpy.types, "MEASURED_MATERIALS_PT_material")
        measured_materials.register()


def test_failed_registration_leaves_nothing_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    measured_materials.unregister()

    def fail() -> None:
        raise RuntimeError("no panel today")

    with monkeypatch.context() as patch:
        patch.setattr(panel, "register", fail)
        with pytest.raises(RuntimeError, match="no panel today"):
            measured_materials.register()
    assert not hasattr(bpy.types.Material, "measured_materials")
    measured_materials.register()


def test_every_reader_can_be_browsed_and_dropped() -> None:
    dropped = set(drop_files.MEASURED_MATERIALS_FH_all.bl_file_extensions.split(";"))
    suffixes = {suffix for reader in READERS for suffix in reader.suffixes}
    assert dropped == suffixes | {".mmat", ".lp", ".csv"}
    # Pictures, which Blender makes nodes of, have a handler of their own: Blender asks which.
    pictures = drop_files.MEASURED_MATERIALS_FH_photographs
    assert set(pictures.bl_file_extensions.split(";")) == IMAGE_SUFFIXES and not dropped & IMAGE_SUFFIXES
    assert pictures.bl_import_operator == import_photographs.MEASURED_MATERIALS_OT_import_arc.bl_idname
    assert drop_files.MEASURED_MATERIALS_FH_all.bl_import_operator == drop_files.MEASURED_MATERIALS_OT_drop.bl_idname
    assert set(import_brdf._FILTER_GLOB.keywords["default"].split(";")) == {
        f"*{suffix}" for suffix in suffixes | {".exr"}
    }


def test_settings_survive_the_properties() -> None:
    material = bpy.data.materials.new("settings")
    try:
        properties = material.measured_materials
        assert settings_of(properties) == BakeSettings()
        others = (
            BakeSettings(9, "bezier", (0.25, 0.75), Storage.RGBE, "bspline", "plain", basis="normal"),
            BakeSettings(9, "squared", basis="half"),
            BakeSettings(9, "fitted", sampler=SamplerLayout()),
        )
        for other in others:
            show_settings(properties, other)
            assert settings_of(properties) == other
    finally:
        bpy.data.materials.remove(material)


# --- import -----------------------------------------------------------------------------------------------


def test_import_puts_the_material_on_the_object(lacquer: Any, measurement: Path, tmp_path: Path) -> None:
    assert lacquer.name == "lacquer" and lacquer.users == 1 and not lacquer.use_fake_user
    bundle = read_bundle(tmp_path / "lacquer.mmat")
    assert lacquer[BUNDLE_KEY] == str(bundle.path) and lacquer[SOURCE_KEY] == str(measurement)
    facts = facts_of(lacquer)
    assert facts["errors"] == bundle.material["errors"] and facts["packed"] is True
    assert lacquer.measured_materials.resolution == 8 and lacquer.measured_materials.alpha == "given"
    assert all(image.packed_file for image in bpy.data.images if image.name.startswith("lacquer"))


def test_import_without_an_object_keeps_the_material(measurement: Path, plate: Any, tmp_path: Path) -> None:
    bpy.context.view_layer.objects.active = None
    known = set(bpy.data.materials)
    files = [{"name": measurement.name}, {"name": measurement.name}]
    bpy.ops.measured_materials.import_brdf(
        directory=str(measurement.parent), files=files, bundles=str(tmp_path), pack=False, **QUICK
    )
    made = set(bpy.data.materials) - known
    assert len(made) == 2 and all(material.use_fake_user for material in made)
    # A second bundle of one name is not written over the first, which a material reads.
    assert {file.name for file in tmp_path.iterdir()} == {"lacquer.mmat", "lacquer_2.mmat"}
    assert not any(image.packed_file for image in bpy.data.images if image.name.startswith("lacquer"))


def test_bundles_lie_beside_the_measurement_until_told_otherwise(measurement: Path) -> None:
    assert not bpy.data.filepath
    assert bake_material.bundle_folder("", measurement) == measurement.parent


def test_bad_file_is_one_report_and_the_others_are_imported(measurement: Path, plate: Any, tmp_path: Path) -> None:
    (tmp_path / "bad.binary").write_bytes(measurement.read_bytes()[:1000])
    (tmp_path / "good.binary").symlink_to(measurement)
    files = [{"name": "bad.binary"}, {"name": "good.binary"}]
    with pytest.raises(RuntimeError) as failed:  # how Blender hands an error report to Python
        bpy.ops.measured_materials.import_brdf(directory=str(tmp_path), files=files, **QUICK)
    assert str(failed.value).strip().count("\n") == 0 and "bad.binary" in str(failed.value)
    assert plate.active_material.name == "good"
    assert not (tmp_path / "bad.mmat").exists()


# --- bake again -------------------------------------------------------------------------------------------


def test_baking_again_keeps_the_users(lacquer: Any, plate: Any, tmp_path: Path) -> None:
    before = facts_of(lacquer)["errors"]["rms"]
    images = {image.name for image in bpy.data.images}
    groups = len(bpy.data.node_groups)
    lacquer.measured_materials.resolution = 16
    assert bpy.ops.measured_materials.bake_again() == {"FINISHED"}
    assert plate.active_material == lacquer and lacquer.users == 1
    facts = facts_of(lacquer)
    assert facts["table"]["n"] == 16 and facts["errors"]["rms"] < before
    assert [file.name for file in tmp_path.iterdir()] == ["lacquer.mmat"]
    assert len(bpy.data.images) == len(images) and len(bpy.data.node_groups) == groups


def test_baking_a_copy_leaves_the_original_alone(lacquer: Any, plate: Any, tmp_path: Path) -> None:
    copy = lacquer.copy()
    plate.active_material = copy
    copy.measured_materials.resolution = 6
    bpy.ops.measured_materials.bake_again()
    assert copy[BUNDLE_KEY] != lacquer[BUNDLE_KEY]
    assert read_bundle(lacquer[BUNDLE_KEY]).material["table"]["n"] == 8
    assert facts_of(lacquer)["table"]["n"] == 8


def test_failed_baking_changes_nothing(lacquer: Any, tmp_path: Path) -> None:
    facts, node = lacquer[FACTS_KEY], lacquer.node_tree.nodes[0].name
    with pytest.raises(RuntimeError, match=r"absent\.binary: does not exist"):
        bpy.ops.measured_materials.bake_again(filepath=str(tmp_path / "absent.binary"))
    assert lacquer[FACTS_KEY] == facts and lacquer.node_tree.nodes[0].name == node
    lacquer[SOURCE_KEY] = str(tmp_path / "moved.binary")
    assert "moved.binary is not there" in BRDF.why_not_bakeable(lacquer)


def test_lost_measurement_can_be_replaced(lacquer: Any, measurement: Path, tmp_path: Path) -> None:
    lacquer[SOURCE_KEY] = str(tmp_path / "moved.binary")
    lacquer[BUNDLE_KEY] = str(tmp_path / "gone" / "lacquer.mmat")
    bpy.ops.measured_materials.bake_again(filepath=str(measurement))
    assert lacquer[SOURCE_KEY] == str(measurement) and Path(lacquer[BUNDLE_KEY]).parent == measurement.parent


def test_models_can_be_baked_again(plate: Any, tmp_path: Path) -> None:
    model = by_name("phong", diffuse=(0.1, 0.2, 0.3), exponent=7)
    settings = BakeSettings(resolution=6, alpha=(0.5, 0.5), envelope=False)
    material = bake_material.material_from(bake_source(model, tmp_path / "phong", settings), pack=True)
    assert BRDF.why_not_bakeable(material) == ""
    bake_material.bake_again(material, BakeSettings(resolution=8, alpha=(0.5, 0.5), envelope=False), pack=False)
    facts = facts_of(material)
    assert facts["source"]["facts"]["exponent"] == 7 and facts["table"]["n"] == 8
    material[BUNDLE_KEY] = str(tmp_path / "gone" / "phong.mmat")
    with pytest.raises(BakeError, match=r"save the \.blend"):
        bake_material.bake_again(material, settings, pack=True)
    del material[SOURCE_KEY]
    material[BUNDLE_KEY] = str(tmp_path / "phong.mmat")
    material[FACTS_KEY] = "{}"
    with pytest.raises(BakeError, match="choose the measurement"):
        bake_material.bake_again(material, settings, pack=True)
    assert "does not say" in BRDF.why_not_bakeable(material)


def test_baking_again_keeps_what_the_panel_does_not_show(plate: Any, tmp_path: Path) -> None:
    """To the very texels, as their hashes say."""
    settings = BakeSettings(6, basis="normal", envelope=False, sampler=SamplerLayout(16, 8, 8), viewers=(4, 2))
    result = bake_source(by_name("ggx", alpha=0.3, alpha_y=0.5), tmp_path / "brushed", settings)
    plate.active_material = material = bake_material.material_from(result, pack=True)
    show_settings(material.measured_materials, settings)
    before = dict(facts_of(material))
    assert bpy.ops.measured_materials.bake_again() == {"FINISHED"}
    assert facts_of(material) == before and Path(material[BUNDLE_KEY]) == result.path


def test_greyed_out_button_says_why(plate: Any) -> None:
    assert not bpy.ops.measured_materials.bake_again.poll()
    with pytest.raises(RuntimeError, match="no measured material here"):
        bpy.ops.measured_materials.bake_again()


# --- panel ------------------------------------------------------------------------------------------------


class Recorder:
    """A layout that notes the texts put into it."""

    def __init__(self, texts: list[str]) -> None:
        self.__dict__["texts"] = texts

    def __setattr__(self, name: str, value: object) -> None:
        pass

    def label(self, *, text: str, icon: str = "NONE") -> None:
        self.texts.append(text)

    def operator(self, idname: str, *, text: str = "", icon: str = "NONE", depress: bool = False) -> Recorder:
        self.texts.append(idname)
        return self

    def prop(self, properties: Any, name: str, **options: Any) -> None:
        assert name in properties.bl_rna.properties
        self.texts.append(name)

    def separator(self) -> None:
        pass

    def template_node_view(self, tree: Any, node: Any, socket: Any) -> None:
        assert node.id_data == tree and socket.node == node
        self.texts.append(socket.name)

    def template_icon(self, *, icon_value: int, scale: float) -> None:
        assert scale > 0

    def prop_enum(self, properties: Any, name: str, value: str, *, text: str = "") -> None:
        assert value in properties.bl_rna.properties[name].enum_items
        self.texts.append(text)

    def column(self, **options: Any) -> Recorder:
        return self

    row = split = grid_flow = column


class Stage:
    """What a panel sees."""

    engine, region = "CYCLES", None

    def __init__(self, material: Any) -> None:
        self.preferences = bpy.context.preferences
        self.material, self.layout, self.object = material, Recorder([]), None
        self.scene = bpy.context.scene

    def drawn(self, kind: Any) -> list[str]:
        kind.draw(self, self)
        return self.layout.texts


def test_panel_tells_source_error_and_sizes(lacquer: Any) -> None:
    texts = Stage(lacquer).drawn(panel._Panel)
    assert {"lacquer", "mode", "measured_materials.check_scene"} <= set(texts) and "Format: MERL" in texts
    assert "times the render time of a Principled BSDF" in " ".join(texts)
    texts = Stage(lacquer).drawn(panel._DetailsPanel)
    for text in ("MERL", "RMS error", "8 x 8 x 16, normal basis, bezier", "manually", "In files", "In memory"):
        assert text in texts
    stage = Stage(lacquer)
    stage.engine = "BLENDER_WORKBENCH"
    assert "approximates" in " ".join(stage.drawn(panel._Panel))


def test_the_panel_and_inspect_tell_the_same_in_one_order(lacquer: Any) -> None:
    """But for the sizes, which `inspect` tells of each image."""
    stage = Stage(lacquer)
    stage.region = type("Region", (), {"width": 4000})  # wide enough for every row
    drawn, lines = stage.drawn(panel._DetailsPanel), inspect_bundle(Path(lacquer[BUNDLE_KEY])).lines
    rows = [row for row in zip(drawn[::2], drawn[1::2], strict=True) if not row[0].startswith("In ")]
    told = [row for line in lines for row in rows if line.startswith(f"{row[0]} ") and line.endswith(f"  {row[1]}")]
    assert told == rows and len(rows) > 8


def test_panel_offers_settings_that_have_an_effect(lacquer: Any) -> None:
    texts = Stage(lacquer).drawn(panel._BakePanel)
    assert any(text.startswith("Custom: ") for text in texts)
    assert any(text.startswith("Standard: ") and text.endswith(" MB") for text in texts) and "resolution" not in texts
    lacquer.measured_materials.advanced = True
    texts = Stage(lacquer).drawn(panel._BakePanel)
    assert {"resolution", "alpha_theta", "measured_materials.bake_again"} <= set(texts) and "spline" not in texts
    others = {"rendering": "sampler", "files": "storage", "reading": "read_merl", "rights": "license"}
    for lacquer.measured_materials.part, name in others.items():
        texts = set(Stage(lacquer).drawn(panel._BakePanel))
        assert texts & {"resolution", *others.values()} == {name}
    lacquer.measured_materials.part = "table"
    lacquer.measured_materials.filter, lacquer.measured_materials.parameterization = "bspline", "uniform"
    texts = Stage(lacquer).drawn(panel._BakePanel)
    assert "spline" in texts and "alpha" not in texts


def test_panel_of_another_material_offers_the_import(plate: Any) -> None:
    plain = bpy.data.materials.new("plain")
    imports = [f"measured_materials.import_{kind}" for kind in ("brdf", "arc", "arc", "maps")]
    assert Stage(plain).drawn(panel._ImportPanel) == imports
    for other in (plain, None):
        assert panel._ImportPanel.poll(Stage(other))
        assert not panel._BakePanel.poll(Stage(other)) and not panel._Panel.poll(Stage(other))


def test_panel_survives_foreign_facts(lacquer: Any) -> None:
    for text in ("", "[]", "{", "{}", '{"source": 1}', "[" * 99999):
        lacquer[FACTS_KEY] = text
        assert Stage(lacquer).drawn(panel._Panel) and Stage(lacquer).drawn(panel._DetailsPanel), text
        Stage(lacquer).drawn(panel._BakePanel)
        shown_material(bpy.context)
