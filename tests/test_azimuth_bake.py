"""Folders of photographs lit from every side to bundles, and arcs as they ever were."""

from __future__ import annotations

import dataclasses
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.summary.shading_map_rows import arc_summary, map_rows, photograph_rows
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.photographs.stack import PhotoStack, StackSettings
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc, bake_stack
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from support.relief import bumps, lights, photographs
from support.stacks import write_frame, write_stack

DOME = lights((20, 50, 75), 8)
# Of the half floats that the arc of `write_stack` was baked to before there were maps over azimuth.
BEFORE = {"slices": "8c3cb9dc17282b50", "envelope": "cf3a3f6fe83e20d4"}


def write_dome(folder: Path, size: int = 24) -> np.ndarray:
    """A folder of the modelled relief under the lights of `DOME`; returns the photographs."""
    folder.mkdir()
    images = photographs(bumps(size), DOME)
    lines = [str(len(DOME))]
    for k, (image, light) in enumerate(zip(images, DOME, strict=True)):
        write_frame(folder / f"p{k:02d}.exr", image)
        lines.append(f"p{k:02d}.exr " + " ".join(f"{x:.6f}" for x in light))
    (folder / "dirs.lp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return images


def record_at(path: Path) -> ShadingMapRecord:
    return ShadingMapRecord.read(read_bundle(path))


def settings(**more: object) -> ArcSettings:
    return ArcSettings(stack=StackSettings(align="off"), **more)  # type: ignore[arg-type]


def test_a_folder_of_lights_all_around_becomes_a_map_over_azimuth(tmp_path: Path) -> None:
    images = write_dome(tmp_path / "felt")
    record = record_at(bake_arc(tmp_path / "felt", tmp_path / "felt.mmat", settings()).path)
    assert record.map.model == "azimuth" and record.document["schema"] == 7
    basis = record.load_azimuth()
    k = 11  # 50 degrees high, from 135 degrees
    curve = record.document["map"]["level_curve"]
    level = float(np.interp(DOME[k, 2], curve["cosines"], curve["levels"]))
    seen = curve["a_max"] * basis.evaluate(level, float(np.arctan2(DOME[k, 1], DOME[k, 0])))
    assert np.sqrt(np.square(seen - images[k]).mean() / np.square(images[k]).mean()) < 0.12
    rows = dict(photograph_rows(record) + map_rows(record))
    assert rows["Photographs"].startswith("25 lights") and "45°" in rows["Azimuths"]
    assert "light from every side" in rows["Texels"] and rows["Shading map"] == "24 x 24, 40 levels"
    assert "24 x 24, 40 levels" in arc_summary(record, 1.0)
    assert record.settings is not None and record.settings.azimuths == "auto"
    assert record.errors.held_out == len(DOME)


def test_an_arc_is_what_it_was_whatever_is_asked(tmp_path: Path) -> None:
    write_stack(tmp_path / "arc", suffix=".exr")
    usual, arc = (
        bake_arc(tmp_path / "arc", tmp_path / f"{word}.mmat", settings(azimuths=word)) for word in ("auto", "arc")
    )
    told = [dict(one.facts) for one in (usual, arc)]
    # What a bundle was before there was a choice says nothing of one.
    assert "azimuths" not in told[0]["settings"] and "azimuth_rank" not in told[0]["settings"]
    for facts in told:
        facts.pop("settings")
        facts.pop("recipe")
    assert told[0] == told[1] and told[0]["map"]["model"] == "slices"
    documents = [record_at(one.path).document for one in (usual, arc)]
    assert documents[0]["schema"] == 4
    for one in (usual, arc):
        files = record_at(one.path).files()
        pixels = {name: files.load(name).astype(np.float16).tobytes() for name in ("slices", "envelope")}
        assert {name: sha256(values).hexdigest()[:16] for name, values in pixels.items()} == BEFORE


def test_whoever_speaks_of_an_arc_gets_one(tmp_path: Path) -> None:
    write_dome(tmp_path / "felt")
    for k, given in enumerate(({"azimuth": 0.0}, {"sides": "both"}, {"spread": 30.0})):
        asked = dataclasses.replace(settings(), stack=StackSettings(align="off", **given))
        record = record_at(bake_arc(tmp_path / "felt", tmp_path / f"{k}.mmat", asked).path)
        assert record.map.model == "slices"
    record = record_at(bake_arc(tmp_path / "felt", tmp_path / "power.mmat", settings(compression="power")).path)
    assert record.map.model == "power"


def stack_of(images: np.ndarray, directions: np.ndarray) -> PhotoStack:
    return PhotoStack(images, tuple(f"p{k}" for k in range(len(images))), directions, True, (), {"clipped_share": []})


def test_the_rank_that_is_asked_for_and_every_azimuth_in_one_tile(tmp_path: Path) -> None:
    heights = bumps(48)[:, :40]
    stack = stack_of(photographs(heights, DOME), DOME)
    asked = settings(azimuths="all", azimuth_rank=3, tileable="offset")
    record = record_at(bake_stack(stack, tmp_path / "felt", asked).path)
    assert record.map.layout.tiles == 3
    assert record.tiling is not None and record.tiling.after < record.tiling.before
    basis = record.load_azimuth()
    assert basis.coefficients.shape[1] < 40
    # One cut for all: from two sides the seam is where the relief differs from its own other end.
    for phi in (0.0, 2.0, 4.0):
        look = basis.evaluate(0.5, phi)
        across = np.abs(look[:, 0] - look[:, -1]).mean()
        assert across < 2 * np.abs(np.diff(look, axis=1)).mean()


def test_what_cannot_be_is_refused(tmp_path: Path) -> None:
    write_stack(tmp_path / "arc", suffix=".exr")
    with pytest.raises(BakeError, match=r"azimuths all.*one plane.*more sides"):
        bake_arc(tmp_path / "arc", tmp_path / "arc.mmat", settings(azimuths="all"))
    assert not (tmp_path / "arc.mmat").exists()
    with pytest.raises(BakeError, match=r"azimuths all.*compression power exclude"):
        settings(azimuths="all", compression="power")
    for name, given in (("an azimuth", {"azimuth": 5.0}), ("a spread", {"spread": 9.0}), ("sides", {"sides": "both"})):
        with pytest.raises(BakeError, match=f"azimuths all: and {name} exclude each other; choose azimuths arc"):
            ArcSettings(azimuths="all", stack=StackSettings(**given))  # type: ignore[arg-type]
    with pytest.raises(BakeError, match=r"azimuths arc: and an azimuth rank exclude each other; choose azimuths all"):
        settings(azimuths="arc", azimuth_rank=5)
    with pytest.raises(BakeError, match=r"azimuth rank.*24.*1 to 23"):
        settings(azimuth_rank=24)
    with pytest.raises(BakeError, match=r"azimuths: cannot be some.*auto or arc or all"):
        settings(azimuths="some")
    stack = dataclasses.replace(stack_of(photographs(bumps(16), DOME), DOME), directions=None)
    with pytest.raises(BakeError, match=r"azimuths all.*directions of the lights"):
        bake_stack(stack, tmp_path / "none", settings(azimuths="all"))


def test_lights_far_apart_are_told_of(tmp_path: Path) -> None:
    few = lights((40,), 4)
    facts = bake_stack(stack_of(photographs(bumps(16), few), few), tmp_path / "a", settings(azimuths="all")).facts
    assert any("degrees apart" in text and "both their shadows" in text for text in facts["warnings"])
    facts = bake_stack(stack_of(photographs(bumps(16), DOME), DOME), tmp_path / "b", settings(azimuths="all")).facts
    assert not any("degrees apart" in text for text in facts["warnings"])
