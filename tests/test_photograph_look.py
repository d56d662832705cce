"""Photographs looked at before they are baked: in order of elevation, with what is doubtful about them."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.baking import hosts as hosts_of
from measured_materials.addon.baking.job import DONE, FAILED, RUNNING, BakeJob
from measured_materials.addon.baking.look import Look, look_at, sentence
from measured_materials.addon.baking.request import BakeRequest
from measured_materials.addon.ui import photograph_look
from measured_materials.addon.ui.photograph_look import draw_lines, draw_look, looking, plot
from measured_materials.bake.photographs.settings import StackSettings
from measured_materials.bake.shading_maps.bake import ArcSettings
from support.stacks import frame, write_frame, write_stack


@pytest.fixture
def felt(tmp_path: Path) -> Path:
    return write_stack(tmp_path / "felt")


def test_in_order_of_elevation_and_as_bright_as_they_are(felt: Path) -> None:
    look = look_at(felt, StackSettings())
    assert look.elevations == (15, 35, 55, 75, 90) and look.names[0] == "el15.png"
    assert look.brightness[-1] == 1 and list(look.brightness) == sorted(look.brightness)
    assert look.pictures.shape == (5, 16, 20, 3) and look.pictures[0].mean() < look.pictures[-1].mean()
    assert look.doubts == ()
    assert Look.of_event(look.as_event()).elevations == look.elevations
    assert np.array_equal(Look.of_event(look.as_event()).pictures, look.pictures)


def test_what_is_doubtful_is_told_in_sentences(tmp_path: Path) -> None:
    few = look_at(write_stack(tmp_path / "few", (20, 60)), StackSettings())
    assert few.doubts[0].startswith("There are only 2 elevations")
    folder = write_stack(tmp_path / "felt")
    write_frame(folder / "el55.png", frame(55) * 0.3)
    falls = look_at(folder, StackSettings())
    assert any("lit from 55° is darker than that from 35°" in doubt for doubt in falls.doubts)
    write_frame(folder / "el55.png", np.minimum(frame(55) * 9, 1))
    assert any("clipped" in doubt or "white" in doubt for doubt in look_at(folder, StackSettings()).doubts)
    for number, path in enumerate(sorted(folder.iterdir())):
        path.rename(folder / f"photo{chr(97 + number)}.png")
    unknown = look_at(folder, StackSettings())
    assert unknown.elevations is None and "no file of lights" in unknown.doubts[0]
    assert list(unknown.brightness) == sorted(unknown.brightness)
    for look in (few, falls, unknown):
        named = [doubt for doubt in look.doubts if "." in doubt.split()[0]]
        assert all((doubt in named or doubt[0].isupper()) and doubt.endswith(".") for doubt in look.doubts)
    assert (sentence("a lamp moved"), sentence("el1.png is dark.")) == ("A lamp moved.", "el1.png is dark.")


def test_a_large_photograph_is_looked_at_small(tmp_path: Path) -> None:
    look = look_at(write_stack(tmp_path / "large", size=(600, 300)), StackSettings())
    assert max(look.pictures.shape[1:3]) <= 64 and look.pictures.shape[2] > look.pictures.shape[1]


def ended(job: BakeJob) -> str:
    job.start()
    until = time.monotonic() + 60
    while job.poll() == RUNNING and time.monotonic() < until:
        time.sleep(0.02)
    return job.state


def test_a_process_looks_and_leaves_nothing(felt: Path, tmp_path: Path) -> None:
    place = tmp_path / "place"
    place.mkdir()
    request = BakeRequest(felt, ArcSettings(), look=True)
    job = BakeJob(request, place / "x.mmat", hosts_of.hosts(request, ""))
    assert ended(job) == DONE and job.look is not None
    job.close()
    assert job.look.brightness == look_at(felt, StackSettings()).brightness and not list(place.iterdir())
    (felt / "el15.png").write_text("no photograph")
    job = BakeJob(request, place / "x.mmat", hosts_of.hosts(request, ""))
    assert ended(job) == FAILED and "el15.png" in str(job.error) and not list(place.iterdir())


@pytest.fixture
def followed(registered: None, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Stepped by hand."""
    monkeypatch.setattr(bpy.app.timers, "is_registered", lambda _: True)
    yield looking
    looking.stop()
    monkeypatch.undo()


