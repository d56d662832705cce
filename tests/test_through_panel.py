"""A swatch photographed against the light as well, in the window: imported, lit otherwise, rebuilt, and told of."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights import aim_targets
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.material import rebuild
from measured_materials.addon.material.adjust.energy import energy_of
from measured_materials.addon.material.facts import facts_of, record_of
from measured_materials.addon.material.kinds import SHADING_MAP, lets_light_through
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.addon.scene_check.findings import measured_trees
from measured_materials.addon.summary.parts import parts_of
from measured_materials.addon.ui.panels import panel
from measured_materials.addon.ui.properties.photographs import _shown, arc_settings_of
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.shading_maps.against_light import ThroughSettings
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.nodes.osl_script import is_scripted
from measured_materials.nodes.through_closure import PORTAL
from support.osl import skip_without_osl
from support.scenes import add_lamp, lit_sphere
from support.sharp_bounces import sharp_bounces  # noqa: F401
from support.stacks import ELEVATIONS, frame, write_frame, write_stack
from support.svm_stack import CLOSURES, aim_at_everything, closures_in, fits_with
from test_addon import Stage, registered  # noqa: F401
from test_svm_limits import ROOM

TRANSMITTANCE = 0.2


@pytest.fixture(scope="module")
def stacks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Felt, and the same against the light, of other texels."""
    folder = tmp_path_factory.mktemp("stacks")
    front, behind = write_stack(folder / "felt"), folder / "behind"
    behind.mkdir()
    for elevation in ELEVATIONS:
        write_frame(behind / f"el{elevation:02.0f}.exr", 0.4 * frame(elevation, seed=5))
    return front, behind


@pytest.fixture
def felt(stacks: tuple[Path, Path], plate: Any, tmp_path: Path) -> Any:
    """Imported with a second folder."""
    front, behind = stacks
    bpy.ops.measured_materials.import_arc(
        filepath=str(front),
        bundles=str(tmp_path),
        through=str(behind),
        through_by="transmittance",
        transmittance=TRANSMITTANCE,
        scale_by="albedo",
        albedo=0.4,
    )
    return plate.active_material


def test_a_second_folder_is_imported(felt: Any, stacks: tuple[Path, Path], tmp_path: Path) -> None:
    record = ShadingMapRecord.read(read_bundle(tmp_path / "felt.mmat"))
    assert record.through is not None and lets_light_through(felt)
    mean = np.mean(record.through.albedo.directional[0])
    assert mean == pytest.approx(TRANSMITTANCE, rel=0.1)
    assert any(node.bl_idname == PORTAL for tree in measured_trees(felt) for node in tree.nodes)
    kept = arc_settings_of(felt.measured_arc, felt.measured_lighting, "exact").through
    assert kept == ThroughSettings(stacks[1], None, TRANSMITTANCE)
    effects = {effect.name: effect for effect in rebuild.effects_of(felt)}
    assert effects["Light through the sheet"].kept
    assert not effects["Lamps sampled in the shader"].kept
    assert {"sample", "shader"} <= set(SHADING_MAP.effective(felt))


def test_a_loaded_bundle_is_baked_again_with_both_folders(
    felt: Any, stacks: tuple[Path, Path], plate: Any, tmp_path: Path
) -> None:
    """It keeps names alone: the second folder is found beside the first, and told where it is not there."""
    bpy.ops.measured_materials.import_bundle(filepath=str(tmp_path / "felt.mmat"))
    loaded = plate.active_material
    assert loaded != felt and loaded.measured_arc.through == "behind"
    kept = arc_settings_of(loaded.measured_arc, loaded.measured_lighting, "exact").through
    assert kept == ThroughSettings(Path("behind"), None, TRANSMITTANCE)
    assert bpy.ops.measured_materials.bake_again(filepath=str(stacks[0])) == {"FINISHED"}
    assert record_of(loaded).through is not None
    told = tmp_path / "felt.mmat" / "material.json"
    document = json.loads(told.read_text())
    document["settings"]["later"] = 1
    told.write_text(json.dumps(document))
    bpy.ops.measured_materials.import_bundle(filepath=str(told.parent))
    with pytest.raises(RuntimeError, match="photographs against the light: is neither here"):
        bpy.ops.measured_materials.bake_again(filepath=str(stacks[0]))


