"""The handlers that keep the tables of lamps current: what a render sees of them, and what they leave alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights import light_tables
from measured_materials.addon.lights.light_tables import TABLE, lamp_image
from measured_materials.addon.lights.world_survey import PROBE
from measured_materials.addon.studio import studio
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import HASH_KEY, content_hash
from measured_materials.nodes.shading_map_material import build_shading_map
from support.scenes import TestScene, diffuse_material, lit_sphere
from support.swatches import identity_map, map_bundle


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """As in a Blender with the extension; nothing of one test reaches the next."""
    kept = set(bpy.data.lights)
    light_tables.register()
    yield
    light_tables.unregister()
    for collection in (bpy.data.materials, bpy.data.node_groups, bpy.data.images, bpy.data.lights):
        for block in set(collection) - kept:
            collection.remove(block)


@pytest.fixture
def grey(tmp_path: Path) -> Bundle:
    return map_bundle(tmp_path / "grey", identity_map(), RenderSettings(sigma=0.5, mode="reference"))


@pytest.fixture
def scene(grey: Bundle) -> Iterator[TestScene]:
    """Dark, with a sphere of mirrors only."""
    with lit_sphere(diffuse_material(0.5), 16, lamp=False, ground=False, resolution=16) as scene:
        scene.scene.world = None
        scene.scene.cycles.samples = 8
        scene.show(build_shading_map(grey, lamps=lamp_image()))
        yield scene


def add_lamp(scene: bpy.types.Scene, place: tuple[float, float, float], energy: float = 100) -> Any:
    data = bpy.data.lights.new("POINT", "POINT")
    data.energy, data.shadow_soft_size = energy, 0.02
    data.cycles.use_multiple_importance_sampling = True
    obj = bpy.data.objects.new("POINT", data)
    obj.location = place
    scene.collection.objects.link(obj)
    return obj


def slots() -> set[int]:
    """Of all groups in use."""
    return {tree[SLOTS_KEY] for tree in bpy.data.node_groups if SLOTS_KEY in tree and tree.users}


def frames(scene: TestScene, folder: Path) -> list[np.ndarray]:
    """An animation rendered by the usual operator."""
    render = scene.scene.render
    render.filepath, render.image_settings.file_format = str(folder / "frame"), "OPEN_EXR"
    bpy.ops.render.render(animation=True, scene=scene.scene.name)
    found = []
    for frame in range(scene.scene.frame_start, scene.scene.frame_end + 1):
        image = bpy.data.images.load(render.frame_path(frame=frame))
        found.append(np.array(image.pixels[:]))
        bpy.data.images.remove(image)
    return found


# --- what a render sees -----------------------------------------------------------------------------------


def test_persistent_data_sees_every_frame(scene: TestScene, tmp_path: Path) -> None:
    """Cycles keeps its images from frame to frame; seeds and samples are the same, so the pictures are too."""
    lamp = add_lamp(scene.scene, (-2.5, -1, 2))
    for frame in (1, 2, 3):
        lamp.location.x = (-2.5, 2.5, 0)[frame - 1]
        lamp.keyframe_insert("location", frame=frame)
    scene.scene.frame_end = 3
    usual = frames(scene, tmp_path)
    scene.scene.render.use_persistent_data = True
    for _ in range(2):
        for once, again in zip(usual, frames(scene, tmp_path), strict=True):
            assert np.array_equal(once, again)


def test_persistent_data_sees_edits_between_stills(scene: TestScene) -> None:
    """Any number of them: one edit, two, three, and none."""
    lamp = add_lamp(scene.scene, (0, -2, 2))
    layer = scene.scene.view_layers[0]
    places = [[-2.5], [0, 2.5], [0, 1, -2.5], [], [2, 1, 0, 2.5]]

    def stills() -> list[np.ndarray]:
        found = []
        for moves in places:
            for x in moves:
                lamp.location.x = x
                layer.update()
            found.append(studio.render_linear(scene.scene))
        return found

    usual = stills()
    scene.scene.render.use_persistent_data = True
    assert all(np.array_equal(once, again) for once, again in zip(usual, stills(), strict=True))
    for tree in bpy.data.node_groups:
        assert tree[HASH_KEY] == content_hash(tree)  # else the scene check takes them for an artist's


def powers() -> list[float]:
    """Of the table's rows."""
    return [float(row[1, 3]) for row in np.array(lamp_image().pixels[:]).reshape(-1, 5, 4)[::-1]]


def key(owner: Any, name: str, *values: Any) -> None:
    """In frames 1, 2, ..."""
    for frame, value in enumerate(values, 1):
        setattr(owner, name, value)
        owner.keyframe_insert(name, frame=frame)
    setattr(owner, name, values[0])


def drive(owner: Any, name: str, expression: str) -> None:
    owner.driver_add(name).driver.expression = expression


LATER: dict[str, Any] = {
    "energy": lambda lamp: key(lamp.data, "energy", 0.0, 1000.0),
    "energy, driven": lambda lamp: drive(lamp.data, "energy", "1000 * (frame - 1)"),
    "hidden": lambda lamp: key(lamp, "hide_render", True, False),
    "hidden from glossy rays": lambda lamp: key(lamp, "visible_glossy", False, True),
}


@pytest.mark.parametrize("name", LATER)
def test_a_lamp_that_comes_later_is_aimed_at_when_it_comes(scene: TestScene, tmp_path: Path, name: str) -> None:
    add_lamp(scene.scene, (0, -1, 3))
    LATER[name](add_lamp(scene.scene, (1, -1, 3), 1000))
    scene.scene.frame_set(1)
    scene.scene.frame_end, scene.scene.cycles.samples = 2, 1
    seen = []

    def look(*_: Any) -> None:
        seen.append((slots(), sum(power > 0 for power in powers())))

    bpy.app.handlers.render_post.append(look)
    try:
        frames(scene, tmp_path)
    finally:
        bpy.app.handlers.render_post.remove(look)
    assert seen == [({2}, 1), ({2}, 2)]


