"""Bakes beside a real Blender window; see desk.sh. What is done there, and looked at, is in desk_steps.py."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

from application import HERE, Blender
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl

# An interface that hangs for longer than this is felt.
LONGEST_STALL = 0.1
_START = """
import bpy
bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.smooth_view = 0
bpy.ops.wm.save_userpref()
bpy.ops.wm.save_as_mainfile(filepath="start.blend")
"""


def main() -> None:
    """Install, run the steps in a window, and judge what they found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("place", type=Path)
    parser.add_argument("--cancels", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        (share / "data").mkdir()
        write_merl(share / "data" / "lacquer.binary", by_name("ggx", alpha=0.2, f0=(0.5, 0.3, 0.2), diffuse=0.2))
        shutil.copy(HERE / "desk_steps.py", share)
        (share / "start.py").write_text(_START)
        blender = Blender(options.place, share)
        print(f"desk: ok   install: {blender.install()}", flush=True)
        blender.run("--python-exit-code", "9", "--python", "start.py")
        counts = [str(options.cancels), str(options.rounds)]
        script = ["--enable-event-simulate", "start.blend", "--python", "desk_steps.py", "--", *counts]
        done = blender.window(*script, timeout=1500)
        journal = (share / "journal.txt").read_text() if (share / "journal.txt").exists() else "nothing"
        print(journal)
        if done.returncode or not (share / "found.json").exists():
            sys.exit(f"desk: FAIL exit code {done.returncode}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}")
        found = json.loads((share / "found.json").read_text())
    print(json.dumps(found, indent=1))
    if found["longest_step"] > LONGEST_STALL:
        sys.exit(f"desk: FAIL the interface hung for {found['longest_step']:.2f} s")


main()
