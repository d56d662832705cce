"""Stacks from both sides of a swatch: checked together, read, and brought to one frame."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs.calibration import calibrate_by_albedo, calibrate_by_card
from measured_materials.bake.photographs.lights import find_lights
from measured_materials.bake.photographs.settings import StackSettings
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.against_light import ThroughSettings, aligned, cut_alike
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from support.stacks import write_stack

WHOLE = np.arange(12 * 10, dtype=np.float32).reshape(1, 12, 10, 1).repeat(3, -1)


def cut_off(left: int, top: int, right: int, bottom: int) -> PhotoStack:
    """A stack of 10 x 12 whose alignment took these borders."""
    images = WHOLE[:, top : 12 - bottom, left : 10 - right]
    return PhotoStack(images, ("a",), None, False, (), {"frame": {"border_cut": [left, top, right, bottom]}})


def test_both_lose_what_either_lacks() -> None:
    front, behind = cut_alike(cut_off(1, 0, 2, 0), cut_off(0, 3, 1, 1))
    expected = WHOLE[:, 3:11, 1:8]
    np.testing.assert_array_equal(front.images, expected)
    np.testing.assert_array_equal(behind.images, expected)
    for stack in (front, behind):
        assert stack.facts["frame"] == {"border_cut": [1, 3, 2, 1], "size": [7, 8]}


def test_what_was_not_cut_stays_itself() -> None:
    stacks = cut_off(0, 0, 0, 0), cut_off(0, 0, 0, 0)
    assert all(cut is stack for cut, stack in zip(cut_alike(*stacks), stacks, strict=True))


def test_another_frame_is_refused() -> None:
    other = PhotoStack(WHOLE[:, :, :8], ("a",), None, False, (), {"frame": {"border_cut": [0, 0, 1, 0]}})
    with pytest.raises(BakeError, match="10 x 12 and 9 x 12"):
        cut_alike(cut_off(0, 0, 0, 0), other)


# --- the camera between the two ---------------------------------------------------------------------------

MOVED = (3, 2)


def cloth() -> np.ndarray:
    """(96, 110) of threads that do not repeat, from 0.2 to 0.8."""
    noise = np.random.default_rng(3).normal(size=(96, 110))
    waves = np.fft.rfft2(noise) * np.exp(-40 * (np.fft.fftfreq(96)[:, None] ** 2 + np.fft.rfftfreq(110) ** 2))
    smooth = np.fft.irfft2(waves, s=noise.shape)
    return np.asarray(0.5 + 0.3 * smooth / np.abs(smooth).max())


def two_stacks(move: tuple[int, int] = MOVED) -> tuple[PhotoStack, PhotoStack]:
    """Cloth whose bright threads are dark against the light, which then lies so many texels further right and down."""
    x, y = move
    front = cloth()[4:92, 4:106]
    behind = (1 - cloth())[4 - y : 92 - y, 4 - x : 106 - x]
    return tuple(  # type: ignore[return-value]
        PhotoStack((np.array([0.4, 1.0])[:, None, None, None] * part[..., None]).repeat(3, -1).astype(np.float32),
                   ("a", "b"), None, False, ())
        for part in (front, behind)
    )  # fmt: skip


def test_a_nudge_between_the_stacks_is_moved_back() -> None:
    front, behind = aligned(*two_stacks(), "auto")
    assert front.images.shape == behind.images.shape and min(front.images.shape[1:3]) >= 84
    np.testing.assert_allclose(front.images[1] + behind.images[1], 1, atol=0.02)
    (warning,) = behind.warnings
    assert warning.startswith("the camera moved by 3.") and warning.endswith("moved back") and not front.warnings
    assert behind.facts["alignment_to_reflection"]["displacement"] == pytest.approx(MOVED, abs=0.05)
    assert behind.facts["frame"] == front.facts["frame"]
    assert behind.facts["frame"]["size"] == [behind.images.shape[2], behind.images.shape[1]]


@pytest.mark.parametrize(("align", "move", "told"), [("warn", MOVED, 1), ("off", MOVED, 0), ("auto", (0, 0), 0)])
def test_what_is_not_to_be_moved_stays(align: str, move: tuple[int, int], told: int) -> None:
    stacks = two_stacks(move)
    found = aligned(*stacks, align)
    assert all(np.array_equal(a.images, b.images) for a, b in zip(found, stacks, strict=True))
    assert len(found[1].warnings) == told and all("not corrected" in words for words in found[1].warnings)


def test_what_shows_nothing_is_not_moved() -> None:
    even = PhotoStack(np.full((2, 80, 80, 3), 0.5, np.float32), ("a", "b"), None, False, ())
    front, behind = aligned(even, even, "auto")
    assert front is even and behind.facts["alignment_to_reflection"]["displacement"] is None and not behind.warnings


# --- before a pixel is read -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"source": Path("gone")}, "gone: is neither here nor in .*; give the path of photographs against the light"),
        ({"source": Path("not") / "felt"}, "not/felt: does not exist; give the path"),
        ({"diffuser": (0, 0, 30, 5)}, "the diffuser reaches to x 30"),
        ({"lights": Path("dirs.lp")}, "dirs.lp: is neither here nor in .*; give the path of their lights"),
    ],
)
def test_what_is_wrong_is_told_before_anything_is_read(tmp_path: Path, options: dict[str, Any], says: str) -> None:
    front, behind = write_stack(tmp_path / "felt"), write_stack(tmp_path / "behind")
    seen: list[tuple[str, float]] = []
    settings = ArcSettings(through=ThroughSettings(**{"source": behind, **options}))
    with pytest.raises(BakeError, match=says):
        bake_arc(front, tmp_path / "x.mmat", settings, lambda *told: seen.append(told))
    assert set(seen) <= {("reading", 0.0)}


def test_a_diffuser_is_called_by_its_name() -> None:
    with pytest.raises(BakeError, match="width of diffuser is -5"):
        ArcSettings(through=ThroughSettings(Path("behind"), diffuser=(0, 0, -5, 5)))
    with pytest.raises(BakeError, match="both a diffuser and a transmittance"):
        StackSettings(white_card=(0, 0, 5, 5), albedo=0.5, behind=True)
    images, names = np.ones((2, 2, 2, 3), np.float32), ["white card albedo.jpg", "b.jpg"]
    told = calibrate_by_card(names, images, np.ones((2, 3)), None, 0.5, "diffuser")
    assert told["by"] == "diffuser" and "brightest in white card albedo.jpg" in str(told["how"])
    with pytest.raises(BakeError, match="shows the diffuser black"):
        calibrate_by_card(names, images, np.zeros((2, 3)), None, 0.5, "diffuser")
    assert "stated transmittance" in str(calibrate_by_albedo(images, None, 0.5, "transmittance")["how"])


def test_a_light_in_the_plane_of_the_swatch_is_on_neither_side(tmp_path: Path) -> None:
    (tmp_path / "lights.csv").write_text("file,elevation,azimuth\na.png,-30,0\nb.png,-60,0\nc.png,0,0\n")
    lights = find_lights([tmp_path / f"{name}.png" for name in "abc"], None, True, behind=True)
    assert [path.name for path in lights.paths] == ["a.png", "b.png"]
    assert lights.directions is not None and (lights.directions[:, 2] > 0).all()


# --- what a bundle keeps ----------------------------------------------------------------------------------


@pytest.mark.parametrize("rest", [{"transmittance": 0.3}, {"diffuser": (1, 2, 3, 4), "diffuser_transmittance": 0.4}])
def test_settings_come_back_with_names_alone(tmp_path: Path, rest: dict[str, Any]) -> None:
    (tmp_path / "front").mkdir()
    (tmp_path / "behind").mkdir()
    (tmp_path / "behind" / "dirs.lp").write_text("")
    given = ThroughSettings(tmp_path / "behind", tmp_path / "behind" / "dirs.lp", **rest)
    told = ThroughSettings.told(json.loads(json.dumps(given.facts())))
    assert (told.source, told.lights) == (Path("behind"), Path("dirs.lp"))
    assert told.found(tmp_path / "front") == given


def test_the_folder_one_stands_in_has_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert ThroughSettings(Path()).facts()["source"] == tmp_path.name
