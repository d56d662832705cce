"""Both tutorials of addon/docs repeated in a real Blender window by mouse and keys; see window.sh.

What is done there is in tutorial_measurement.py and tutorial_swatch.py, by the hands of hands.py; each step is checked
where it is done. Then the dialogue of photographs is opened at twice the size, by tutorial_dialogues.py, and all rows
of the panels are drawn, and their texts measured, by tutorial_rows.py.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from application import HERE, Blender
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl
from PIL import Image

_STEPS = ("steps", "measurement", "swatch", "dialogues", "rows")
_SCRIPTS = ("hands.py", "hands_menus.py", "row_widths.py", *(f"tutorial_{name}.py" for name in _STEPS))
# A common screen, and one on which every row of the panels has its place.
_SCREEN, _TALL = (1920, 1080), (2600, 2400)
_START = """
import bpy
preferences = bpy.context.preferences
preferences.view.show_splash, preferences.view.smooth_view = False, 0
# There is nothing that manages windows: keys would go to whichever was opened last.
preferences.view.filebrowser_display_type = preferences.view.render_display_type = "SCREEN"
preferences.view.ui_scale, preferences.system.viewport_aa = 1, "OFF"
bpy.ops.wm.save_userpref()
for area in (area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"):
    # Most of the time of a window drawn by software.
    area.spaces.active.overlay.show_overlays = area.spaces.active.show_gizmo = False
scene = bpy.context.scene
scene.cycles.samples, scene.cycles.use_denoising = 16, False  # some builds have no denoiser
scene.render.resolution_percentage = 20
bpy.ops.wm.save_as_mainfile(filepath="data/start.blend")
"""


def photographs(folder: Path) -> None:
    """A woven swatch lit from ten elevations, named by them as the tutorial says."""
    folder.mkdir()
    rows, columns = np.mgrid[0:256, 0:384]
    slope = 0.5 * np.sin(2 * np.pi * columns / 12) * (1 + 0.4 * np.sin(2 * np.pi * rows / 16))
    slope += 0.1 * np.random.default_rng(1).standard_normal(slope.shape)
    for elevation in (5, 15, 25, 35, 45, 55, 65, 75, 85, 88):
        light = np.radians(elevation)
        lit = np.clip(np.sin(light) - np.cos(light) * slope, 0, None) / np.sqrt(1 + slope**2)
        linear = np.clip(lit[..., None] * np.array([0.35, 0.5, 0.84]), 0, 1)
        curved = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        Image.fromarray(np.uint8(255 * np.clip(curved, 0, 1) + 0.5)).save(folder / f"felt_el{elevation:02d}.png")


def repeat_tutorials(place: Path, pictures: Path | None) -> None:
    """Both, then the pictures of the rows; exits with words on what went wrong.

    Parameters
    ----------
    place : as for `Blender`
    pictures : folder for a picture of each step; None for none
    """
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        (share / "data").mkdir()
        write_merl(share / "data" / "lacquer.binary", by_name("ggx", alpha=0.2, f0=(0.5, 0.3, 0.2), diffuse=0.2))
        photographs(share / "data" / "felt")
        for name in _SCRIPTS:
            shutil.copy(HERE / name, share)
        (share / "start.py").write_text(_START)
        blender = Blender(place, share)
        print(f"tutorials: ok   install: {blender.install()}", flush=True)
        blender.run("--python-exit-code", "9", "--python", "start.py")
        try:
            _walk(blender, ("tutorial_measurement", "tutorial_swatch", "tutorial_dialogues"), _SCREEN)
            _walk(blender, ("tutorial_rows",), _TALL)
        finally:
            if pictures is not None:
                pictures.mkdir(parents=True, exist_ok=True)
                for picture in share.glob("*.png"):
                    shutil.copy(picture, pictures)


def _walk(blender: Blender, parts: tuple[str, ...], size: tuple[int, int]) -> None:
    journal = blender.share / "journal.txt"
    journal.unlink(missing_ok=True)
    script = ["data/start.blend", "--python", "tutorial_steps.py", "--", *parts]
    done = blender.window(*script, timeout=3600, size=size)
    told = journal.read_text() if journal.exists() else "nothing"
    print(told, flush=True)
    if done.returncode or not told.rstrip().endswith("ended"):
        sys.exit(f"tutorials: FAIL exit code {done.returncode}\n{done.stderr[-2000:]}")
