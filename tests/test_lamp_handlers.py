"""The handlers that keep the tables of lamps current: what a render sees of them, and what they leave alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon import lamps, studio
from measured_materials.addon.lamps import lamp_image
from measured_materials.bake.bundle import Bundle
from measured_materials.bake.shading.render_settings import RenderSettings
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import HASH_KEY, content_hash
from measured_materials.nodes.shading_map_material import build_shading_map
from support.scenes import TestScene, diffuse_material, lit_sphere
from support.swatches import identity_map, map_bundle


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """As in a Blender with the extension; nothing of one test reaches the next."""
    kept = set(bpy.data.lights)
    lamps.register()
    yield
    lamps.unregister()
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
