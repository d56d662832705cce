"""The scene check on volumes that differ by kind of ray through Light Path nodes, proven by pictures."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.nodes.material import build_material
from support.checked_scenes import clean_blend, matte  # noqa: F401
from support.light_paths import BOUNCES, RAYS, darken, outputs, volume_in_a_material, world_volume
from support.scene_check_cases import rules
from support.scenes import TestScene, lit_sphere

HAZE = RAYS | BOUNCES | {"Is Shadow Ray"}


def scene_of(bundle: Bundle, mode: str = "reference") -> TestScene:
    scene = lit_sphere(build_material(bundle, mode=mode, lamps=lamp_image()), 24, resolution=16)
    scene.leave_terminator()
    return scene


def haze(scene: TestScene, output: str) -> None:
    """An absorbing world, clear where an output of Light Path is above 0.5."""
    world_volume(scene)
    tree = scene.scene.world.node_tree
    density = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeVolumeAbsorption").inputs["Density"]
    density.default_value = 0.3
    if output:
        darken(tree, density, output, 4.0 if output == "Ray Length" else 0.5)
    scene.scene.cycles.min_light_bounces = 1024


@pytest.mark.parametrize("output", outputs())
def test_volumes_that_differ_by_kind_of_ray_are_told(matte: Bundle, output: str) -> None:
    with scene_of(matte) as scene:
        haze(scene, output)
        update_scene(scene.scene)
        found = rules(scene)
        assert set(found) == ({"volume_light_path"} if output in HAZE else set())
        assert not found or output in found["volume_light_path"].found


def test_a_material_s_volume_is_told_of_too(matte: Bundle) -> None:
    with scene_of(matte) as scene:
        volume_in_a_material(scene)
        scene.scene.cycles.min_light_bounces = 1024
        tree = next(o for o in scene.scene.objects if o.name == "emitter").data.materials[0].node_tree
        density = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeVolumeScatter").inputs["Density"]
        update_scene(scene.scene)
        assert not rules(scene)
        darken(tree, density, "Is Shadow Ray", 0.5)
        assert set(rules(scene)) == {"volume_light_path"}


def in_haze(bundle: Bundle, mode: str, output: str, seeds: int) -> float:
    with scene_of(bundle, mode) as scene:
        mask = scene.mask()
        scene.scene.world.node_tree.nodes.clear()
        haze(scene, output)
        update_scene(scene.scene)
        return float(scene.render(48, seeds)[:, mask].mean())


@pytest.mark.parametrize("output", ["", "Is Shadow Ray", "Is Glossy Ray", "Ray Length"])
def test_haze_that_differs_by_kind_of_ray_parts_the_modes(matte: Bundle, output: str) -> None:
    """Three seeds know it to 1 %; a matte material is Cycles' own Diffuse in Exact, and a mirror in Reference."""
    ratio = in_haze(matte, "reference", output, 3) / in_haze(matte, "exact", output, 3)
    assert abs(ratio - 1) > 0.1 if output in HAZE else ratio == pytest.approx(1, abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("output", outputs())
def test_no_other_output_parts_them(matte: Bundle, output: str) -> None:
    """Of depths and kinds that follow the first bounce a percent is seen: the ground's light on the ball."""
    ratio = in_haze(matte, "reference", output, 6) / in_haze(matte, "exact", output, 6)
    assert abs(ratio - 1) < 0.02 or output in HAZE
