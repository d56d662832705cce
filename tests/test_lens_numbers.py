"""Numbers of the camera's lens: even, spread better than white noise, and left alone where they cannot be trusted."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from measured_materials.addon.lights.motion import changes
from measured_materials.addon.lights.moving_camera import follow_cameras
from measured_materials.nodes import compat
from measured_materials.nodes.lens_group import MOVES, lens_group, lens_groups, value_node
from support.clean_blend import clean_blend  # noqa: F401
from support.lens_scenes import DISTANCE, EDGE, SAMPLES, Change, LensScene, evenness, lens_scene
from support.osl import skip_without_osl

# Of means over all pixels and samples: white noise of 65536 samples has a standard deviation of 0.0011 in u.
EVEN, MEANS = 0.01, (0.5, 0.5, 0.25, 0.5)
# Variance of pixel means at 64 samples, over white noise's: at most so much was seen as 0.024, 0.014, 0.016, 0.081.
SPREAD = (0.05, 0.03, 0.03, 0.12)
BLADED = (0.1, 0.08, 0.16, 0.3)  # 0.068, 0.057, 0.11, 0.21


def dof(**settings: Any) -> Change:
    def apply(scene: LensScene) -> None:
        for name, value in settings.items():
            setattr(scene.camera.data.dof, f"aperture_{name}" if name != "focus_distance" else name, value)

    return apply


def camera(**settings: Any) -> Change:
    return lambda scene: [setattr(scene.camera.data, name, value) for name, value in settings.items()]


def both(*changes: Change) -> Change:
    return lambda scene: [change(scene) for change in changes]


def scaled_and_parented(scene: LensScene) -> None:
    parent = scene._add("parent", None)
    parent.scale, parent.rotation_euler = (2, 1, 1), (0.3, 0, 0.2)
    for obj in (scene.camera, scene.wall):
        obj.parent = parent
    scene.camera.scale = (0.1, 3, 2)


def turned(scene: LensScene) -> None:
    scene.move(Matrix.Translation((3, -4, 2)) @ Matrix.Rotation(0.7, 4, (1, 2, 3)))


def unit_scale(scene: LensScene) -> None:
    scene.scene.unit_settings.scale_length = 0.01


def behind_a_veil(scene: LensScene) -> None:
    _add_before(scene, "ShaderNodeBsdfTransparent")


def _add_before(scene: LensScene, shader: str, **inputs: float) -> None:
    """A pane of this closure half way to the wall."""
    pane = scene._add("pane", scene.wall.data.copy())
    pane.location.z = -DISTANCE / 2
    material = compat.new_material("pane")
    tree = material.node_tree
    tree.nodes.clear()
    closure, output = tree.nodes.new(shader), tree.nodes.new("ShaderNodeOutputMaterial")
    for name, value in inputs.items():
        closure.inputs[name].default_value = value
    tree.links.new(closure.outputs[0], output.inputs[0])
    pane.data.materials.clear()
    pane.data.materials.append(material)


def moving(per_frame: float) -> Change:
    def apply(scene: LensScene) -> None:
        scene.scene.render.use_motion_blur = True
        for frame, place in ((0, -per_frame), (2, per_frame)):
            scene.camera.location.x = place
            scene.camera.keyframe_insert("location", frame=frame)
        scene.scene.frame_set(1)

    return apply


KNOWN: dict[str, tuple[Change, tuple[float, ...]]] = {
    "f/64": (lambda scene: None, SPREAD),
    "f/128": (dof(fstop=128.0), SPREAD),
    "a long lens": (camera(lens=200.0), SPREAD),
    "turned": (turned, SPREAD),
    "scaled and parented": (scaled_and_parented, SPREAD),
    "unit scale": (unit_scale, SPREAD),
    "orthographic": (camera(type="ORTHO"), SPREAD),
    "aperture ratio": (dof(ratio=2.0), SPREAD),
    "three blades": (both(dof(blades=3), dof(rotation=0.3)), BLADED),
    "six blades": (both(dof(blades=6), dof(rotation=0.3), dof(ratio=0.5)), BLADED),
    "orthographic, five blades": (both(camera(type="ORTHO"), dof(blades=5), dof(rotation=0.3)), BLADED),
    "behind something transparent": (behind_a_veil, SPREAD),
}
WHITE: dict[str, Change] = {
    "no depth of field": lambda scene: setattr(scene.camera.data.dof, "use_dof", False),
    "a real defocus": dof(fstop=0.01),
    "focus on an object": lambda scene: setattr(scene.camera.data.dof, "focus_object", scene.wall),
    "through glass": lambda scene: _add_before(scene, "ShaderNodeBsdfRefraction", IOR=1.5),
    "through a pane of no refraction": lambda scene: _add_before(scene, "ShaderNodeBsdfRefraction", IOR=1.0),
    "a camera that moves": moving(1e-3),
    "far from the origin": lambda scene: scene.move(Matrix.Translation((10_000, 0, 0))),
    "panoramic": both(camera(type="PANO"), lambda scene: setattr(scene.wall, "scale", (3, 3, 3))),
}


@pytest.mark.parametrize("name", KNOWN)
def test_even_and_well_spread(name: str) -> None:
    change, most = KNOWN[name]
    with lens_scene() as scene:
        change(scene)
        means = scene.numbers()
    assert means.mean((0, 1)) == pytest.approx(MEANS, abs=0.003)
    print(name, evenness(means).round(3))
    assert (evenness(means) < most).all()


@pytest.mark.parametrize("name", WHITE)
def test_white_noise_where_they_cannot_be_trusted(name: str) -> None:
    """Even, and as white noise; of a panorama in the middle, which the wall fills."""
    with lens_scene() as scene:
        WHITE[name](scene)
        means = scene.numbers()
    seen = (means[10:22, 10:22] if name == "panoramic" else means).reshape(-1, 4)
    assert seen.mean(0) == pytest.approx(MEANS, abs=EVEN)
    deviation = math.sqrt(2 / len(seen))
    assert evenness(seen) == pytest.approx(np.ones(4), abs=6 * deviation)


def test_nothing_moves_with_motion_blur_on() -> None:
    with lens_scene() as scene:
        scene.scene.render.use_motion_blur = True
        assert (evenness(scene.numbers()) < SPREAD).all()


def test_unbiased_at_a_distance_where_rounding_tells() -> None:
    """At 35 m points are off by a fiftieth of the lens' radius; without those beyond its rim u would be 0.498."""
    with lens_scene() as scene:
        scene.wall.location.z, scene.wall.scale = -35, (2.8, 2.8, 2.8)
        means = scene.numbers()
    assert means.mean((0, 1)) == pytest.approx(MEANS, abs=0.0012)
    assert (evenness(means) < 0.3).all()


