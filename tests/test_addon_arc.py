"""The add-on in Blender with photographs: import, another light without a bake, baking again, what the panel says."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.material import bake_photographs, rebuild
from measured_materials.addon.material.facts import FACTS_KEY, facts_of
from measured_materials.addon.material.kinds import SHADING_MAP, kind_of
from measured_materials.addon.material.lighting import lighting_of, show_lighting
from measured_materials.addon.material.textures import kept as textures
from measured_materials.addon.scene_check.findings import measured_trees
from measured_materials.addon.summary.bake_stages import USUAL_SIZE
from measured_materials.addon.ui.panels import panel
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.shading_maps.albedo import map_albedo_facts
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources.analytic import by_name
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import FAMILY_KEY
from measured_materials.nodes.material_tree import BUNDLE_KEY, SOURCE_KEY
from measured_materials.nodes.shading_map_material import build_shading_map
from support.coarse_bakes import coarse  # noqa: F401
from support.scenes import purge_groups
from support.stacks import write_stack
from test_addon import Stage, registered  # noqa: F401

GGX = RenderSettings(Lobe("ggx", 0.4), sigma=0.7, above="scale")


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_stack(tmp_path_factory.mktemp("stack") / "felt")


@pytest.fixture(scope="module")
def measured_brdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("brdf") / "gloss"
    settings = BakeSettings(resolution=8, alpha=(0.5, 0.5), envelope=False)
    return bake_source(by_name("ggx", alpha=0.5), path, settings).path


@pytest.fixture
def felt(stack: Path, plate: Any, tmp_path: Path) -> Any:
    """A shading-map material on the active object."""
    bpy.ops.measured_materials.import_arc(filepath=str(stack), bundles=str(tmp_path))
    return plate.active_material


def group_of(material: Any) -> Any:
    return next(node.node_tree for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeGroup")


def mapping_of(material: Any) -> Any:
    return next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeMapping")


def assert_lit_as(material: Any, settings: RenderSettings, bundle_path: Path) -> None:
    """As if it had been built from a bundle of this light; names of textures apart, which Blender numbers."""
    facts = {**read_bundle(bundle_path).material, "albedo": facts_of(material)["albedo"]}
    fresh = build_shading_map(Bundle(bundle_path, facts), settings=settings, lamps=lamp_image())
    assert shape_of(group_of(material)) == shape_of(group_of(fresh))
    assert rebuild.current_lighting(material) == settings


def shape_of(tree: Any) -> list[Any]:
    """All that a group computes: kinds, values, links, and the groups inside."""
    found: list[Any] = []
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeGroup":
            # How many lamps are aimed at depends on the scene, not on the material.
            found.append(node.node_tree.get(FAMILY_KEY) or shape_of(node.node_tree))
        values = [
            tuple(v) if hasattr(v := s.default_value, "__len__") else v
            for s in node.inputs
            if hasattr(s, "default_value")
        ]
        settings = [getattr(node, key, None) for key in ("operation", "interpolation", "extension", "distribution")]
        image = Path(node.image.filepath).name if node.bl_idname == "ShaderNodeTexImage" else None
        found.append((node.bl_idname, values, settings, image))
    links = [(k.from_socket.identifier, k.to_node.bl_idname, k.to_socket.identifier) for k in tree.links]
    return [*found, sorted(links)]


# --- import -----------------------------------------------------------------------------------------------


def test_import_puts_the_material_on_the_object(felt: Any, stack: Path, tmp_path: Path) -> None:
    assert felt.name == "felt" and felt.users == 1 and not felt.use_fake_user
    bundle = read_bundle(tmp_path / "felt.mmat")
    assert felt[BUNDLE_KEY] == str(bundle.path) and felt[SOURCE_KEY] == str(stack)
    facts = facts_of(felt)
    assert facts["errors"] == bundle.material["errors"] and facts["packed"] is True
    assert all(image.packed_file for image in textures.textures_of(felt).values())
    assert felt.measured_arc.size == USUAL_SIZE and felt.measured_lighting.lobe == "lambert"
    # A swatch of 20 x 16 keeps its proportions on square texture coordinates.
    assert tuple(mapping_of(felt).inputs["Scale"].default_value) == (1.0, 20 / 16, 1.0)


def test_import_of_chosen_files(stack: Path, plate: Any, tmp_path: Path) -> None:
    files = [{"name": name} for name in ("el15.png", "el55.png", "el90.png")]
    options = {"lobe": "ggx", "ggx_alpha": 0.25, "slices": 4, "scale_by": "albedo", "albedo": 0.3, "pack": False}
    bpy.ops.measured_materials.import_arc(directory=str(stack), files=files, bundles=str(tmp_path), **options)
    material = plate.active_material
    facts = facts_of(material)
    assert facts["averages"]["photographs"] == ["el15.png", "el55.png", "el90.png"]
    assert facts["render"]["lobe"] == {"name": "ggx", "alpha": 0.25} and facts["map"]["a_max"] > 0
    assert material.measured_lighting.ggx_alpha == 0.25 and material.measured_arc.scale_by == "albedo"
    assert bake_photographs.photographs_of(material) == [stack / file["name"] for file in files]
    assert not any(image.packed_file for image in textures.textures_of(material).values())


@pytest.mark.parametrize("chosen", ["el35.png", "lights.csv", ""])
def test_one_file_stands_for_its_folder(chosen: str, tmp_path: Path, plate: Any) -> None:
    folder = write_stack(tmp_path / "felt", (20, 50, 80))
    (folder / "lights.csv").write_text("file,elevation\nel20.png,21\nel50.png,51\nel80.png,81\n")
    where = {"filepath": str(folder / chosen), "directory": str(folder), "files": [{"name": chosen}]}
    bpy.ops.measured_materials.import_arc(**where, bundles=str(tmp_path))
    facts = facts_of(plate.active_material)
    assert facts["averages"]["elevations_deg"] == [21, 51, 81]


def test_fitted_lobe_is_shown(stack: Path, plate: Any, tmp_path: Path) -> None:
    bpy.ops.measured_materials.import_arc(filepath=str(stack), bundles=str(tmp_path), fit_lobe=True)
    material = plate.active_material
    fitted = facts_of(material)["lobe_fit"]["lobe"]
    assert lighting_of(material.measured_lighting, material.measured_quality.mode).lobe.name == fitted["name"]
    assert material.measured_arc.fit_lobe


def test_bad_stack_is_one_report_and_leaves_nothing(tmp_path: Path, plate: Any) -> None:
    folder = write_stack(tmp_path / "felt")
    (folder / "el40.png").write_text("no photograph")
    known = set(bpy.data.materials)
    with pytest.raises(RuntimeError) as failed:  # how Blender hands an error report to Python
        bpy.ops.measured_materials.import_arc(filepath=str(folder), bundles=str(tmp_path))
    assert str(failed.value).strip().count("\n") == 0 and "el40.png" in str(failed.value)
    assert set(bpy.data.materials) == known and not (tmp_path / "felt.mmat").exists()
    with pytest.raises(RuntimeError, match="No photographs were chosen"):
        bpy.ops.measured_materials.import_arc()


# --- another light ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", ["none", "power", "basis"])
def test_a_change_of_light_rebuilds_at_once(compression: str, stack: Path, plate: Any, tmp_path: Path) -> None:
    bpy.ops.measured_materials.import_arc(filepath=str(stack), bundles=str(tmp_path), compression=compression)
    material = plate.active_material
    bundle = read_bundle(tmp_path / "felt.mmat")
    purge_groups()  # what earlier tests have left
    images, groups = set(bpy.data.images), len(bpy.data.node_groups)
    written = (bundle.path / "material.json").stat().st_mtime_ns
    mapping_of(material).inputs["Scale"].default_value = (5, 5, 1)
    light = material.measured_lighting
    light.sigma = 0.8
    assert_lit_as(material, RenderSettings(sigma=0.8), bundle.path)
    light.lobe, light.ggx_alpha, light.above, light.tiling = "ggx", 0.4, "scale", "extend"
    assert_lit_as(material, RenderSettings(Lobe("ggx", 0.4), 0.8, "scale", tiling="extend"), bundle.path)
    material.measured_quality.mode = "reference"
    light.technique, light.a_max = "angular", 0.2
    last = RenderSettings(Lobe("ggx", 0.4), 0.8, "scale", "angular", "reference", "extend", 0.2)
    assert_lit_as(material, last, bundle.path)
    albedo = facts_of(material)["albedo"]
    expected = map_albedo_facts(ShadingMapRecord.read(bundle).load_map(), last, None)
    # The means are kept in float32. The colour is of this light, not of the one before.
    np.testing.assert_allclose(albedo["directional"], expected["directional"], rtol=1e-5)
    np.testing.assert_allclose(material.diffuse_color[:3], np.minimum(expected["white_sky"], 1), atol=1e-4)
    assert light.problem == "" and material.users == 1
    assert tuple(mapping_of(material).inputs["Scale"].default_value) == (5, 5, 1)
    assert images <= set(bpy.data.images)
    assert (bundle.path / "material.json").stat().st_mtime_ns == written
    light.lobe, light.technique, material.measured_quality.mode = "lambert", "lookup", "exact"
    purge_groups()  # those of the materials that this test compared with
    assert groups <= len(bpy.data.node_groups)


def test_ready_for_lamps_to_come_until_fitted(felt: Any) -> None:
    """Where there is nothing to aim at: rebuilt in the panel, and fitted to the scene."""
    lamps = [obj for obj in bpy.context.scene.objects if obj.type == "LIGHT"]
    for lamp in lamps:
        lamp.visible_glossy = False
    try:
        felt.measured_lighting.sigma = 0.4
        bpy.context.view_layer.update()
        assert [tree[SLOTS_KEY] for tree in measured_trees(felt) if SLOTS_KEY in tree] == [0]
        SHADING_MAP.refit(felt, bpy.context.scene)
        assert not [tree for tree in measured_trees(felt) if SLOTS_KEY in tree]
    finally:
        for lamp in lamps:
            lamp.visible_glossy = True


def test_nothing_piles_up(felt: Any) -> None:
    felt.measured_lighting.sigma = 0.3
    images, groups = len(bpy.data.images), len(bpy.data.node_groups)
    for sigma in (0.4, 0.6, 0.9):
        felt.measured_lighting.sigma = sigma
    assert (len(bpy.data.images), len(bpy.data.node_groups)) == (images, groups)


def test_packed_textures_need_no_bundle(felt: Any, tmp_path: Path) -> None:
    shutil.copytree(tmp_path / "felt.mmat", tmp_path / "kept.mmat")
    shutil.rmtree(tmp_path / "felt.mmat")
    assert SHADING_MAP.why_not_rebuildable(felt) == ""
    show_lighting(felt, GGX)
    felt.measured_lighting.tiling = "extend"
    assert_lit_as(felt, RenderSettings(GGX.lobe, GGX.sigma, GGX.above, tiling="extend"), tmp_path / "kept.mmat")
    assert felt.measured_lighting.problem == ""


def test_lost_textures_are_told_and_nothing_changes(stack: Path, plate: Any, tmp_path: Path) -> None:
    bpy.ops.measured_materials.import_arc(filepath=str(stack), bundles=str(tmp_path), pack=False)
    material = plate.active_material
    before = shape_of(group_of(material))
    (tmp_path / "felt.mmat").rename(tmp_path / "moved.mmat")
    for image in textures.textures_of(material).values():
        image.reload()  # as a new session would find them
    assert "felt.mmat" in SHADING_MAP.why_not_rebuildable(material)
    material.measured_lighting.sigma = 0.9
    assert "is gone" in material.measured_lighting.problem
    assert material.measured_lighting.sigma == 0 and shape_of(group_of(material)) == before
    material.measured_quality.mode = "preview"
    assert "is gone" in material.measured_quality.problem and material.measured_quality.mode == "exact"
    for kind in (panel._LightingPanel, panel._EffectsPanel):
        assert any("felt.mmat" in text for text in Stage(material).drawn(kind))
    (tmp_path / "moved.mmat").rename(tmp_path / "felt.mmat")
    assert SHADING_MAP.why_not_rebuildable(material) == ""
    material.measured_lighting.sigma = 0.9
    assert material.measured_lighting.problem == ""
    assert_lit_as(material, RenderSettings(sigma=0.9), tmp_path / "felt.mmat")


def test_another_bake_in_the_bundle_is_not_mixed_in(stack: Path, plate: Any, tmp_path: Path) -> None:
    bpy.ops.measured_materials.import_arc(filepath=str(stack), bundles=str(tmp_path), pack=False)
    material = plate.active_material
    shutil.rmtree(tmp_path / "felt.mmat")
    other = write_stack(tmp_path / "other" / "felt", (20, 70))
    bpy.ops.measured_materials.import_arc(filepath=str(other), bundles=str(tmp_path), pack=False)
    for image in textures.textures_of(material).values():
        bpy.data.images.remove(image)
    material.measured_lighting.sigma = 0.9
    assert "another bake" in material.measured_lighting.problem


def test_measured_brdf_as_f_r(stack: Path, measured_brdf: Path, plate: Any, tmp_path: Path) -> None:
    options = {"lobe": "measured", "brdf": str(measured_brdf), "bundles": str(tmp_path)}
    bpy.ops.measured_materials.import_arc(filepath=str(stack), **options)
    material = plate.active_material
    light = material.measured_lighting
    assert light.lobe == "measured" and set(textures.textures_of(material)) >= {"table", "sampler"}
    light.lobe = "ggx"
    light.lobe = "measured"
    light.sigma = 0.7
    assert light.problem == ""
    assert_lit_as(material, RenderSettings(None, 0.7), tmp_path / "felt.mmat")
    shutil.rmtree(tmp_path / "felt.mmat")
    light.lobe = "lambert"
    light.lobe = "measured"
    assert light.problem == "" and rebuild.current_lighting(material).lobe is None
    assert bpy.ops.measured_materials.bake_again() == {"FINISHED"}
    assert read_bundle(tmp_path / "felt.mmat").has("table")


def test_without_a_measured_brdf_there_is_none(felt: Any) -> None:
    felt.measured_lighting.lobe = "measured"
    assert felt.measured_lighting.lobe == "lambert" and "no measured BRDF" in felt.measured_lighting.problem
    felt.measured_lighting.lobe = "sheen"
    assert felt.measured_lighting.problem == ""


def test_a_copy_is_lit_apart(felt: Any, tmp_path: Path) -> None:
    copy = felt.copy()
    copy.measured_lighting.sigma = 0.9
    assert_lit_as(felt, RenderSettings(), tmp_path / "felt.mmat")
    assert_lit_as(copy, RenderSettings(sigma=0.9), tmp_path / "felt.mmat")
    assert textures.textures_of(copy) == textures.textures_of(felt)
    bpy.data.materials.remove(copy)
    felt.measured_lighting.sigma = 0.4
    assert felt.measured_lighting.problem == ""


# --- bake again -------------------------------------------------------------------------------------------


def test_baking_again_keeps_the_users(felt: Any, plate: Any, tmp_path: Path) -> None:
    images, groups = len(bpy.data.images), len(bpy.data.node_groups)
    show_lighting(felt, GGX)
    felt.measured_arc.slices = 4
    mapping_of(felt).inputs["Scale"].default_value = (3, 3, 1)
    assert bpy.ops.measured_materials.bake_again() == {"FINISHED"}
    assert plate.active_material == felt and felt.users == 1
    facts = facts_of(felt)
    assert facts["map"]["slices"] == 4 and facts["render"] == GGX.facts()
    assert [file.name for file in tmp_path.iterdir()] == ["felt.mmat"]
    assert len(bpy.data.images) == images
    # GGX has groups of its own beside those of Lambert's.
    assert len(bpy.data.node_groups) <= groups + 3
    assert tuple(mapping_of(felt).inputs["Scale"].default_value) == (3, 3, 1)
    felt.measured_lighting.sigma = 0.5
    assert felt.measured_lighting.problem == ""


def test_baking_a_copy_leaves_the_original_alone(felt: Any, plate: Any) -> None:
    copy = felt.copy()
    plate.active_material = copy
    copy.measured_arc.slices = 4
    bpy.ops.measured_materials.bake_again()
    assert copy[BUNDLE_KEY] != felt[BUNDLE_KEY]
    assert read_bundle(felt[BUNDLE_KEY]).material["map"]["slices"] == 8
    assert facts_of(felt)["map"]["slices"] == 8
    felt.measured_lighting.sigma = 0.4
    assert felt.measured_lighting.problem == ""


def test_failed_baking_changes_nothing(felt: Any, tmp_path: Path) -> None:
    facts = felt[FACTS_KEY]
    with pytest.raises(RuntimeError, match="does not exist"):
        bpy.ops.measured_materials.bake_again(filepath=str(tmp_path / "absent"))
    assert felt[FACTS_KEY] == facts
    felt.measured_lighting.sigma = 0.4
    assert felt.measured_lighting.problem == ""
    felt[SOURCE_KEY] = str(tmp_path / "moved")
    assert "moved is not there" in kind_of(felt).why_not_bakeable(felt)


def test_lost_photographs_can_be_replaced(felt: Any, stack: Path, tmp_path: Path) -> None:
    felt[SOURCE_KEY] = str(tmp_path / "moved")
    felt[BUNDLE_KEY] = str(tmp_path / "gone" / "felt.mmat")
    copied = shutil.copytree(stack, tmp_path / "copied" / "felt")
    bpy.ops.measured_materials.bake_again(filepath=str(copied))
    assert felt[SOURCE_KEY] == str(copied) and Path(felt[BUNDLE_KEY]).name.startswith("felt")
    felt[SOURCE_KEY] = ""
    with pytest.raises(RuntimeError, match="choose the photographs"):
        bpy.ops.measured_materials.bake_again()


# --- panel ------------------------------------------------------------------------------------------------


def test_panel_tells_photographs_energy_and_light(felt: Any) -> None:
    texts = Stage(felt).drawn(panel._DetailsPanel)
    told = ("felt", "5 lights, 5 levels", "8 slices of 20 x 16", "lambert", "Left-out error", "Cycles' shaders")
    for text in (*told, "In memory"):
        assert text in texts
    stage = Stage(felt)
    stage.engine = "BLENDER_EEVEE_NEXT"
    assert "EEVEE approximates" in " ".join(stage.drawn(panel._Panel))


def test_panels_offer_what_has_an_effect(felt: Any) -> None:
    assert panel._LightingPanel.poll(Stage(felt)) and panel._BakePanel.poll(Stage(felt))
    texts = Stage(felt).drawn(panel._LightingPanel)
    assert {"lobe", "sigma_auto", "above", "technique", "tiling"} <= set(texts) and not {
        "ggx_alpha",
        "mode",
        "sigma",
    } & set(texts)
    felt.measured_lighting.sigma_auto = False
    assert felt.measured_lighting.sigma == 0.5 and "sigma" in Stage(felt).drawn(panel._LightingPanel)
    felt.measured_lighting.sigma_auto = True
    assert felt.measured_lighting.sigma == 0
    assert {"aim", "detail"} <= set(texts := Stage(felt).drawn(panel._EffectsPanel)) and "filter" not in texts
    assert "mode" in Stage(felt).drawn(panel._Panel)
    felt.measured_lighting.lobe, felt.measured_lighting.technique = "phong", "lit_texture"
    texts = Stage(felt).drawn(panel._LightingPanel)
    assert {"phong_exponent", "phong_diffuse"} <= set(texts) and not {"above", "mode"} & set(texts)
    assert "mode" not in Stage(felt).drawn(panel._Panel)
    texts = Stage(felt).drawn(panel._BakePanel)
    assert "measured_materials.bake_again" in texts and "slices" not in texts
    felt.measured_arc.advanced = True
    texts = Stage(felt).drawn(panel._BakePanel)
    assert {"size", "slices", "measured_materials.bake_again"} <= set(texts)
    assert not {"rank", "crop", "gamma", "albedo", "azimuth", "brdf", "corner_top_left"} & set(texts)
    arc = felt.measured_arc
    arc.compression, arc.frame, arc.decode, arc.scale_by, arc.one_plane = "basis", "corners", "gamma", "card", True
    shown = {"swatch": "corner_top_left", "brightness": "white_card", "lights": "azimuth", "files": "rank"}
    for arc.part, name in shown.items():
        assert name in (texts := set(Stage(felt).drawn(panel._BakePanel))) and len(texts & {*shown.values()}) == 1


@pytest.mark.parametrize(
    "text", ["", "{}", '{"kind": "shading_map"}', '{"kind": "shading_map", "images": {"slices": 1}, "render": {}}']
)
def test_panel_survives_foreign_facts(text: str, felt: Any) -> None:
    felt[FACTS_KEY] = text
    assert Stage(felt).drawn(panel._Panel) and Stage(felt).drawn(panel._DetailsPanel)
    Stage(felt).drawn(panel._BakePanel)
    Stage(felt).drawn(panel._LightingPanel)
    felt.measured_lighting.sigma = 0.9