def test_a_second_folder_that_has_moved_is_told(felt: Any, stacks: tuple[Path, Path], tmp_path: Path) -> None:
    shutil.copytree(stacks[0], tmp_path / "moved" / "felt")
    felt.measured_arc.through = "behind"
    with pytest.raises(RuntimeError, match=r"behind: is neither here nor in .*moved; give the path"):
        bpy.ops.measured_materials.bake_again(filepath=str(tmp_path / "moved" / "felt"))


def test_the_window_offers_a_diffuser(felt: Any) -> None:
    properties = felt.measured_arc
    shown = _shown(properties, felt.measured_lighting)["through"]
    assert "transmittance" in shown and "diffuser" not in shown
    properties.through_by = "diffuser"
    properties.diffuser = (1, 2, 3, 4)
    shown = _shown(properties, felt.measured_lighting)["through"]
    assert {"diffuser", "diffuser_transmittance"} <= set(shown) and "transmittance" not in shown
    kept = arc_settings_of(properties, felt.measured_lighting, "exact").through
    assert kept is not None and kept.diffuser == (1, 2, 3, 4) and kept.transmittance is None


def test_lamps_are_sampled_on_both_sides_where_they_can_be(
    felt: Any,
    sharp_bounces: None,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a script in every Blender, as *Shade by OSL* asks for; where nodes can the scene check asks for it."""
    skip_without_osl()
    with lit_sphere(felt, 16, resolution=8) as scene:
        scene.leave_terminator()
        felt.measured_quality.shader = "osl"
        SHADING_MAP.refit(felt, scene.scene)
        effects = {effect.name: effect for effect in rebuild.effects_of(felt)}
        assert effects["Lamps sampled in the shader"].kept and is_scripted(felt)
        assert "Light through the sheet" not in effects and felt.cycles.emission_sampling == "NONE"
        update_scene(scene.scene)
        told = {finding.rule for finding in check_scene(scene.scene) or ()}
        # What it emits by kind of ray is what its own rays are spared.
        assert not {"not_sampled", "emission_light_path", "lamp_camera"} & told
        # Of more lamps it would sample two, and aims at all.
        for place in ((1, 2, 3), (2, 1, 3)):
            add_lamp(scene, "POINT", place, energy=50, shadow_soft_size=0.1).visible_camera = False
        assert "lamp_camera" in {finding.rule for finding in check_scene(scene.scene) or ()}
        SHADING_MAP.refit(felt, scene.scene)
        effects = {effect.name: effect for effect in rebuild.effects_of(felt)}
        assert not effects["Lamps sampled in the shader"].kept and effects["Light through the sheet"].kept
        assert "of 3 lamps" in effects["Lamps sampled in the shader"].why
        for lamp in [obj for obj in scene.scene.objects if obj.type == "LIGHT" and obj.data.type == "POINT"]:
            bpy.data.objects.remove(lamp)
        felt.measured_quality.shader = "nodes"
        SHADING_MAP.refit(felt, scene.scene)
        assert not is_scripted(felt)
        monkeypatch.setattr(aim_targets, "can_raycast", lambda: True)
        update_scene(scene.scene)
        found = check_scene(scene.scene)
        assert found is not None and "not_sampled" in {finding.rule for finding in found}


def test_another_transmission_takes_no_bake(felt: Any, tmp_path: Path) -> None:
    """Its share of light follows, and the material is made of its own textures."""
    before = facts_of(felt)["through"]["albedo"]
    shutil.rmtree(tmp_path / "felt.mmat")
    felt.measured_lighting.transmission = "phong"
    felt.measured_lighting.transmission_phong_exponent = 30.0
    felt.measured_lighting.transmission_sigma = 0.1
    assert not felt.measured_lighting.problem
    settings = rebuild.current_lighting(felt)
    assert settings.transmission.name == "phong" and settings.transmission_sigma == pytest.approx(0.1)
    assert settings.transmission.p1 == 30 and settings.lobe is not None and settings.lobe.name == "lambert"
    after = facts_of(felt)["through"]["albedo"]
    assert after["sigma"] == pytest.approx(0.1) and after["directional"] != before["directional"]
    assert facts_of(felt)["albedo"]["sigma"] != 0.1
    for mode in ("reference", "preview", "balanced", "exact"):
        felt.measured_quality.mode = mode
        assert not felt.measured_quality.problem
    assert rebuild.current_lighting(felt).transmission_sigma == pytest.approx(0.1)


def test_it_is_told_part_by_part(felt: Any) -> None:
    told = dict(row for rows in parts_of(record_of(felt)) for row in rows)
    assert told["Through: transmittance 0°"] and told["Through: base transmission"] == "lambert"
    assert told["Through: photographs"] == "5 lights, 5 levels"
    assert "R + T above one" not in told
    felt.measured_lighting.above = "scale"
    felt.measured_lighting.transmission_sigma = 0.9
    told = dict(row for rows in parts_of(record_of(felt)) for row in rows)
    assert "reflected and let through" in told["R + T above one"]


def test_what_is_let_through_counts_for_brightness(felt: Any) -> None:
    node = next(n for n in felt.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    node.inputs["Brightness"].default_value = 1.2
    energy = energy_of(felt)
    assert energy is not None and energy.through and energy.largest is not None
    record = record_of(felt)
    both = np.array(record.albedo.directional) + np.array(record.through.albedo.directional)
    assert energy.largest == pytest.approx(1.2 * both.max(), rel=1e-6)


def test_the_panel_offers_the_base_transmission(
    felt: Any, stacks: tuple[Path, Path], plate: Any, tmp_path: Path
) -> None:
    def shown() -> set[str]:
        return set(Stage(plate.active_material).drawn(panel._LightingPanel))

    assert {"transmission", "transmission_sigma_auto", "lobe"} <= shown()
    (tmp_path / "plain").mkdir()
    bpy.ops.measured_materials.import_arc(filepath=str(stacks[0]), bundles=str(tmp_path / "plain"))
    assert "transmission" not in shown()


@pytest.mark.parametrize("mode", ["exact", "balanced", "reference"])
def test_two_maps_leave_room(felt: Any, mode: str) -> None:
    """Of Cycles' stack and of its closures, with highlights in both directions."""
    for name in ("lobe", "transmission"):
        setattr(felt.measured_lighting, name, "phong")
    felt.measured_quality.mode = mode
    aim_at_everything()
    assert fits_with(felt, ROOM)
    assert closures_in(felt) <= CLOSURES // 2


def damaged(record: ShadingMapRecord, change: Any) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(json.dumps(record.document))
    change(document)
    return document


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(through=3), "through"),
        (lambda d: d["through"].pop("map"), "map"),
        (lambda d: d["through"]["map"].update(slices=5), "through"),
        (lambda d: d["through"]["map"].update(a_max=math.nan), "a_max"),
        (lambda d: d["images"].pop("through_envelope"), "envelope"),
        (lambda d: d["through"]["albedo"]["theta_o_deg"].__setitem__(0, 1), "at other angles"),
        (lambda d: d["render"].update(transmission={"name": "velvet"}, transmission_sigma=1.0), "velvet|name"),
        (lambda d: d["render"].update(transmission_sigma=-1.0, transmission={"name": "lambert"}), "transmission_sigma"),
    ],
)
def test_damaged_transmission_is_refused(felt: Any, tmp_path: Path, change: Any, says: str) -> None:
    record = ShadingMapRecord.read(read_bundle(tmp_path / "felt.mmat"))
    with pytest.raises(BakeError, match=says):
        ShadingMapRecord.parse(damaged(record, change), "felt")
