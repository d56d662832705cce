"""A survey is kept while many materials are built, and never a stale one: after any edit it is that of a fresh look."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights import kept_surveys
from measured_materials.addon.lights.kept_surveys import surveyed, surveys_kept
from measured_materials.addon.lights.lamp_survey import survey_scene
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.together import built_together
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat
from support.lamp_edits import EDITS, add, lamp, spot_world


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[bpy.types.Scene]:
    """A plate, a lamp, a parent and the world's picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    compat.ensure_cycles()
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("plate")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [], [(0, 1, 2)])
    scene.collection.objects.link(bpy.data.objects.new("plate", mesh))
    add(scene, "SPOT", (0, -1, 3))
    add(scene, "AREA", (2, -1, 3))
    sky = np.full((16, 32, 3), 0.1, np.float32)
    sky[3, 7] = 900
    write_image(tmp_path / "spot.exr", sky, Storage.FLOAT32)
    scene["sky"] = str(tmp_path / "spot.exr")
    yield scene
    bpy.ops.wm.read_factory_settings(use_empty=False)


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """One for each survey."""
    counted: list[int] = []
    monkeypatch.setattr(
        kept_surveys, "survey_scene", lambda *given, **named: counted.append(1) or survey_scene(*given, **named)
    )
    return counted


def constrained(scene: bpy.types.Scene) -> None:
    target = bpy.data.objects.new("target", None)
    scene.collection.objects.link(target)
    lamp(scene).constraints.new("COPY_LOCATION").target = target


def nodes(scene: bpy.types.Scene) -> None:
    data = lamp(scene).data
    data.use_nodes = True
    data.node_tree.nodes["Emission"].inputs["Strength"].default_value = 3.0


def keyed(scene: bpy.types.Scene) -> None:
    obj = lamp(scene)
    for frame, energy in ((1, 0.0), (9, 500.0)):
        obj.data.energy = energy
        obj.data.keyframe_insert("energy", frame=frame)


def driven(scene: bpy.types.Scene) -> None:
    """By a number that is none of the scene's settings."""
    scene.objects["plate"]["watts"] = 100.0
    driver = lamp(scene).data.driver_add("energy").driver
    driver.type = "SUM"
    target = driver.variables.new().targets[0]
    target.id, target.data_path = scene.objects["plate"], '["watts"]'


def behind_glass(scene: bpy.types.Scene) -> None:
    """Once there is a world's picture that could be sampled, and a transparent film."""
    if scene.world is None:
        spot_world(scene)
        scene.render.film_transparent, scene.cycles.blur_glossy = True, 0.0
    else:
        scene.cycles.film_transparent_glass = True


MORE: dict[str, Callable[[bpy.types.Scene], object]] = {
    "multiple importance": lambda s: setattr(lamp(s).data.cycles, "use_multiple_importance_sampling", False),
    "hidden from renders": lambda s: setattr(lamp(s), "hide_render", True),
    "cone": lambda s: setattr(lamp(s).data, "spot_size", 0.3),
    "turned": lambda s: setattr(lamp(s), "rotation_euler", (1.0, 0, 0)),
    "unlinked": lambda s: s.collection.objects.unlink(lamp(s)),
    "collection hidden from renders": lambda s: setattr(s.collection, "hide_render", True),
    "plate moved": lambda s: setattr(s.objects["plate"], "location", (5, 5, 0)),
    "lamp nodes": nodes,
    "keys": keyed,
    "a layer more": lambda s: s.view_layers.new("more"),
    "constraint": constrained,
    "driver": driven,
    "transparent glass": behind_glass,
}


@pytest.mark.parametrize("edit", [*EDITS, *MORE])
def test_after_any_edit_the_report_is_that_of_a_fresh_look(scene: bpy.types.Scene, edit: str, looks: list[int]) -> None:
    """Twice in a row, for what was edited may be edited again; nothing is evaluated in between."""
    if edit.startswith("brighter"):
        EDITS[edit.removeprefix("brighter ")](scene)
    with surveys_kept():
        assert surveyed(scene) == surveyed(scene) and len(looks) == 1
        for _ in range(2):
            (EDITS | MORE)[edit](scene)
            told = surveyed(scene)
            assert told == survey_scene(scene, for_render=True), edit
            if not [obj for obj in scene.objects if obj.type == "LIGHT"]:
                break


@pytest.mark.parametrize("hangs_on", ["parent", "constraint", "instance", "driver"])
def test_what_carries_a_lamp_is_followed(scene: bpy.types.Scene, hangs_on: str) -> None:
    """A parent by its settings; a target, an instancer or a driver by looking every time."""
    (EDITS | MORE)[hangs_on](scene)
    with surveys_kept():
        before = surveyed(scene)
        if hangs_on == "driver":
            scene.objects["plate"]["watts"] = 900.0
            scene.objects["plate"].update_tag()
        for name in ("empty", "target", "instance"):
            if name in bpy.data.objects:
                bpy.data.objects[name].location.x += 2
        assert before != surveyed(scene) == survey_scene(scene, for_render=True)


def test_frames_are_other_surveys(scene: bpy.types.Scene) -> None:
    keyed(scene)
    with surveys_kept():
        found = []
        for frame in (1, 9):
            scene.frame_set(frame)
            found.append(surveyed(scene))
            assert found[-1] == survey_scene(scene, for_render=True)
    assert found[0] != found[1]


def test_a_hidden_lamp_is_followed(scene: bpy.types.Scene) -> None:
    """Blender evaluates none that the viewport hides, and tells nothing of it."""
    obj = lamp(scene)
    obj.hide_viewport = True
    with surveys_kept():
        surveyed(scene)
        obj.location, obj.data.energy = (3, 3, 3), 7.0
        assert surveyed(scene) == survey_scene(scene, for_render=True)


# --- builds -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    settings = BakeSettings(resolution=8, alpha=(0.5, 0.5), sampler=SamplerLayout(8, 8, 8), envelope=False)
    return read_bundle(bake_source(analytic.Lambert(), tmp_path_factory.mktemp("kept") / "a", settings).path)


def test_many_builds_take_one_survey(scene: bpy.types.Scene, bundle: Bundle, looks: list[int]) -> None:
    """And one more after an edit; without the frame around them, one each."""
    with built_together():
        plans = [build_brdf(bundle, scene=scene)[1] for _ in range(6)]
        assert len(looks) == 1 and all(plan.aim for plan in plans)
        for obj in [obj for obj in scene.objects if obj.type == "LIGHT"]:
            obj.visible_glossy = False
        assert not build_brdf(bundle, scene=scene)[1].aim and len(looks) == 2
    build_brdf(bundle, scene=scene)
    build_brdf(bundle, scene=scene)
    assert len(looks) == 4


def test_frames_within_one_another_keep_one_survey(scene: bpy.types.Scene, looks: list[int]) -> None:
    with surveys_kept():
        surveyed(scene)
        with surveys_kept():
            surveyed(scene)
        surveyed(scene)
    assert len(looks) == 1
    with surveys_kept():
        surveyed(scene)
    assert len(looks) == 2


def test_nothing_is_kept_after_an_error(scene: bpy.types.Scene, looks: list[int]) -> None:
    def fail() -> Any:
        with surveys_kept():
            surveyed(scene)
            raise RuntimeError("of the script")

    with pytest.raises(RuntimeError):
        fail()
    surveyed(scene)
    assert len(looks) == 2 and kept_surveys._reports.found is None
