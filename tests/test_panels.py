"""Panels: text that fits, and a scene check that follows what is edited."""

from __future__ import annotations

import time

import bpy
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured_materials.addon.scene_check.findings import NOTE, WRONG, Finding
from measured_materials.addon.ui.panels import live_check
from measured_materials.addon.ui.panels.check_scene import draw_status
from measured_materials.addon.ui.panels.places import in_both_places
from measured_materials.addon.ui.panels.wrapped_text import Lines, wrapped
from test_addon import Recorder, Stage, known_bakes, lacquer, registered  # noqa: F401


@given(st.text(st.characters(blacklist_categories=["Cs"]), max_size=80), st.integers(3, 30))
def test_no_line_is_wider_than_its_room_and_no_letter_is_lost(text: str, width: int) -> None:
    lines = wrapped(text, width, len)
    assert all(len(line) <= width for line in lines)
    assert "".join("".join(lines).split()) == "".join(wrapped(text, 10**6, len)[0].split())


def test_lines_break_at_spaces_where_there_are_some() -> None:
    assert wrapped("one two three", 7, len) == ["one two", "three"]
    assert wrapped("a/very/long/name.exr is gone", 10, len) == ["a/very/lon", "g/name.exr", "is gone"]
    assert wrapped("", 9, len) == [""]


def test_a_panel_stands_in_both_places() -> None:
    class Panel:
        """What both show."""

        bl_label = "x"

    first, second = in_both_places(Panel, "x")
    assert first.bl_parent_id == "MEASURED_MATERIALS_PT_material" and first.bl_context == "material"
    assert second.bl_parent_id == "MEASURED_MATERIALS_PT_shader" and second.bl_space_type == "NODE_EDITOR"
    assert not hasattr(in_both_places(Panel)[0], "bl_parent_id")


def test_what_is_looked_at_most_comes_first(lacquer: bpy.types.Material) -> None:  # noqa: F811
    """Blender draws panels without a heading above all others; in a sidebar of our own there are no others."""
    assert bpy.types.MEASURED_MATERIALS_PT_material.bl_options == {"HIDE_HEADER"}
    assert "HIDE_HEADER" not in getattr(bpy.types.MEASURED_MATERIALS_PT_shader, "bl_options", ())
    # The ways to import stand below Blender's own panels: they are there for every material.
    assert "HIDE_HEADER" not in getattr(bpy.types.MEASURED_MATERIALS_PT_material_import, "bl_options", ())


_PLACES_SAID = {
    "scene Scene": "Scene",
    "world World": "World",
    "scene Shot": "scene Shot",
    "material a b": "material a b",
}


def _found(*severities: str) -> list[Finding]:
    return [Finding(f"rule{i}", kind, "Scene", "on", "off", "why", None) for i, kind in enumerate(severities)]


def test_a_place_named_by_its_kind_is_said_once() -> None:
    told = {where: Finding("rule", NOTE, where, "x is on", "off", "why", None).setting for where in _PLACES_SAID}
    assert told == {where: f"{said}: x is on, should be off" for where, said in _PLACES_SAID.items()}


def test_one_slow_check_does_not_end_following_but_two_do() -> None:
    scene, follows = bpy.context.scene, []
    for seconds in (0.01, 9.0, 9.0):
        live_check.keep(scene, [], seconds)
        follows.append(live_check.follows(scene))
    live_check.loaded()
    live_check.keep(scene, [], 9.0)
    assert follows == [True, True, False] and not live_check.follows(scene)
    live_check.loaded()


def test_a_check_that_waits_for_blenders_threads_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modifiers are evaluated by others than the thread that checks, and the window stands still meanwhile."""
    monkeypatch.setattr(live_check, "check_scene", lambda _: time.sleep(1.5 * live_check._LONGEST))
    live_check.loaded()
    live_check.check_now(bpy.context.scene)
    assert not live_check.follows(bpy.context.scene)
    live_check.loaded()


def test_how_long_another_scene_took_says_nothing() -> None:
    scene, other = bpy.context.scene, bpy.data.scenes.new("other")
    follows = []
    for quick, slow in ((scene, other), (other, scene)):
        live_check.loaded()
        live_check.keep(quick, [], 0.01)
        live_check.keep(slow, [], 9.0)
        follows.append(live_check.follows(slow))
        live_check.keep(quick, [])
        follows.append(live_check.follows(quick))
    assert follows == [False, True, False, True]
    bpy.data.scenes.remove(other)
    live_check.loaded()


def test_notes_spoil_nothing() -> None:
    live_check.keep(bpy.context.scene, _found(WRONG, NOTE))
    assert live_check.shown.harmful == 1 and not live_check.shown.fixable
    live_check.loaded()
    assert live_check.shown.rows is None


def test_the_check_follows_an_edit_and_its_undoing(
    lacquer: bpy.types.Material,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the timer's own function, once the artist rests, on however slow a machine."""
    monkeypatch.setattr(live_check, "_LONGEST", 1e9)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.sample_clamp_indirect = "CYCLES", 0
    live_check.check_now(scene)
    assert live_check.is_current(scene)
    before = live_check.shown.harmful
    scene.cycles.sample_clamp_indirect = 10
    live_check.changed()
    assert not live_check.is_current(scene)
    wait = live_check.look_again()
    assert wait is not None and live_check.shown.harmful == before, "while edits come it waits"
    live_check.shown.edited = live_check.shown.ended = 0.0
    assert live_check.look_again() is None and live_check.is_current(scene)
    assert live_check.shown.harmful == before + 1
    scene.cycles.sample_clamp_indirect = 0
    live_check.changed()
    live_check.shown.edited = live_check.shown.ended = 0.0
    live_check.look_again()
    assert live_check.shown.harmful == before


def test_blender_tells_of_edits(lacquer: bpy.types.Material) -> None:  # noqa: F811
    live_check.check_now(bpy.context.scene)
    live_check.shown.stale = False
    bpy.context.object.location.x += 1
    bpy.context.view_layer.update()
    assert live_check.shown.stale


def test_a_long_check_waits_for_the_button(lacquer: bpy.types.Material) -> None:  # noqa: F811
    scene = bpy.context.scene
    live_check.check_now(scene)
    live_check.shown.seconds = 1.0
    live_check.changed()
    live_check.shown.edited = live_check.shown.ended = 0.0
    assert live_check.look_again() is None and live_check.shown.stale and not live_check.follows(scene)


def test_what_was_found_is_shown_until_the_button_is_pressed(lacquer: bpy.types.Material) -> None:  # noqa: F811
    stage = Stage(lacquer)
    stage.scene = bpy.context.scene
    live_check.keep(stage.scene, [Finding("x", WRONG, "Scene", "is", "0", "why", lambda: None)], 1.0)
    live_check.changed()
    texts: list[str] = []
    draw_status(Recorder(texts), stage, Lines(stage))
    operator = "measured_materials.check_scene"
    assert " ".join(texts) == f"{operator} 1 scene setting spoils measured materials {operator}"
    live_check.keep(stage.scene, [], 1.0)
    live_check.changed()
    draw_status(Recorder(texts := []), stage, Lines(stage))
    assert texts == [operator]


@pytest.fixture(autouse=True)
def forgotten() -> None:
    """Nothing of the test before."""
    live_check.loaded()
