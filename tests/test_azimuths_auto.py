"""What `azimuths auto` makes of photographs, what it says of that, and that nothing is read or tried twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs import plan, stack
from measured_materials.bake.photographs.stack import StackSettings
from measured_materials.bake.shading_maps import bake, baked_map, slice_atlas
from measured_materials.bake.shading_maps.azimuth import azimuth_fit
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc, bake_stack
from measured_materials.bake.tiling import tileable
from support.relief import bumps, photographs
from support.stacks import write_stack
from test_azimuth_bake import DOME, record_at, settings, stack_of, write_dome


@pytest.fixture
def felt(tmp_path: Path) -> Path:
    write_dome(tmp_path / "felt")
    return tmp_path / "felt"


@pytest.mark.parametrize(
    ("place", "name", "value", "more", "cause"),
    [
        (
            baked_map,
            "MAX_MAP_BYTES",
            39 * 24 * 24 * 12,
            {},
            "shading map would take more than 0 GiB as 40 levels of 24 x 24",
        ),
        (slice_atlas, "MAX_EXTENT", 511, {"azimuth_rank": 16}, "shading map would be an image of 24 x 512, beyond 511"),
        (plan, "MAX_STACK_BYTES", 24 * 24 * 24 * 12, {}, "felt needs 0.0 GiB as 25 x 24 x 24 texels"),
        (tileable, "MAX_VALUES", 24 * 24 * 24 * 3, {"tileable": "offset"}, "25 x 24 x 24 are too large to tile"),
    ],
)
def test_what_all_lights_are_too_many_for_is_baked_of_one_arc_and_told(
    felt: Path, monkeypatch: pytest.MonkeyPatch, place: Any, name: str, value: int, more: dict[str, Any], cause: str
) -> None:
    monkeypatch.setattr(place, name, value)
    asked = settings(**more)
    read: list[str] = []
    record = record_at(bake_arc(felt, felt.with_suffix(".mmat"), asked, lambda stage, _: read.append(stage)).path)
    assert record.map.model == "slices"
    warnings = record.photographs.warnings
    assert any(text.startswith("one arc is used instead") and f"{cause}; " in text for text in warnings), warnings
    assert not any(str(felt.parent) in text for text in warnings)
    # Headers show it: no photograph of another light was read for nothing.
    assert read.count("reading") <= len(record.photographs.averages) + 1


def test_a_map_of_every_side_that_no_memory_holds_is_refused_with_what_helps(
    felt: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(baked_map, "MAX_MAP_BYTES", 39 * 24 * 24 * 12)
    with pytest.raises(BakeError, match=r"40 levels of 24 x 24; choose a smaller --size, or --azimuths arc"):
        bake_arc(felt, felt.with_suffix(".mmat"), settings(azimuths="all"))
    # As many levels as there are: the arc of eight slices of the same size goes in, and so do 40 levels of this one.
    monkeypatch.setattr(baked_map, "MAX_MAP_BYTES", 40 * 24 * 24 * 12)
    assert record_at(bake_arc(felt, felt.with_suffix(".mmat"), settings()).path).map.model == "azimuth"


def counted(monkeypatch: pytest.MonkeyPatch, place: Any, name: str) -> list[str]:
    """Calls of a function from now on."""
    calls, function = [], getattr(place, name)

    def called(*given: Any, **more: Any) -> Any:
        calls.append(name)
        return function(*given, **more)

    monkeypatch.setattr(place, name, called)
    return calls


def test_lights_are_found_once_and_the_interpolation_is_chosen_once(
    felt: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, tried = counted(monkeypatch, stack, "find_lights"), counted(monkeypatch, azimuth_fit, "trials")
    assert record_at(bake_arc(felt, felt.with_suffix(".mmat"), settings()).path).map.model == "azimuth"
    assert len(found) == len(tried) == 1


def test_where_one_arc_foretells_better_it_is_what_it_is_by_itself(felt: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arc = record_at(bake_arc(felt, felt.with_name("arc.mmat"), settings(azimuths="arc")).path)
    monkeypatch.setattr(bake, "foretells", lambda *_: False)
    found = counted(monkeypatch, stack, "find_lights")
    record = record_at(bake_arc(felt, felt.with_name("auto.mmat"), settings(azimuth_rank=5)).path)
    assert record.map.model == "slices" and len(found) == 1
    assert np.array_equal(record.load_map().slices, arc.load_map().slices)
    told = "azimuth rank 5 has no effect on the map of one arc"
    assert record.photographs.warnings == (*arc.photographs.warnings, told)
    # Photographs already read are tried in the same way.
    all_around = stack_of(photographs(bumps(16), DOME), DOME)
    assert record_at(bake_stack(all_around, felt.with_name("read.mmat"), settings()).path).map.model == "slices"


def test_an_old_bundle_of_one_arc_of_many_is_baked_as_one_arc_again(felt: Path) -> None:
    record = record_at(bake_arc(felt, felt.with_name("a.mmat"), settings(azimuths="arc")).path)
    told = dict(record.document["settings"])
    assert told.pop("azimuths") == "arc"
    old = type(record).parse({**record.document, "settings": told}, "old")
    assert old.settings is not None and old.settings.azimuths == "arc"
    # What auto was asked for stays so, and of a folder that is an arc nothing need be said.
    record = record_at(bake_arc(felt, felt.with_name("b.mmat"), settings(compression="power")).path)
    assert record.map.model == "power"
    assert record.document["settings"]["azimuths"] == "auto"
    assert record.settings is not None and record.settings.azimuths == "auto"
    write_stack(felt.with_name("arc"), suffix=".exr")
    record = record_at(bake_arc(felt.with_name("arc"), felt.with_name("c.mmat"), settings()).path)
    assert record.settings is not None and record.settings.azimuths == "auto"


@pytest.mark.parametrize(
    ("value", "cause"), [(0.0, "black in every"), (-1.0, "negative or not"), (np.nan, "not finite")]
)
def test_photographs_that_show_nothing_are_one_line(tmp_path: Path, value: float, cause: str) -> None:
    images = np.full((len(DOME), 8, 8, 3), value, np.float32)
    with pytest.raises(BakeError, match=cause):
        bake_stack(stack_of(images, DOME), tmp_path / "dark", ArcSettings(azimuths="all"))


def test_a_rank_that_photographs_do_not_allow_is_told(tmp_path: Path) -> None:
    few = DOME[8:13]
    asked = ArcSettings(azimuths="all", azimuth_rank=9, stack=StackSettings(align="off"))
    facts = bake_stack(stack_of(photographs(bumps(16), few), few), tmp_path / "few", asked).facts
    assert "5 photographs allow an azimuth rank of 4, not of 9" in facts["warnings"]


def test_slices_that_were_asked_for_in_vain_are_told(felt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    common = ["bake", "photographs", str(felt), "--align", "off", "--size", "0", "--out", str(felt.parent / "out")]
    assert main([*common, "--slices", "32"]) == 0
    assert "--slices has no effect on a map over azimuth" in capsys.readouterr().err
    assert main([*common, "--replace"]) == 0
    assert "--slices" not in capsys.readouterr().err
