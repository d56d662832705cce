"""Draft, Standard and Fine: the same for the window and the command line, and what they are expected to take."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import bpy
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.addon.summary import quality_levels as levels
from measured_materials.addon.ui.properties.bake import _draw_table, settings_of
from measured_materials.addon.ui.properties.photographs import arc_settings_of
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.shading_maps.bake import ArcSettings
from measured_materials.bake.tables.search.byte_limit import LEAST_BYTES, MOST_BYTES
from support.coarse_bakes import coarse  # noqa: F401
from support.stacks import write_stack


@pytest.fixture
def material(registered: None) -> Any:
    made = bpy.data.materials.new("levels")
    yield made
    bpy.data.materials.remove(made)


def test_standard_is_what_a_bake_is_by_itself(material: Any) -> None:
    assert levels.level_of(BakeSettings(), levels.BRDF_LEVELS) == "standard"
    assert levels.level_of(ArcSettings(), {"standard": {"slices": 8}}) == "standard"
    assert material.measured_materials.quality == "standard" and material.measured_arc.quality == "standard"
    assert settings_of(material.measured_materials) == BakeSettings()


@pytest.mark.parametrize("level", levels.LEVELS)
def test_a_level_sets_the_others_and_they_tell_it(level: str, material: Any) -> None:
    bake, arc = material.measured_materials, material.measured_arc
    bake.quality = arc.quality = level
    settings = settings_of(bake)
    assert {name: getattr(settings, name) for name in levels.BRDF_LEVELS[level]} == levels.BRDF_LEVELS[level]
    chosen = arc_settings_of(arc, material.measured_lighting, "balanced")
    assert (chosen.stack.size, chosen.slices) == tuple(levels.MAP_LEVELS[level].values())
    assert bake.quality == arc.quality == level
    bake.resolution += 1
    arc.full_size = True
    assert bake.quality == arc.quality == "custom" and arc.size == 0
    resolution = bake.resolution
    bake.quality = "custom"  # nothing to set
    assert bake.resolution == resolution
    arc.full_size = False
    assert arc.size == 1024


def test_finer_takes_longer_and_more() -> None:
    brdfs = [BakeSettings(**levels.BRDF_LEVELS[level]) for level in levels.LEVELS]
    maps = [
        replace(ArcSettings(slices=kept["slices"]), stack=replace(ArcSettings().stack, size=kept["size"]))
        for kept in levels.MAP_LEVELS.values()
    ]
    for settings in (brdfs, maps):
        for expected in (levels.expected_seconds, levels.expected_megabytes):
            numbers = [expected(one) for one in settings]
            assert numbers == sorted(numbers) and len(set(numbers)) == 3
    # Five measured materials of 64 samples take from 4.2 to 5.6 megabytes.
    assert 4 < levels.expected_megabytes(BakeSettings()) < 6
    assert levels.expected_megabytes(BakeSettings(envelope=False)) < 2.5
    # Of light from every side the rank counts, and slices, which there are none of, do not.
    for expected in (levels.expected_seconds, levels.expected_megabytes):
        low, usual, high = (expected(ArcSettings(azimuths="all", azimuth_rank=rank)) for rank in (2, None, 23))
        assert expected(ArcSettings()) < usual and low < usual < high
        assert usual == expected(ArcSettings(azimuths="all", slices=30))


def test_bytes_of_a_table_are_expected_instead_of_its_resolution() -> None:
    fine = BakeSettings(storage=Storage.LOG, **levels.BRDF_LEVELS["fine"])
    small, large = (replace(fine, table_bytes=most) for most in (2700, 1 << 18))
    for expected in (levels.expected_seconds, levels.expected_megabytes):
        assert expected(small) == expected(replace(small, resolution=32)) < expected(large)
    tables = [levels.expected_megabytes(one) for one in (large, small)]
    assert tables[0] - tables[1] == pytest.approx(2 * ((1 << 18) - 2700) / 1e6)
    assert levels.expected_megabytes(small) < levels.expected_megabytes(fine)


class Column:
    """A layout that notes which properties are offered, and whether they can be set."""

    def __init__(self, noted: dict[str, bool]) -> None:
        self.noted, self.enabled = noted, True

    def row(self) -> Column:
        return Column(self.noted)

    def prop(self, properties: Any, name: str) -> None:
        self.noted[name] = self.enabled


def test_the_panel_offers_a_resolution_or_bytes(material: Any) -> None:
    bake = material.measured_materials

    def can_set_resolution() -> bool:
        noted: dict[str, bool] = {}
        _draw_table(cast(Any, Column(noted)), bake)
        return noted["resolution"]

    bake.table_bytes = 4096
    assert can_set_resolution() and settings_of(bake).table_bytes is None  # of the usual storage
    bake.storage = "log"
    assert not can_set_resolution() and settings_of(bake).table_bytes == 4096
    bake.table_bytes = 0
    assert can_set_resolution() and settings_of(bake).table_bytes is None


@pytest.mark.parametrize(
    ("typed", "kept"), [(1, LEAST_BYTES), (1023, LEAST_BYTES), (1025, 1025), (1 << 30, MOST_BYTES)]
)
def test_bytes_that_no_bake_takes_cannot_be_typed(typed: int, kept: int, material: Any) -> None:
    bake = material.measured_materials
    bake.storage, bake.table_bytes = "log", typed
    assert bake.table_bytes == kept == settings_of(bake).table_bytes


def test_bakes_here_teach_how_long_they_take(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(levels, "_ratios", [])
    usual = levels.expected_seconds(BakeSettings())
    levels.learn_pace(BakeSettings(), 3 * usual)
    assert levels.expected_seconds(BakeSettings()) == pytest.approx(3 * usual)
    levels.learn_pace(BakeSettings(), 3 * usual)  # as now expected: the same machine
    assert levels.pace() == pytest.approx(3)
    for _ in range(20):
        levels.learn_pace(BakeSettings(), usual)
    assert levels.pace() == pytest.approx(1)  # the last ones count
    assert levels.expectation_words(BakeSettings()) == f"{usual:.0f} s, 5 MB"
    levels.learn_pace(BakeSettings(), 0.0)
    assert levels.pace() == pytest.approx(1)


def run(*arguments: str, capsys: Any) -> dict[str, Any]:
    assert main([*arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)["bundles"][0]["settings"]
    return found


def test_the_command_line_has_the_levels(tmp_path: Path, capsys: Any) -> None:
    brdf = ["bake", "brdf", "--analytic", "lambert", "--no-envelope", "--out", str(tmp_path)]
    given = run(*brdf, "--quality", "draft", "--resolution", "8", capsys=capsys)
    assert (given["resolution"], given["basis"], given["parameterization"]) == (8, "half", "squared")
    usual = run(*brdf, "--resolution", "8", capsys=capsys)
    assert (usual["basis"], usual["parameterization"]) == ("auto", "auto")
    folder = write_stack(tmp_path / "felt")
    arc = ["bake", "arc", str(folder), "--out", str(tmp_path)]
    fine = run(*arc, "--quality", "fine", "--replace", capsys=capsys)
    assert fine["stack"]["size"] == 2048 and fine["slices"] == 12
    whole = run(*arc, "--quality", "fine", "--size", "0", "--slices", "5", "--replace", capsys=capsys)
    assert whole["stack"]["size"] is None and whole["slices"] == 5
