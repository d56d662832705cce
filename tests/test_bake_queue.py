"""The queue of bakes without a window: what is shown first, what stays, what a cancel and a closed file leave."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import measured_materials
import pytest
from measured_materials.addon.baking.request import BakeRequest, Model
from measured_materials.addon.material.facts import facts_of, is_measured
from measured_materials.addon.ui.background import bake_queue, tasks
from measured_materials.addon.ui.background.load_bundle import LoadTask
from measured_materials.addon.ui.background.tasks import STATE_KEY, AgainTask, ImportTask
from measured_materials.bake.brdf.bake import bake_file
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.nodes import portions
from measured_materials.nodes.material_tree import BUNDLE_KEY
from support.coarse_bakes import coarse  # noqa: F401
from support.imports import datablocks

SETTINGS = BakeSettings(8, "squared", basis="half")
queue = bake_queue.queue


@pytest.fixture
def plate(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """An active object with a plain material; everything made in the test goes with it."""
    monkeypatch.setattr(bpy.app.timers, "is_registered", lambda _: True)  # stepped by hand
    measured_materials.register()
    known = datablocks()
    mesh = bpy.data.meshes.new("plate")
    obj = bpy.data.objects.new("plate", mesh)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.active_material = bpy.data.materials.new("plain")
    yield obj
    queue.stop()
    bpy.data.objects.remove(obj)
    bpy.data.meshes.remove(mesh)
    for kind, before in known.items():
        bpy.data.batch_remove(set(getattr(bpy.data, kind)) - before)
    monkeypatch.undo()
    measured_materials.unregister()


def importing(measurement: Path, folder: Path, obj: Any, settings: BakeSettings = SETTINGS) -> ImportTask:
    return ImportTask(BakeRequest(measurement, settings, quick=True), folder, "made", True, obj, lambda material: None)


def until(condition: Any, seconds: float = 90) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        queue.step()
        time.sleep(0.01)


def shown(obj: Any) -> bool:
    return STATE_KEY in obj.active_material


def test_a_preview_comes_first_and_sharpens_in_place(measurement: Path, plate: Any, tmp_path: Path) -> None:
    queue.add([importing(measurement, tmp_path, plate)])
    until(lambda: shown(plate))
    material = plate.active_material
    assert material.measured_quality.mode == "preview" and not list(tmp_path.glob("*.mmat"))
    material.measured_quality.aim = "never"
    material.name = "my paint"
    until(lambda: not queue.is_busy())
    assert plate.active_material == material and material.name == "my paint" and not shown(plate)
    assert material.measured_quality.mode == "exact" and material.measured_quality.aim == "never"
    assert material[BUNDLE_KEY] == str(tmp_path / "made.mmat") and facts_of(material)["settings"]["resolution"] == 8
    assert [file.name for file in tmp_path.iterdir()] == ["made.mmat"]
    unused = [image.name for image in bpy.data.images if not image.users and image.name.startswith("lacquer")]
    assert not unused  # of the quick bake


@pytest.mark.parametrize("moment", ["at once", "shown"])
def test_cancel_takes_everything_back(moment: str, measurement: Path, plate: Any, tmp_path: Path) -> None:
    before, plain = datablocks(), plate.active_material
    queue.add([importing(measurement, tmp_path, plate, BakeSettings(48))])
    queue.step()
    if moment == "shown":
        until(lambda: shown(plate))
    queue.cancel()
    assert plate.active_material == plain and datablocks() == before
    assert not queue.is_busy() and not list(tmp_path.iterdir())


def test_a_material_that_is_gone_ends_its_bake(measurement: Path, plate: Any, tmp_path: Path) -> None:
    queue.add([importing(measurement, tmp_path, plate, BakeSettings(48))])
    until(lambda: shown(plate))
    bpy.data.materials.remove(plate.active_material)  # as undo does
    queue.step()
    assert not queue.is_busy() and not list(tmp_path.iterdir())


def test_a_bad_file_does_not_stop_the_next(
    measurement: Path, plate: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    monkeypatch.setattr(bake_queue, "tell", lambda words, kind="INFO": told.append(f"{kind} {words}"))
    queue.add([importing(tmp_path / "absent.binary", tmp_path, None), importing(measurement, tmp_path, plate)])
    until(lambda: not queue.is_busy())
    assert is_measured(plate.active_material)
    queue.tell_problems()
    wrong = [line for line in told if line.startswith("WARNING")]
    assert len(wrong) == 1 and "absent.binary: does not exist" in wrong[0]


def test_baking_again_beside_the_window_is_in_place(measurement: Path, plate: Any, tmp_path: Path) -> None:
    queue.add([importing(measurement, tmp_path, plate)])
    until(lambda: not queue.is_busy())
    material = plate.active_material
    queue.add([AgainTask(BakeRequest(measurement, BakeSettings(6, "squared", basis="half")), material, True, print)])
    until(lambda: not queue.is_busy())
    assert plate.active_material == material and facts_of(material)["settings"]["resolution"] == 6
    assert read_bundle(tmp_path / "made.mmat").material["settings"]["resolution"] == 6
    assert [file.name for file in tmp_path.iterdir()] == ["made.mmat"]


def test_half_a_loaded_material_is_taken_back(
    measurement: Path, plate: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bake_file(measurement, tmp_path / "made.mmat", SETTINGS)
    before, plain = datablocks(), plate.active_material
    monkeypatch.setattr(portions, "_LASTS", 0.0)
    monkeypatch.setattr(portions, "_WORKS", 0.004)
    task = LoadTask(tmp_path / "made.mmat", True, plate, lambda material: None)
    queue.add([task])
    until(lambda: len(bpy.data.node_groups) > len(before["node_groups"]) + 2)
    assert queue.is_busy() and plate.active_material == plain and queue.pause() < 0.05
    queue.cancel()
    assert not queue.is_busy() and datablocks() == before and (tmp_path / "made.mmat").is_dir()
    monkeypatch.undo()
    queue.add([task])
    until(lambda: not queue.is_busy())
    assert is_measured(plate.active_material)


def test_a_closed_file_ends_all_bakes(measurement: Path, plate: Any, tmp_path: Path) -> None:
    queue.add([importing(measurement, tmp_path, plate), importing(measurement, tmp_path, None)])
    queue.step()
    assert queue.is_busy() and list(tmp_path.iterdir())
    for handler in bpy.app.handlers.load_pre:
        if handler.__module__ == bake_queue.__name__:
            handler("")
    assert not queue.is_busy() and not list(tmp_path.iterdir())


def test_without_a_process_blender_bakes_itself(
    plate: Any, measurement: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "hosts", lambda request, blender: [])
    queue.add([importing(measurement, tmp_path, plate)])
    until(lambda: not queue.is_busy())
    assert is_measured(plate.active_material)


def test_a_model_is_no_file() -> None:
    assert BakeRequest(Model("ggx", {}), SETTINGS).title == "ggx"