def test_osl_draws_the_same_numbers() -> None:
    skip_without_osl()
    with lens_scene(osl=True) as scene:
        assert (evenness(scene.numbers()) < SPREAD).all()
        scene.camera.data.dof.use_dof = False
        assert evenness(scene.numbers()) == pytest.approx(np.ones(4), abs=6 * math.sqrt(2) / EDGE)


def test_more_samples_are_spread_better() -> None:
    with lens_scene() as scene:
        few, many = (evenness(scene.numbers(count), count)[:3] for count in (16, 4 * SAMPLES))
    assert (few < 0.2).all() and (many < 0.25 * few).all()


def test_each_scene_has_the_lens_of_its_own_camera(tmp_path: Path) -> None:
    """One group in the file: two scenes, an animated lens, and the file saved and opened again."""
    with lens_scene() as scene, lens_scene() as other:
        other.camera.data.lens = 120
        for frame, lens in ((1, 50.0), (3, 150.0)):
            scene.camera.data.lens = lens
            scene.camera.data.keyframe_insert("lens", frame=frame)
        for frame in (1, 3):
            scene.scene.frame_set(frame)
            assert (evenness(scene.numbers()) < SPREAD).all()
        assert (evenness(other.numbers()) < SPREAD).all()
        names = [part.scene.name for part in (scene, other)]
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "lens.blend"), copy=True)
    assert len(lens_groups()) == 1
    _check_opened(tmp_path / "lens.blend", names)


def _check_opened(file: Path, names: list[str]) -> None:
    """The scenes of a file, appended: their groups come along with their drivers."""
    with bpy.data.libraries.load(str(file)) as (_, target):
        target.scenes = names
    assert len(lens_groups()) == 2
    for scene in target.scenes:
        opened = LensScene.__new__(LensScene)
        opened.scene, opened.camera = scene, scene.camera
        opened.wall = next(obj for obj in scene.objects if obj.type == "MESH")
        shown = opened.wall.data.materials[0]
        opened.materials = [shown, shown]
        assert (evenness(opened.numbers())[1] < SPREAD[1]).all()
        bpy.data.scenes.remove(scene)


def test_a_camera_that_moves_is_told_to_all_groups() -> None:
    """Until told, it is taken for moving; another build forgets nothing; a driven lens is no animation of the
    material."""
    with lens_scene() as scene:
        group = lens_groups()[0]

        def value() -> float:
            return float(value_node(group, MOVES).outputs[0].default_value)  # type: ignore[union-attr]

        assert value() == 1
        follow_cameras()
        assert value() == 0
        lens_group()
        assert value() == 0
        moving(1e-3)(scene)
        follow_cameras()
        assert value() == 1
        scene.scene.render.use_motion_blur = False
        follow_cameras()
        assert value() == 0
        assert not changes(scene.materials[0].node_tree)


def test_one_group_for_all_materials() -> None:
    first = lens_group()
    assert lens_group() == first and len(lens_groups()) == 1
    drivers = lens_groups()[0].animation_data.drivers
    assert len(drivers) == 7 and all(d.driver.is_simple_expression for d in drivers)


def test_a_scene_without_a_camera_is_nothing_to_complain_of(capfd: pytest.CaptureFixture[str]) -> None:
    """Blender prints an error for every driver that divides by nothing, at each evaluation."""
    scene = bpy.data.scenes.new("no camera")
    try:
        material = compat.new_material("by the lens")
        material.node_tree.nodes.new("ShaderNodeGroup").node_tree = lens_group()
        obj = bpy.data.objects.new("plate", bpy.data.meshes.new("plate"))
        obj.data.materials.append(material)
        scene.collection.objects.link(obj)
        scene.view_layers[0].update()
        bpy.context.evaluated_depsgraph_get()
        printed = capfd.readouterr()
        assert "Driver" not in printed.out + printed.err
    finally:
        bpy.data.scenes.remove(scene)
