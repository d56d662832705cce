"""`check FILE.blend` of a file that did not load whole: libraries, linked datablocks and images that are not there."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

# Run apart: opening a file would take the scene of every other test away.
MAKE = """
import sys
from pathlib import Path
import bpy

folder = Path(sys.argv[1])
bpy.ops.wm.read_homefile(use_empty=True)
for name in ("kept", "lost"):
    mesh = bpy.data.meshes.new(name)
    mesh.use_fake_user = True
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "library.blend"))
bpy.ops.wm.read_homefile(use_empty=True)
with bpy.data.libraries.load(str(folder / "library.blend"), link=True, relative=False) as (there, linked):
    linked.objects = ["kept", "lost"]
for obj in linked.objects:
    bpy.context.scene.collection.objects.link(obj)
world = bpy.data.worlds.new("World")
if bpy.app.version < (5, 0, 0):
    world.use_nodes = True
bpy.context.scene.world = world


def image(name, source="FILE", file=None):
    made = bpy.data.images.new(name, 4, 4)
    made.filepath_raw, made.file_format = str(folder / (file or name)), "PNG"
    for path in {"TILED": ["t.1001.png", "t.1002.png"], "SEQUENCE": ["s.0003.png"]}.get(source, [name]):
        made.save(filepath=str(folder / path))
    made.source = source
    world.node_tree.nodes.new("ShaderNodeTexEnvironment").image = made
    return made


image("sky.png")
image("packed.png").pack()
image("s", "SEQUENCE", "s.0001.png")
tiles = image("t", "TILED", "t.<UDIM>.png")
tiles.tiles.new(1002)
bpy.data.images.new("made here", 4, 4)
unused = bpy.data.images.load(str(folder / "sky.png"), check_existing=False)
unused.name, unused.use_fake_user = "unused", True
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), relative_remap=False)
bpy.ops.wm.open_mainfile(filepath=str(folder / "library.blend"))
bpy.data.objects.remove(bpy.data.objects["lost"])
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "poorer.blend"))
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("missing")
    subprocess.run([sys.executable, "-P", "-c", MAKE, str(folder)], check=True, capture_output=True, timeout=120)
    return folder


def check(folder: Path) -> tuple[int, dict[str, str], str]:
    """Exit code, the wrong things' words by rule and place, and the error stream."""
    call = [sys.executable, "-P", "-m", "measured_materials", "check", str(folder / "scene.blend"), "--json"]
    done = subprocess.run(call, capture_output=True, text=True, timeout=120)
    findings = json.loads(done.stdout)["findings"]
    ours = [line for line in done.stderr.splitlines() if line.startswith("measured_materials: ")]
    return done.returncode, {f"{f['rule']} {f['where']}": f["found"] for f in findings}, "\n".join(ours)


MISSING = {
    "library.blend": ("missing_library library library.blend", "library.blend is not there"),
    "poorer.blend": ("missing_linked library library.blend", "holds no object lost"),
    "sky.png": ("missing_image texture sky.png", "sky.png is not there"),
    "t.1002.png": ("missing_image texture t", "t.<UDIM>.png is not there"),
    "s.0003.png": ("missing_image texture s", "s.0001.png is not there"),
}


@pytest.mark.parametrize(
    "taken",
    [(), ("packed.png",), ("library.blend",), ("poorer.blend", "sky.png", "t.1002.png", "s.0003.png")],
    ids=["nothing", "a packed image's file", "a library", "its object and images"],
)
def test_what_is_missing_is_told(made: Path, tmp_path: Path, taken: tuple[str, ...]) -> None:
    """Taken away or, the library, exchanged for one that holds less."""
    places = [made / ("library.blend" if file == "poorer.blend" else file) for file in taken]
    for file, place in zip(taken, places):
        place.rename(tmp_path / file)
        if file == "poorer.blend":
            shutil.copy(made / file, place)
    try:
        code, found, error = check(made)
    finally:
        for file, place in zip(taken, places):
            (tmp_path / file).replace(place)
    expected = dict(MISSING[file] for file in taken if file in MISSING)
    assert set(found) == set(expected) and code == bool(expected)
    assert all(words in found[rule] for rule, words in expected.items())
    assert ("scene.blend: did not load whole" in error) == bool(expected) and error.count("\n") == 0