def test_lamps_that_stay_dark_cost_nothing(scene: TestScene) -> None:
    add_lamp(scene.scene, (0, -1, 3))
    key(add_lamp(scene.scene, (1, -1, 3), 0), "location", (1, -1, 3), (2, -1, 3))
    add_lamp(scene.scene, (2, -1, 3)).hide_render = True
    light_tables.keep_current(scene.scene)
    # The viewport shows the one that no render shows.
    assert slots() == {2}
    bpy.data.objects.remove(next(obj for obj in scene.scene.objects if obj.hide_render and obj.type == "LIGHT"))
    scene.scene.view_layers[0].update()
    assert slots() == {1}


def test_view_layers_together(scene: TestScene) -> None:
    """A lamp of the second only, and one of a layer that is not rendered."""
    for name, used in (("second", True), ("unused", False)):
        collection = bpy.data.collections.new(name)
        scene.scene.collection.children.link(collection)
        collection.objects.link(add_lamp(bpy.data.scenes[0], (0, -1, 3)))
        bpy.data.scenes[0].collection.objects.unlink(collection.objects[0])
        scene.scene.view_layers[0].layer_collection.children[name].exclude = True
        scene.scene.view_layers.new(name).use = used
    scene.scene.view_layers["second"].layer_collection.children["unused"].exclude = True
    add_lamp(scene.scene, (1, -1, 3))
    report = light_tables.update_scene(scene.scene, for_render=True)
    assert len(report.lamps) == 2 and slots() == {2}
    for name in ("second", "unused"):
        bpy.data.collections.remove(bpy.data.collections[name])


# --- what they leave alone --------------------------------------------------------------------------------


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How often groups are built, and lamps looked at."""
    counts = {"aimed_light_group": 0, "survey": 0}

    def counting(name: str, function: Any) -> Any:
        def count(*arguments: Any, **named: Any) -> Any:
            counts[name] += 1
            return function(*arguments, **named)

        return count

    for name in counts:
        monkeypatch.setattr(light_tables, name, counting(name, getattr(light_tables, name)))
    return counts


def test_two_windows_on_two_scenes_come_to_rest(scene: TestScene, counted: dict[str, int]) -> None:
    """A material in both, under one lamp here and two there."""
    other = bpy.data.scenes.new("other")
    try:
        other.collection.objects.link(scene.sphere)
        add_lamp(scene.scene, (0, -1, 3))
        layers = [scene.scene.view_layers[0], other.view_layers[0]]
        moving, _ = (add_lamp(other, (x, -1, 3)) for x in (1, 2))

        def rounds(count: int) -> int:
            before = counted["aimed_light_group"]
            for _ in range(count):
                for layer in layers:
                    layer.update()
            return counted["aimed_light_group"] - before

        rounds(1)
        moving.location.z = 2  # handlers hear nothing of a scene's first evaluation
        rounds(2)
        assert slots() == {2}
        moving.location.z = 1
        assert rounds(4) == 0
        bpy.data.objects.remove(moving)
        rounds(3)
        assert slots() == {1}
    finally:
        bpy.data.scenes.remove(other)


def test_edits_of_materials_look_at_no_lamp(scene: TestScene, grey: Bundle, counted: dict[str, int]) -> None:
    """But a material that is new aims at what there is."""
    add_lamp(scene.scene, (0, -1, 3))
    layer = scene.scene.view_layers[0]
    layer.update()
    layer.update()
    before, material = counted["survey"], scene.sphere.data.materials[0]
    group = next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeGroup")
    group.inputs["Tint"].default_value = (0.5, 0.5, 0.5, 1)
    layer.update()
    assert counted["survey"] == before and slots() == {1}
    scene.show(build_shading_map(grey, lamps=lamp_image()))
    layer.update()
    assert slots() == {1}


def test_the_probe_of_the_world_is_no_scene_to_follow(scene: TestScene) -> None:
    add_lamp(scene.scene, (0, -1, 3))
    scene.scene.view_layers[0].update()
    probe = bpy.data.scenes.new("probe")
    try:
        probe[PROBE] = True
        probe.view_layers[0].update()
        assert slots() == {1} and sum(powers()) > 0
    finally:
        bpy.data.scenes.remove(probe)


def test_at_rest_no_table_asks_to_be_saved(scene: TestScene) -> None:
    """Blender asks an artist of every image that was written and not packed."""
    add_lamp(scene.scene, (0, -3, 3))
    light_tables.update_scene(scene.scene)
    tables = light_tables._tables()
    assert any(image.is_dirty for image in tables)
    before = [list(image.pixels) for image in tables]
    assert light_tables.pack_when_at_rest() is None
    assert not any(image.is_dirty for image in bpy.data.images)
    assert [list(image.pixels) for image in tables] == before and any(map(any, before))


def test_frames_make_no_datablock(scene: TestScene) -> None:
    """Where all tables are linked, as here all but in name."""
    add_lamp(scene.scene, (0, -1, 3))
    light_tables.update_scene(scene.scene)
    lamp_image().name = f"{TABLE} of elsewhere"
    before = len(bpy.data.images)
    scene.scene.frame_set(2)
    assert len(bpy.data.images) == before


def test_groups_are_known_by_what_they_are_not_by_name(scene: TestScene) -> None:
    for tree in bpy.data.node_groups:
        tree.name = "renamed"
    add_lamp(scene.scene, (0, -1, 3))
    light_tables.update_scene(scene.scene)
    assert slots() == {1}
