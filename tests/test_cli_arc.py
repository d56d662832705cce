"""The command line on photographs of an arc: bake, inspect, render and plots."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.addon.summary.bake_stages import bake_stages, share_done
from measured_materials.addon.summary.shading_map_rows import level_count
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.image_io import read_image
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.sources.analytic import by_name
from support.coarse_bakes import coarse  # noqa: F401
from support.stacks import ELEVATIONS, complaints_in, warnings_in, write_frame, write_stack
from test_cli import BLOCK_BPY, command


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_stack(tmp_path_factory.mktemp("stack") / "felt")


@pytest.fixture(scope="module")
def bundle(stack: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bundle")
    assert main(["bake", "arc", str(stack), "--out", str(out)]) == 0
    return out / "felt.mmat"


# --- bake -------------------------------------------------------------------------------------------------


def test_bakes_a_folder(stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bake", "arc", str(stack), "--out", str(tmp_path / "made" / "here")]) == 0
    printed = capsys.readouterr()
    (line,) = printed.out.splitlines()
    words = (
        "felt.mmat",
        "5 photographs",
        "5 levels",
        "8 slices of 20 x 16",
        "Cycles' shaders",
        "left-out error",
        "albedo",
        " s",
    )
    assert all(word in line for word in words)
    assert "felt: reading" in printed.err and "felt: writing" in printed.err
    assert not complaints_in(printed.err)
    bundle = read_bundle(tmp_path / "made" / "here" / "felt.mmat")
    facts = bundle.material
    assert facts["kind"] == "shading_map" and facts["averages"]["elevations_deg"] == list(map(float, ELEVATIONS))
    # Frames are quantised to 8 bits before, half floats keep 11: the slices' means are even all the same.
    means = ShadingMapRecord.read(bundle).load_map().slices.mean(axis=(1, 2, 3))
    np.testing.assert_allclose(means, np.linspace(0, 1, 8), atol=1e-3)


def test_several_folders_and_a_bad_one(stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = write_stack(tmp_path / "linen", (30, 60))
    arguments = [str(stack), str(tmp_path / "absent"), str(other), "--out", str(tmp_path / "out"), "--json"]
    assert main(["bake", "arc", *arguments]) == 1
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert [Path(each["path"]).name for each in found["bundles"]] == ["felt.mmat", "linen.mmat"]
    assert [error["cause"] for error in found["errors"]] == ["does not exist"]
    assert len(complaints_in(printed.err)) == 1 and "1/3 felt" in printed.err


def test_files_are_one_stack(stack: Path, tmp_path: Path) -> None:
    files = sorted(map(str, stack.iterdir()))
    assert main(["bake", "arc", *files[:3], "--out", str(tmp_path)]) == 0
    assert len(read_bundle(tmp_path / "felt.mmat").material["averages"]["before"]) == 3
    assert main(["bake", "arc", *files[2:], "--out", str(tmp_path / "mine.mmat")]) == 0
    assert read_bundle(tmp_path / "mine.mmat").material["source"]["name"] == "mine"


def test_settings_reach_the_bundle(stack: Path, tmp_path: Path) -> None:
    lights = tmp_path / "lamp.csv"
    lights.write_text("file,elevation,azimuth\n" + "".join(f"el{e:02d}.png,{e - 1},90\n" for e in ELEVATIONS))
    write_frame(tmp_path / "flat.png", np.full((16, 20, 3), 0.5))
    options = (
        "--slices 5 --size 10 --decode gamma:2 --azimuth 90 --spread 5 --sides both --crop 2,2,16,12 "
        "--white-card 0,0,2,2 --white-reflectance 0.8 --align off --storage float32 --compression basis "
        "--rank 3 --tileable off --lobe phong exponent=20 diffuse=0.4 --sigma 0.6 --above scale "
        "--technique angular --mode reference --tiling extend --a-max 0.3"
    ).split()
    paths = ["--lights", str(lights), "--flat-field", str(tmp_path / "flat.png")]
    assert main(["bake", "arc", str(stack), "--out", str(tmp_path), *paths, *options]) == 0
    facts = read_bundle(tmp_path / "felt.mmat").material
    settings = facts["settings"]
    assert settings.items() >= {"slices": 5, "storage": "float32", "compression": "basis", "rank": 3}.items()
    assert settings["stack"] == {
        "size": 10, "decode": "gamma:2", "lights": "lamp.csv", "azimuth": 90, "spread": 5, "sides": "both",
        "crop": [2, 2, 16, 12], "corners": None, "flat_field": "flat.png", "white_card": [0, 0, 2, 2],
        "white_reflectance": 0.8, "albedo": None, "align": "off",
    }  # fmt: skip
    assert facts["render"] == {
        "lobe": {"name": "phong", "exponent": 20, "diffuse": 0.4}, "sigma": 0.6, "above": "scale",
        "technique": "angular", "mode": "reference", "tiling": "extend", "a_max": 0.3,
    }  # fmt: skip
    assert facts["averages"]["elevations_deg"] == [e - 1 for e in ELEVATIONS]
    assert (facts["map"]["model"], facts["map"]["width"]) == ("basis", 10)


def test_corners_albedo_and_usual_size(stack: Path, tmp_path: Path) -> None:
    corners = "--corners 1,1 18,1 18,14 1,14 --albedo 0.4".split()
    assert main(["bake", "arc", str(stack), "--out", str(tmp_path), *corners]) == 0
    facts = read_bundle(tmp_path / "felt.mmat").material
    assert facts["settings"]["stack"]["corners"] == [[1, 1], [18, 1], [18, 14], [1, 14]]
    assert facts["settings"]["stack"]["size"] == 1024 and facts["map"]["a_max"] > 0
    assert main(["bake", "arc", str(stack), "--out", str(tmp_path), "--size", "0"]) == 0
    assert read_bundle(tmp_path / "felt.mmat").material["settings"]["stack"]["size"] is None


def test_lobes_fitted_and_measured(stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bake", "arc", str(stack), "--out", str(tmp_path / "auto.mmat"), "--lobe", "auto"]) == 0
    facts = read_bundle(tmp_path / "auto.mmat").material
    assert facts["render"]["lobe"] == facts["lobe_fit"]["lobe"]
    bake_source(
        by_name("ggx", alpha=0.5), tmp_path / "ggx.mmat", BakeSettings(resolution=8, alpha=(0.5, 0.5), envelope=False)
    )
    measured = ["--lobe", str(tmp_path / "ggx.mmat")]
    assert main(["bake", "arc", str(stack), "--out", str(tmp_path / "both.mmat"), *measured]) == 0
    both = read_bundle(tmp_path / "both.mmat")
    assert both.has("table") and both.has("sampler") and both.material["render"]["lobe"] is None
    capsys.readouterr()
    measured = ["--lobe", str(tmp_path / "auto.mmat")]
    assert main(["bake", "arc", str(stack), "--out", str(tmp_path / "none.mmat"), *measured]) == 1
    assert "is not the bundle of a BRDF" in capsys.readouterr().err and not (tmp_path / "none.mmat").exists()


def test_tileable(tmp_path: Path) -> None:
    write_stack(tmp_path / "weave", size=(48, 40))
    assert main(["bake", "arc", str(tmp_path / "weave"), "--out", str(tmp_path), "--tileable", "offset"]) == 0
    assert read_bundle(tmp_path / "weave.mmat").material["tiling"]["method"] == "offset"


def test_warnings_go_to_the_error_stream(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_stack(tmp_path / "felt")
    (folder / "notes.docx").write_bytes(b"none")
    assert main(["bake", "arc", str(folder), "--out", str(tmp_path), "--json", "--sigma", "2"]) == 0
    printed = capsys.readouterr()
    skipped, albedo = warnings_in(printed.err)
    assert "felt: skipped" in skipped and "notes.docx" in skipped
    assert "more light leaves than arrives" in albedo and "--sigma" in albedo
    assert json.loads(printed.out)["bundles"][0]["warnings"] == [skipped.split("felt: ", 1)[1]]
    assert main(["bake", "arc", str(folder), "--out", str(tmp_path), "--sigma", "0.5"]) == 0
    assert len(warnings_in(capsys.readouterr().err)) == 1


@pytest.mark.parametrize("compression", ["none", "power"])
def test_every_stage_has_its_time(compression: str, stack: Path, tmp_path: Path) -> None:
    settings = ArcSettings(compression=compression)
    stages = bake_stages(settings)
    told: list[tuple[str, float]] = []
    bake_arc(stack, tmp_path / "felt", settings, lambda stage, share: told.append((stage, share)))
    assert {stage for stage, _ in told} == {stage for stage, seconds in stages.items() if seconds}
    assert share_done(stages, *told[0]) == 0 and share_done(stages, *told[-1]) == pytest.approx(1)


def test_levels_are_those_of_the_linearisation() -> None:
    assert level_count([0.5, 0.1, 0.1, 0.500001]) == 2 and level_count([1.0]) == 1 and level_count([0.1, 0.2, 0.3]) == 3


# --- plot -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", ["none", "power", "basis"])
def test_plot(compression: str, stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    plot = tmp_path / "plots" / "felt.png"
    options = ["--out", str(tmp_path), "--plot", str(plot), "--compression", compression]
    assert main(["bake", "arc", str(stack), *options]) == 0
    assert str(plot) in capsys.readouterr().out.splitlines()
    picture = read_image(plot)
    assert picture.shape[1] > 800 and picture.std() > 0.05
    assert [path.name for path in plot.parent.iterdir()] == ["felt.png"]


def test_plot_that_cannot_be_written_is_told(stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    (tmp_path / "file").write_text("")
    options = ["--out", str(tmp_path), "--plot", str(tmp_path / "file" / "felt.png")]
    assert main(["bake", "arc", str(stack), *options]) == 1
    printed = capsys.readouterr()
    assert "cannot be written" in complaints_in(printed.err)[0] and "felt.mmat" in printed.out


def test_plot_without_matplotlib_names_the_remedy(stack: Path, tmp_path: Path) -> None:
    blocked = "import sys; sys.modules['matplotlib'] = None"
    done = command("bake", "arc", stack, "--plot", "felt.png", before=blocked, cwd=tmp_path)
    assert done.returncode == 1 and not list(tmp_path.iterdir())
    (line,) = complaints_in(done.stderr)
    assert "pip install matplotlib" in line


# --- inspect ----------------------------------------------------------------------------------------------


def test_inspect_bundle(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(bundle)]) == 0
    text = capsys.readouterr().out
    for word in (
        "felt", "5 lights, 5 levels", "15° to 90°", "file names", "8 slices of 20 x 16", "slices, half", "lambert",
        "0.5, by default", "Cycles' shaders", "Mirror part", "Left-out error", "Storage RMS", "Albedo", "Image slices",
        "while rendering", "Calibration", "srgb",
    ):  # fmt: skip
        assert word in text
    assert main(["inspect", str(bundle / "material.json"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["sizes"]["slices"]["file_bytes"] == (bundle / found["images"]["slices"]["file"]).stat().st_size
    assert found["map"]["slices"] == 8


@pytest.mark.parametrize(
    "change",
    [
        lambda facts: facts.pop("map"),
        lambda facts: facts.pop("render"),
        lambda facts: facts.pop("averages"),
        lambda facts: facts.update(errors={}),
        lambda facts: facts["map"].update(model="spline"),
        lambda facts: facts["map"].update(envelope_energy="half"),
        lambda facts: facts["render"].update(lobe={"name": "velvet"}),
        lambda facts: facts["averages"].update(before=[]),
        lambda facts: facts["albedo"].pop("sigma"),
        lambda facts: facts.update(tiling={"seams": 1}),
        lambda facts: facts.update(lobe_fit={"lobe": 3}),
    ],
)
def test_inspect_damaged_bundle_is_one_line(
    change: Callable[[Any], Any], bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = tmp_path / "damaged.mmat"
    damaged.mkdir()
    for file in bundle.iterdir():
        (damaged / file.name).write_bytes(file.read_bytes())
    facts = json.loads((damaged / "material.json").read_text())
    change(facts)
    (damaged / "material.json").write_text(json.dumps(facts))
    assert main(["inspect", str(damaged)]) == 1
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1 and "damaged.mmat" in printed.err


@pytest.mark.parametrize(
    "change",
    [
        lambda facts: facts.update(warnings=7, lobe_fit=None, tiling=None),
        lambda facts: facts["source"].update(facts={"lights": 1, "decoding": {"used": [None, {}]}, "calibration": "x"}),
        lambda facts: facts["averages"].update(elevations_deg="steep"),
        lambda facts: facts["errors"].update(held_out_relative=None),
    ],
)
def test_inspect_bears_what_it_need_not_know(
    change: Callable[[Any], Any], bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    test = tmp_path / "odd.mmat"
    test.mkdir()
    for file in bundle.iterdir():
        (test / file.name).write_bytes(file.read_bytes())
    facts = json.loads((test / "material.json").read_text())
    change(facts)
    (test / "material.json").write_text(json.dumps(facts))
    assert main(["inspect", str(test)]) == 0
    assert not capsys.readouterr().err


def test_inspect_photographs(stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(stack.iterdir())
    assert main(["inspect", str(stack)]) == 0
    lines = capsys.readouterr().out.splitlines()
    table = lines[lines.index("") + 2 :]
    assert [line.split()[0] for line in table] == [f"el{e:02d}.png" for e in ELEVATIONS]
    assert "15.0°" in table[0] and "100.0 %" in table[-1]
    assert main(["inspect", str(stack), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["kind"] == "photographs" and found["averages"]["before"] == sorted(found["averages"]["before"])
    assert sorted(stack.iterdir()) == before


# --- render -----------------------------------------------------------------------------------------------


def test_bake_and_inspect_need_no_blender(tmp_path: Path) -> None:
    # Nor OpenImageIO, which comes with it.
    stack = write_stack(tmp_path / "photographs" / "felt", suffix=".exr")
    done = command("bake", "arc", stack, before=BLOCK_BPY, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = command("inspect", "felt.mmat", before=BLOCK_BPY, cwd=tmp_path)
    assert done.returncode == 0 and "8 slices" in done.stdout
    done = command("inspect", stack, before=BLOCK_BPY, cwd=tmp_path)
    assert done.returncode == 0 and "el15.exr" in done.stdout


def test_render(bundle: Path, tmp_path: Path) -> None:
    pytest.importorskip("bpy")
    size = ["--resolution", "32", "--samples", "4"]
    options = "--lobe ggx alpha=0.4 --sigma 0.8 --above scale --technique lit_texture --repeat 2.5".split()
    done = command("render", bundle, "--out", tmp_path / "a.png", *size, *options, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["render"]["lobe"] == {"name": "ggx", "alpha": 0.4} and found["repeat"] == 2.5
    assert (found["render"]["sigma"], found["render"]["above"]) == (0.8, "scale")
    assert min(found["mean_linear"]) > 0.05
    assert [file.name for file in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize(
    "options, word",
    [
        ("--filter trilinear", "--filter is for BRDFs"),
        ("--lobe velvet", "none of that name"),
        ("--repeat 0", "no number above 0"),
        ("--repeat nan", "no number above 0"),
        ("--sigma nan", "--sigma"),
    ],
)
def test_render_wrong_usage(options: str, word: str, bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", str(bundle), *options.split()]) == 2
    assert word in capsys.readouterr().err


def test_options_of_shading_maps_are_refused_for_brdfs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bake_source(
        by_name("lambert"), tmp_path / "white.mmat", BakeSettings(resolution=8, alpha=(0.5, 0.5), envelope=False)
    )
    for options in (["--lobe", "ggx"], ["--a-max", "1"], ["--repeat", "2"], ["--parallax", "maps"]):
        assert main(["render", str(tmp_path / "white.mmat"), *options]) == 2
        assert f"{options[0]} is for shading maps" in capsys.readouterr().err


def test_render_without_a_measured_brdf(bundle: Path, tmp_path: Path) -> None:
    pytest.importorskip("bpy")
    done = command("render", bundle, "--lobe", "measured", "--out", tmp_path / "a.png")
    assert done.returncode == 1 and "holds no measured BRDF" in done.stderr and not list(tmp_path.iterdir())
