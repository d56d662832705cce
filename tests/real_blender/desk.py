"""Bakes beside a real Blender window; see desk.sh. What is done there, and looked at, is in desk_steps.py."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from application import HERE, Blender
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl

# An interface that hangs for longer than this is felt.
LONGEST_STALL = 0.1
# Seconds from the drop to the material's first picture, and how much longer than a bake in process the final one may
# take, by the clock: an artist waits for what takes no processor time too. 1.12 is seen on a quiet machine of two
# cores, which the worker shares with its quick bake and the window; in process nothing else would go on.
SOON, LONGER = 2.0, 1.25
# Of all processors, what else may run before the walk for its clock to be judged. Blender's installation and start add
# about a fifth of one.
QUIET = 0.5
# A script that bakes waits for it; and what the walk does before it begins.
WAITS = ("in process, which waits", "start", "before", "end of others")
_START = """
import bpy
bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.smooth_view = 0
bpy.ops.wm.save_userpref()
bpy.ops.wm.save_as_mainfile(filepath="start.blend")
"""


def photographs(folder: Path) -> None:
    """A swatch of three fields, lit from six elevations."""
    folder.mkdir()
    lines = []
    fields = np.linspace(0.1, 0.6, 3).repeat(128)[None, :, None] * np.array([1.0, 0.8, 0.6])
    for elevation in (15, 30, 45, 60, 75, 90):
        light = np.radians(elevation)
        picture = np.broadcast_to(fields * np.sin(light), (256, 384, 3)).astype(np.float32)
        write_image(folder / f"{elevation}.exr", picture, Storage.HALF)
        lines.append(f"{elevation}.exr {np.cos(light):.6f} 0 {np.sin(light):.6f}")
    (folder / "a.lp").write_text("\n".join([str(len(lines)), *lines]) + "\n")


def after_quitting(share: Path) -> list[str]:
    """What a bake that ran when Blender was quit has left: files beside the measurement, and processes."""
    lying = {"lacquer.binary", "swatch", *json.loads((share / "lying.json").read_text())}
    for _ in range(50):
        left = [path.name for path in (share / "data").iterdir() if path.name not in lying]
        left += workers()
        if not left:
            break
        time.sleep(0.2)
    return left


def workers() -> list[str]:
    """Worker processes that are not of this process' own tree: whoever started them is gone."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().decode(errors="replace")
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except OSError:
            continue
        if "/share/home/" in words and "bootstrap.py" in words and parent == "1":
            found.append(f"process {folder.name}")
    return found


def too_late(found: dict[str, Any]) -> str:
    """What an artist waits for too long, by the clock; empty if nothing.

    On a machine that was busy before the walk the clock proves nothing. That is printed, and processor time judges the
    final picture; the first one it cannot, for bake and quick bake run side by side.
    """
    preview, load = found["seconds_to_preview"], found["load"]
    busy = load > QUIET * (os.cpu_count() or 1)
    where = f"on a machine with a load of {load:.1f} before the walk"
    if preview["clock"] > SOON:
        if not busy:
            return f"the first picture is there after {preview}, {where}"
        print(f"desk: not judged, {where}: the first picture is there after {preview}")
    if "final" in found:
        quickest = {
            place: {by: min(run[by] for run in runs) for by in ("clock", "processor")}
            for place, runs in found["final"].items()
        }
        longer = {by: quickest["beside"][by] > LONGER * quickest["in process"][by] for by in ("clock", "processor")}
        if longer["clock"]:
            if longer["processor"] or not busy:
                return f"a bake beside the window takes longer than in process, {where}: {quickest}"
            print(f"desk: excused by processor time, {where}: a bake beside the window and in process took {quickest}")
    return ""


def main() -> None:
    """Install, run the steps in a window, and judge what they found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("place", type=Path)
    parser.add_argument("--cancels", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--no-others", action="store_true", help="only imports of a measurement")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        (share / "data").mkdir()
        write_merl(share / "data" / "lacquer.binary", by_name("ggx", alpha=0.2, f0=(0.5, 0.3, 0.2), diffuse=0.2))
        photographs(share / "data" / "swatch")
        for name in ("desk_steps.py", "desk_others.py", "desk_times.py"):
            shutil.copy(HERE / name, share)
        (share / "start.py").write_text(_START)
        blender = Blender(options.place, share)
        print(f"desk: ok   install: {blender.install()}", flush=True)
        blender.run("--python-exit-code", "9", "--python", "start.py")
        counts = [str(options.cancels), str(options.rounds), str(int(not options.no_others))]
        script = ["--enable-event-simulate", "start.blend", "--python", "desk_steps.py", "--", *counts]
        done = blender.window(*script, timeout=3600)
        journal = (share / "journal.txt").read_text() if (share / "journal.txt").exists() else "nothing"
        print(journal)
        if done.returncode or not (share / "found.json").exists():
            sys.exit(f"desk: FAIL exit code {done.returncode}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}")
        found = json.loads((share / "found.json").read_text())
        left = after_quitting(share)
    print(json.dumps(found, indent=1))
    if left:
        sys.exit(f"desk: FAIL quitting while a bake runs left {left}")
    if words := too_late(found):
        sys.exit(f"desk: FAIL {words}")
    for phase, stall in found["stalls"].items():
        if stall["longest of ours, processor"] > LONGEST_STALL and phase not in WAITS:
            sys.exit(f"desk: FAIL the interface hung in {phase}: {stall}")


if __name__ == "__main__":
    main()
