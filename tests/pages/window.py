"""Pictures of a real Blender at work: the panel on an imported material, the scene check, the asset browser."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from commands import commands_of, run, save
from PIL import Image

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "real_blender"))
from application import Blender  # noqa: E402

_SIZE = (1280, 800)
_WIDEST = 900
_START = """
import bpy
view = bpy.context.preferences.view
view.show_splash, view.smooth_view = False, 0
bpy.ops.wm.save_userpref()
bpy.ops.wm.save_as_mainfile(filepath="start.blend")
"""


def make(out: Path, folder: Path, place: Path) -> None:
    """Install the extension, run `window_steps.py` in a window, and cut what it has taken."""
    folder.chmod(0o755)
    gold = commands_of("gallery.md")[0]
    if not (folder / "gold.mmat").exists():
        run([*gold[: gold.index("#")], "--resolution", "48"], folder / "gold.mmat")
    shutil.copy(HERE / "window_steps.py", folder)
    (folder / "start.py").write_text(_START)
    blender = Blender(place, folder)
    print(f"  {blender.install()}")
    blender.run("--python-exit-code", "9", "--python", "start.py")
    done = blender.window("start.blend", "--python", "window_steps.py", timeout=900, size=_SIZE)
    if not (folder / "taken.json").exists():
        raise SystemExit(
            f"docs: no pictures, exit code {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-3000:]}"
        )
    for name, (x, y, width, height) in json.loads((folder / "taken.json").read_text()).items():
        whole = Image.open(folder / f"{name}.png")
        top = whole.height - y - height
        save(whole.crop((x, top, x + width, top + height)), out / f"{name}.jpg", _WIDEST)
