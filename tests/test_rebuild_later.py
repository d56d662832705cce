"""A mode chosen in a panel: built by a timer where it takes long, and one step of undo all the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest
from measured_materials.addon.material.facts import facts_of
from measured_materials.addon.material.load_bundle import load_bundle
from measured_materials.addon.material.rebuild import current_lighting
from measured_materials.addon.ui.background import rebuild_later
from measured_materials.addon.ui.background.tasks import STATE_KEY
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources.analytic import by_name
from measured_materials.nodes import portions
from support.coarse_bakes import coarse  # noqa: F401
from support.swatches import map_bundle, rough_map


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bundle") / "gold.mmat"
    bake_source(by_name("ggx", alpha=0.3, diffuse=0.2), path, BakeSettings(6, "squared", basis="half"))
    return path


@pytest.fixture
def material(bundle: Path, plate: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """One whose panel is in a window, and whose portions do little; stepped by hand."""
    made = load_bundle(bundle, pack=True)
    plate.active_material = made
    monkeypatch.setattr(rebuild_later, "_is_panel", lambda context: True)
    monkeypatch.setattr(bpy.app.timers, "is_registered", lambda _: True)
    monkeypatch.setattr(portions, "_LASTS", 0.0)
    monkeypatch.setattr(portions, "_WORKS", 0.004)
    yield made
    rebuild_later._pending.clear()
    monkeypatch.undo()


def built_as(material: Any) -> str:
    mode: str = facts_of(material)["rendering"]["choices"]["mode"]
    return mode


def unused() -> set[str]:
    """Groups that nothing uses; of other tests there may be some."""
    return {tree.name for tree in bpy.data.node_groups if not tree.users and not tree.use_fake_user}


def to_the_end() -> int:
    for number in range(5000):
        if rebuild_later.tick() is None:
            return number
    raise AssertionError("it does not end")


def test_it_is_built_step_by_step(material: Any) -> None:
    before = unused()
    material.measured_quality.mode = "reference"
    assert STATE_KEY in material and built_as(material) == "exact"
    assert to_the_end() > 1 and built_as(material) == "reference" and STATE_KEY not in material
    assert unused() <= before


def test_the_last_choice_counts(material: Any) -> None:
    material.measured_quality.mode = "reference"
    rebuild_later.tick()
    material.measured_quality.mode = "preview"
    to_the_end()
    assert built_as(material) == "preview" == material.measured_quality.mode and STATE_KEY not in material


def test_what_cannot_be_built_is_told_and_set_back(material: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    kind = rebuild_later.kinds.kind_of(material)
    build, calls = type(kind).rebuild_as_set, []

    def fails_later(self: Any, *arguments: Any) -> None:
        calls.append(1)
        if len(calls) > 2:
            raise rebuild_later.kinds.BakeError("gold", "has lost its table", "bake it again")
        build(self, *arguments)

    monkeypatch.setattr(type(kind), "rebuild_as_set", fails_later)
    material.measured_quality.mode = "reference"
    assert STATE_KEY in material
    to_the_end()
    assert "has lost its table" in material.measured_quality.problem
    assert material.measured_quality.mode == "exact" == built_as(material) and STATE_KEY not in material


def test_a_swatchs_lighting_is_built_step_by_step_too(material: Any, plate: Any, tmp_path: Path) -> None:
    """And its mode with it, if that changes meanwhile."""
    swatch = load_bundle(map_bundle(tmp_path / "felt", rough_map(), RenderSettings(Lobe("lambert"))).path, pack=True)
    swatch.measured_lighting.lobe = "ggx"
    assert STATE_KEY in swatch and current_lighting(swatch).lobe.name == "lambert"
    rebuild_later.tick()
    swatch.measured_quality.mode = "balanced"
    assert to_the_end() > 1 and STATE_KEY not in swatch and not rebuild_later._lit
    built = current_lighting(swatch)
    assert (built.lobe.name, built.mode) == ("ggx", "balanced")
    swatch.measured_lighting.sigma = 0.5
    to_the_end()
    assert current_lighting(swatch).sigma == 0.5 and current_lighting(swatch).mode == "balanced"


def test_a_material_that_is_gone_ends_it(material: Any) -> None:
    material.measured_quality.mode = "reference"
    bpy.data.materials.remove(material)
    assert to_the_end() <= 1


def test_scripts_have_it_at_once(material: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rebuild_later, "_is_panel", lambda context: False)
    material.measured_quality.mode = "reference"
    assert built_as(material) == "reference" and STATE_KEY not in material and not rebuild_later._pending
