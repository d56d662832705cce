"""`check FILE.blend`: findings line by line, fixing the file or a copy, and files that are none."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from measured_materials.addon.cli.main import main

# Run apart: opening a file would take the scene of every other test away.
MAKE = """
import sys
from pathlib import Path
import bpy
from measured_materials.addon.lights import light_tables as lamps
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.sources import analytic
from measured_materials.nodes.material import build_material

folder = Path(sys.argv[1])
scene = bpy.context.scene
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "plain.blend"))
sampler = SamplerLayout(n_o=8, n_h=8, n_phi=8)
settings = BakeSettings(resolution=8, alpha=(0.5, 0.5), sampler=sampler)
bundle = read_bundle(bake_source(analytic.Lambert(), folder / "grey.mmat", settings).path)
scene.render.engine = "CYCLES"
cube = scene.objects["Cube"]
cube.data.materials.clear()
cube.data.materials.append(build_material(bundle, lamps=lamps.lamp_image()))
lamps.keep_current(scene)
other = scene.copy()
other.name, other.use_fake_user = "Other", True
scene.cycles.blur_glossy = other.cycles.sample_clamp_indirect = 0
scene.cycles.sample_clamp_indirect = 4
other.cycles.blur_glossy = 1
lamps.pack_tables()
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
for each in bpy.data.scenes:
    each.cycles.blur_glossy = each.cycles.sample_clamp_indirect = 0
    each.render.engine = "BLENDER_WORKBENCH"
cube.active_material["measured_materials_bundle"] = "grey.mmat"
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "undecided.blend"), compress=True)
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("blends")
    subprocess.run([sys.executable, "-P", "-c", MAKE, str(folder)], check=True, capture_output=True, timeout=120)
    return folder


@pytest.fixture
def blends(made: Path, tmp_path: Path) -> Path:
    """A copy of the files that may be changed."""
    return Path(shutil.copytree(made, tmp_path / "blends"))


def command(*arguments: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """The command line as a process of its own."""
    start = [sys.executable, "-P", "-m", "measured_materials", "check"]
    return subprocess.run([*start, *map(str, arguments)], capture_output=True, text=True, timeout=120, **options)


def test_lists_mends_and_keeps_the_old_file(blends: Path) -> None:
    file = blends / "scene.blend"
    before = file.read_bytes()
    done = command("scene.blend", cwd=blends)
    assert done.returncode == 1
    wrong = [line for line in done.stdout.splitlines() if line.startswith("wrong")]
    assert done.stdout.startswith("\n".join(wrong)) and len(wrong) == 2
    assert " Scene: Clamping, Indirect Light is 4, should be 0: " in done.stdout
    assert "scene Other: Filter Glossy is 1, should be 0: " in done.stdout
    last = done.stderr.splitlines()[-1]
    assert last == ("measured_materials: scene.blend: 2 settings bias its measured materials; --fix fixes 2 of them")
    assert file.read_bytes() == before

    done = command("scene.blend", "--mend", "--json", cwd=blends)
    assert done.returncode == 0
    found = json.loads(done.stdout)
    assert found["saved"] == "scene.blend" and len(found["materials"]) == 1 and not found["errors"]
    assert {entry["rule"] for entry in found["mended"]} >= {"clamp_indirect", "filter_glossy"}
    assert {entry["severity"] for entry in found["findings"]} == {"note"}
    assert (blends / "scene.blend1").read_bytes() == before

    after = file.read_bytes()
    done = command("scene.blend", "--mend", "--json", cwd=blends)
    assert done.returncode == 0 and json.loads(done.stdout)["saved"] is None
    assert file.read_bytes() == after


def test_saves_elsewhere_and_finds_the_textures_from_there(blends: Path) -> None:
    before = (blends / "scene.blend").read_bytes()
    done = command("scene.blend", "--fix", "--out", "new/mended.blend", cwd=blends)
    assert done.returncode == 0, done.stderr
    assert "fixed scene Other: Filter Glossy is 1 -> 0" in done.stdout.splitlines()
    assert (blends / "scene.blend").read_bytes() == before and not (blends / "scene.blend1").exists()
    done = command("mended.blend", "--json", cwd=blends / "new")
    assert done.returncode == 0
    assert {entry["severity"] for entry in json.loads(done.stdout)["findings"]} == {"note"}


def test_what_only_a_person_can_decide_stays(blends: Path) -> None:
    """The file is a compressed one, besides, and its textures' folder is gone."""
    shutil.rmtree(blends / "grey.mmat")
    done = command("undecided.blend", "--mend", "--json", cwd=blends)
    assert done.returncode == 1
    found = json.loads(done.stdout)
    wrong = {entry["rule"]: entry["mendable"] for entry in found["findings"] if entry["severity"] == "wrong"}
    assert wrong == {"engine": False, "missing_texture": False}
    assert "only you can decide" in found["errors"][0]["remedy"]


def test_textures_are_found_in_the_bundle_the_material_was_built_of(blends: Path) -> None:
    shutil.rmtree(blends / "grey.mmat")
    done = command("scene.blend", "--mend", "--json", cwd=blends)
    assert done.returncode == 0
    assert "missing_texture" in {entry["rule"] for entry in json.loads(done.stdout)["mended"]}


def test_a_file_without_measured_materials_says_so(blends: Path) -> None:
    done = command("plain.blend", "--mend", cwd=blends)
    assert done.returncode == 0
    assert done.stdout == "plain.blend: shows no measured material\n"
    assert not (blends / "plain.blend1").exists()


@pytest.mark.parametrize("name, content, word", [
    ("cut.blend", b"BLENDER-v405" + b"\0" * 99, "cannot be opened (Missing DNA block)"),
    ("text.blend", b"no blend", "is not a .blend file"),
    ("gone.blend", None, "cannot be read (No such file"),
])  # fmt: skip
def test_bad_files_are_told_in_one_line(tmp_path: Path, name: str, content: bytes | None, word: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    done = command(name, "--mend", cwd=tmp_path)
    assert done.returncode == 1 and not done.stdout
    ours = [line for line in done.stderr.splitlines() if line.startswith("measured_materials: ")]
    assert len(ours) == 1 and f"{name}: {word}" in ours[0] and "Traceback" not in done.stderr


def test_a_place_that_cannot_be_written_leaves_nothing(blends: Path) -> None:
    before = sorted(blends.rglob("*"))
    done = command("scene.blend", "--mend", "--out", "plain.blend/x.blend", cwd=blends)
    assert done.returncode == 1
    assert "plain.blend/x.blend: cannot be written (" in done.stderr and "Traceback" not in done.stderr
    assert sorted(blends.rglob("*")) == before


@pytest.mark.parametrize("arguments, word", [
    ("check", "FILE.blend"),
    ("check x.blend --out y.blend", "--fix"),
    ("check x.blend --mend --out y.png", "is not a FILE.blend"),
])  # fmt: skip
def test_wrong_usage(arguments: str, word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments.split()) == 2
    assert word in capsys.readouterr().err