def test_the_dialogue_opens_when_they_were_read(felt: Path, followed: Any) -> None:
    opened: list[Any] = []
    looking.begin(BakeRequest(felt, ArcSettings(), look=True), lambda: opened.append(looking.look))
    assert looking.is_looking() and not opened
    until = time.monotonic() + 60
    while looking.step() and time.monotonic() < until:
        time.sleep(0.02)
    assert len(opened) == 1 and opened[0].elevations[0] == 15
    texts: list[str] = []
    draw_look(Layout(texts), felt)
    assert "5 photographs, lit from 15° to 90°" in texts and "55°" in texts and "Brightness over elevation" in texts
    draw_look(Layout(texts := []), felt.parent)  # others
    assert not texts
    draw_lines(Layout(texts := []), "word " * 40, "ERROR")
    assert len(texts) > 2 and max(map(len, texts)) <= 72 and " ".join(texts).split() == ["word"] * 40


def test_the_dialogue_does_not_wait_for_ever(felt: Path, followed: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photograph_look, "_PATIENCE", 0.0)
    opened: list[Any] = []
    looking.begin(BakeRequest(felt, ArcSettings(), look=True), lambda: opened.append(looking.look))
    time.sleep(0.01)
    assert looking.step() and opened == [None]
    draw_look(Layout(texts := []), felt)
    assert texts == ["The photographs are being read"]
    looking.stop()
    assert not looking.step() and len(opened) == 1


def test_the_dialogue_is_no_higher_for_many_photographs_and_doubts(monkeypatch: pytest.MonkeyPatch) -> None:
    count, doubts = 49, tuple(f"Doubt {k} {'is long ' * 12}." for k in range(8))
    elevations = tuple(np.linspace(3, 88, count).tolist())
    look = Look(("x",) * count, elevations, elevations, np.zeros((count, 4, 6, 3), np.uint8), doubts)
    monkeypatch.setattr(looking, "look", look)
    monkeypatch.setattr(looking, "source", "many")
    place = draw_look(Layout(texts := []), "many")
    degrees = [text for text in texts if text.endswith("°") and text[0].isdigit()]
    assert len(degrees) == 10 and (degrees[0], degrees[-1]) == ("3°", "88°") and place.texts is texts
    assert "49 photographs, lit from 3° to 88°; 10 of them" in texts
    assert sum(text.startswith("Doubt") for text in texts) == 1 and "7 more, which are told after the bake" in texts
    monkeypatch.setattr(looking, "look", replace(look, doubts=("Doubt.",) * 4))
    draw_look(Layout(texts := []), "many")
    assert texts.count("Doubt.") == 4 and not any("more" in text for text in texts)


def test_the_plot_rises_with_the_brightness() -> None:
    drawn = plot((0.0, 90.0), (0.0, 1.0))
    ink = (drawn[..., 0] > 0.8) & (drawn[..., 2] < 0.3)
    rows, columns = np.nonzero(ink)
    assert np.corrcoef(rows, columns)[0, 1] > 0.99 and drawn.shape == (160, 160, 4)
    flat = np.nonzero(plot((0.0, 90.0), (1.0, 1.0))[..., 0] > 0.8)[0]
    assert np.ptp(flat) <= 6 and flat.mean() > 140


class Layout:
    """A layout that notes the texts put into it."""

    def __init__(self, texts: list[str]) -> None:
        self.__dict__["texts"] = texts

    def __setattr__(self, name: str, value: object) -> None:
        pass

    def label(self, *, text: str, icon: str = "NONE") -> None:
        self.texts.append(text)

    def template_icon(self, *, icon_value: int, scale: float) -> None:
        assert icon_value == 0 and scale > 0  # no icons without a window

    def column(self, **options: Any) -> Layout:
        return self

    row = split = grid_flow = column
