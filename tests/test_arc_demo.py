"""The demonstration of shading maps, small: what it writes and reports, what it leaves behind, and its roll."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.cli import demo
from measured_materials.addon.demo import fabric, roll
from measured_materials.addon.gantry.techniques import IN_ORDER
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from support.scenes import diffuse_material

COLLECTIONS = "scenes", "objects", "meshes", "materials", "worlds", "lights", "cameras", "collections"


def datablocks() -> dict[str, set[int]]:
    return {name: {block.session_uid for block in getattr(bpy.data, name)} for name in COLLECTIONS}


def test_demo_shows_the_geometry_beside_its_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fabric, "SHOWN", ("cloth",))
    monkeypatch.setattr(fabric, "ELEVATIONS", (8.0, 35.0, 62.0, 88.0))
    monkeypatch.setattr(fabric, "_QUICK", fabric._Effort((40, 4), (24, 4), (24, 2)))
    before, told = datablocks(), []
    found = fabric.run_arc_demo(tmp_path / "out", quick=True, progress=lambda *words: told.append(words))
    assert datablocks() == before
    stages = list(dict.fromkeys(stage for stage, _ in told))
    assert stages == [f"{word} cloth" for word in ("photographing", "baking", "comparing", "rendering")]
    assert all(0 <= share <= 1 for _, share in told)

    assert Path(found["picture"]).read_bytes().startswith(b"\x89PNG")
    assert len(list(Path(found["photographs"][0]).glob("*.exr"))) == 4
    bundle = read_bundle(Path(found["bundles"][0]))
    assert bundle.material["render"]["lobe"]["name"] == "oren_nayar" and bundle.material["map"]["a_max"] > 0
    assert len(found["rows"]) == len(fabric.CASES) * len(IN_ORDER)
    rms = {(row["case"], row["technique"]): row["rms"] for row in found["rows"]}
    between, brighter, two, other = (case.group for case in fabric.CASES)
    # What the demonstration is there to show, with wide margins: four samples of a pixel are noisy.
    assert rms[between, "lookup"] < 0.6 * rms[between, "lit_texture"]
    assert rms[between, "final_radiance"] == pytest.approx(rms[between, "lookup"], rel=1e-6)
    assert rms[brighter, "final_radiance"] > 1.5 * rms[brighter, "lookup"]
    assert rms[two, "final_radiance"] > 1.5 * rms[two, "lookup"]
    assert rms[other, "lookup"] > 2 * rms[between, "lookup"]
    assert any("lookup by r" in line for line in found["lines"])


def test_roll_is_lit_from_the_side_of_larger_u() -> None:
    before, material = datablocks(), diffuse_material(0.5)
    picture = roll.roll(material, 24, 16).mean((1, 2))
    bpy.data.materials.remove(material)
    assert datablocks() == before
    # Top to bottom across the roll: shade, then ever more light.
    assert picture[16:21].mean() > 3 * picture[4:8].mean()


def test_bent_tile_closes_to_a_roll() -> None:
    mesh = bpy.data.meshes.new("tile")
    mesh.from_pydata([(0, 0.3, 0), (1, 0.3, 0), (0.5, 0.3, 0.1)], [], [])
    roll.bend(mesh)
    first, last, raised = (np.array(vertex.co) for vertex in mesh.vertices)
    bpy.data.meshes.remove(mesh)
    # u = 1 lies an arc length of 1 further than u = 0, and height stands on the roll's surface.
    angle = math.atan2(last[0], last[2]) - math.atan2(first[0], first[2])
    radius = math.hypot(first[0], first[2])
    assert angle * radius == pytest.approx(1, rel=1e-5)
    assert angle * roll.TILES_AROUND == pytest.approx(2 * math.pi, rel=1e-5)
    assert math.hypot(raised[0], raised[2]) == pytest.approx(radius + 0.1, rel=1e-5)
    assert first[1] == last[1] == pytest.approx(0.3)


def test_command_line_chooses_the_demonstration(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    called = []
    monkeypatch.setattr(fabric, "run_arc_demo", lambda out, **options: called.append((out, options)) or {"lines": []})
    parser = argparse.ArgumentParser()
    demo.add_to(parser.add_subparsers())
    options = parser.parse_args(["demo", "--arc", "--quick", "--out", str(tmp_path)])
    result = options.run(options)
    assert called[0][0] == tmp_path and called[0][1]["quick"] and result.document["command"] == "demo"


def test_unusable_folder_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(BakeError, match="cannot be written"):
        fabric.run_arc_demo(tmp_path / "file" / "out", quick=True)
