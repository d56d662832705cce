"""What bakes take here outlives the session; a damaged file is as good as none."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from measured_materials.addon.baking.request import BakeRequest
from measured_materials.addon.summary.quality_levels import expected_seconds, learn_pace, learned, pace, recall
from measured_materials.addon.ui.background import kept_pace, tasks
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.shading_maps.bake import ArcSettings
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from support.azimuth import lambert_basis, write_azimuth_bundle


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    file = tmp_path / "of the extension" / "bakes.json"
    monkeypatch.setattr(kept_pace, "file", lambda: file)
    before = learned()
    recall([])
    yield file
    recall(before)


def test_the_next_session_expects_what_this_one_has_learned(kept: Path) -> None:
    usual = expected_seconds(BakeSettings())
    learn_pace(BakeSettings(), 3 * usual)
    kept_pace.keep()
    recall([])
    assert pace() == 1
    kept_pace.register()
    assert pace() == pytest.approx(3) and expected_seconds(BakeSettings()) == pytest.approx(3 * usual)
    assert [path.name for path in kept.parent.iterdir()] == ["bakes.json"]


_DAMAGED = ["", "{", "[]", '{"ratios": 1}', '{"ratios": ["x"]}', '{"ratios": [null]}', "\0"]
# An integer beyond all floats, and lists deeper than Python follows.
_DAMAGED += [f'{{"ratios": [1{"0" * 400}]}}', "[" * 100_000]


@pytest.mark.parametrize("text", _DAMAGED, ids=range(len(_DAMAGED)))
def test_a_damaged_file_is_as_good_as_none(kept: Path, text: str) -> None:
    kept.parent.mkdir()
    kept.write_text(text)
    kept_pace.register()
    assert pace() == 1


def test_numbers_that_no_bake_has_taken_are_left_out(kept: Path) -> None:
    kept.parent.mkdir()
    kept.write_text('{"ratios": [NaN, -1, 0, 1e9, 2.0]}')
    kept_pace.register()
    assert learned() == [2.0]


def test_where_nothing_can_be_written_the_bake_goes_on(kept: Path) -> None:
    kept.parent.write_text("in the way")
    kept_pace.keep()
    assert not kept.exists()


def test_a_file_that_cannot_be_replaced_leaves_nothing_beside_it(kept: Path) -> None:
    kept.mkdir(parents=True)
    kept_pace.keep()
    assert [path.name for path in kept.parent.iterdir()] == ["bakes.json"]


def test_the_time_of_a_map_over_azimuth_teaches_nothing(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was expected as an arc, and all bakes share one pace."""
    record = ShadingMapRecord.read(write_azimuth_bundle(tmp_path / "felt.mmat", lambert_basis()))
    monkeypatch.setattr(tasks, "record_of", lambda _: record)
    task = tasks.ImportTask(BakeRequest(tmp_path, ArcSettings()), tmp_path, "felt", True, None, lambda _: None)
    material: Any = None
    task.learn(BakeResult(tmp_path, {}, 60.0), material)
    assert learned() == []
