"""An asset library made and used in a real Blender: `asset_library.py BLENDER`, by `.venv`'s Python.

Formulas are baked by `bake library` in the wheel, made an asset library by that Blender without a window, and shown in
its asset browser. There one material is dragged onto an object by the mouse. The saved file is then rendered, and so is
the same scene with the material built from its bundle: both must show the same light, and the same pixels once both
were fitted to the scene.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from application import HERE, Blender

# As on the page of the gallery.
MATERIALS = {
    "Gold": "ggx alpha=0.18 f0=1.0,0.71,0.29",
    "Car paint": "metallic-paint diffuse=0.06,0.004,0.006 flake=0.55,0.05,0.04",
    "Terracotta": "oren-nayar sigma=0.5 diffuse=0.55,0.21,0.11",
    "Satin": "ward diffuse=0.05,0.02,0.12 specular=0.16,0.12,0.22 alpha=0.12 alpha_y=0.4",
    "Ceramic": "ggx alpha=0.05 f0=0.05,0.05,0.05 diffuse=0.03,0.16,0.17",
    "Rubber": "ggx alpha=0.45 f0=0.04,0.04,0.04 diffuse=0.025,0.025,0.027",
}
DRAGGED = "Gold"
SIZE = (1280, 960)
# Of 64 x 64 pixels at 256 samples: one drawn as it was dropped, the other fitted to the lamp.
SAME_LIGHT = 0.02
_STEPS = "asset_library_steps.py"
_RENDERS = "asset_library_renders.py"
_START = """
import bpy, os
preferences = bpy.context.preferences
preferences.view.show_splash, preferences.view.smooth_view, preferences.view.ui_scale = False, 0, 1
while preferences.filepaths.asset_libraries:
    bpy.ops.preferences.asset_library_remove(index=0)
bpy.ops.preferences.asset_library_add(directory=os.path.abspath("assets"))
preferences.filepaths.asset_libraries[-1].name = "Measured"
bpy.ops.wm.save_userpref()
scene = bpy.context.scene
for obj in [obj for obj in scene.objects if obj.type == "MESH"]:
    bpy.data.objects.remove(obj)
bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=1.6)
bpy.ops.object.shade_smooth()
bpy.context.object.name = "ball"
lamp = next(obj for obj in scene.objects if obj.type == "LIGHT")
lamp.data.type, lamp.data.energy = "AREA", 900
lamp.data.size = 2.0
scene.render.engine = "CYCLES"
bpy.ops.wm.save_as_mainfile(filepath="start.blend")
"""


def bake(share: Path, resolution: int, names: list[str]) -> None:
    """The bundles, by a list that `bake library` reads."""
    lines = [f"--analytic {MATERIALS[name]} --name {shlex.quote(name)}" for name in names]
    (share / "materials.list").write_text("".join(f"{line}\n" for line in lines))
    rights = ["--author", "A. Weaver", "--license", "CC0"]
    command = ["bake", "library", "materials.list", "--out", "bundles", "--resolution", str(resolution), *rights]
    subprocess.run([sys.executable, "-P", "-m", "measured_materials", *command], cwd=share, check=True)


def show(place: Path, share: Path, resolution: int = 24, names: list[str] | None = None) -> Blender:
    """Bake, make the library, and take the steps in the window; exits with words on what went wrong.

    `share` then holds a picture of each step, and dropped.blend.
    """
    share.chmod(0o755)
    if not (share / "bundles").exists():
        bake(share, resolution, names or list(MATERIALS))
    blender = Blender(place, share)
    print(f"assets: ok   install: {blender.install()}", flush=True)
    made = blender.run("--command", "measured_materials", "assets", "bundles", "--out", "assets")
    again = blender.run("--command", "measured_materials", "assets", "bundles", "--out", "assets")
    count = len(list((share / "bundles").glob("*.mmat")))
    _check(f"assets: {count} written" in made and f"assets: {count} unchanged" in again, made + again)
    print(f"assets: ok   written: {count} assets, none of them a second time", flush=True)
    for name in ("hands.py", _STEPS, _RENDERS):
        shutil.copy(HERE / name, share)
    (share / "start.py").write_text(_START)
    blender.run("--python-exit-code", "9", "--python", "start.py")
    done = blender.window("start.blend", "--python", _STEPS, "--", DRAGGED, timeout=900, size=SIZE)
    journal = share / "journal.txt"
    told = journal.read_text() if journal.exists() else "nothing"
    print(told, flush=True)
    _check(
        not done.returncode and told.rstrip().endswith("ended"), f"exit code {done.returncode}\n{done.stderr[-2000:]}"
    )
    return blender


def compare(blender: Blender) -> None:
    """The dragged material beside one that is built from its bundle, in the same scene."""
    share = blender.share
    blender.run("dropped.blend", "--python-exit-code", "9", "--python", _RENDERS, "--", f"bundles/{DRAGGED}.mmat")
    dropped, fitted, built = (np.load(share / f"{name}.npy") for name in ("dropped", "fitted", "built"))
    lit = built.mean(-1) > 0.05
    apart = abs(dropped[lit].mean(0) / built[lit].mean(0) - 1).max()
    _check(lit.mean() > 0.1 and apart < SAME_LIGHT, f"{100 * apart:.2f} % apart, lit {100 * lit.mean():.0f} %")
    words = f"as dropped, mean light of the lit pixels {100 * apart:.2f} % from the one built from the bundle"
    print(f"assets: ok   render: {words}", flush=True)
    _check(np.array_equal(fitted, built), f"pixels differ by up to {abs(fitted - built).max():.3g}")
    print(
        f"assets: ok   render: fitted to the scene, all {fitted.size} values of the two pictures are equal", flush=True
    )


def _check(good: bool, words: str) -> None:
    if not good:
        sys.exit(f"assets: FAIL {words}")


def main() -> None:
    """All of it, in a folder that goes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("place", type=Path, help="the program, or a folder with a Linux system and Blender in it")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each step")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        try:
            compare(show(options.place, share))
        finally:
            if options.pictures is not None:
                options.pictures.mkdir(parents=True, exist_ok=True)
                for picture in share.glob("*.png"):
                    shutil.copy(picture, options.pictures)
    print(json.dumps({"assets": "all is well"}))


if __name__ == "__main__":
    main()
