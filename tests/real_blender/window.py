"""Seeded random edits with undo and redo in a real Blender window, then the tutorials there; see window.sh.

Each run of edits ends with all edits done, no fault said by the journal, exit code 0, and tables of the saved file that
equal those of the same file opened afresh.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from application import HERE, Blender
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl
from tutorials import repeat_tutorials

# Opened without a window: what the handlers make of a file that somebody else has saved.
_FRESH = """
import importlib, json, bpy
lamps = importlib.import_module("bl_ext.user_default.measured_materials.addon.lights.light_tables")
report = lamps.survey(bpy.context.evaluated_depsgraph_get())
found = {"table": lamps.table_of(report).tolist(), "groups": (report.slots, report.world.aimed)}
print("fresh:" + json.dumps(found))
"""
# Saved and opened, so that no undo goes back behind it: EEVEE, drawn by software, would take minutes.
_START = """
import importlib, os, bpy
bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.smooth_view = 0
bpy.context.preferences.edit.undo_steps = 64
bpy.ops.wm.save_userpref()
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.samples, scene.cycles.preview_samples = 1, 2
scene.cycles.use_denoising = False  # some builds have no denoiser
scene.render.resolution_x = scene.render.resolution_y = 16
scene.render.preview_pixel_size = "8"
bpy.ops.measured_materials.import_brdf(
    directory=os.getcwd(), files=[{"name": "lacquer.binary"}], resolution=8, alpha="given", bundles=os.getcwd()
)
bpy.ops.wm.save_as_mainfile(filepath="start0.blend")
# As versions before made it: a group without room for more lamps, exchanged when the file is opened.
group = importlib.import_module("bl_ext.user_default.measured_materials.nodes.group")
for tree in [tree for tree in bpy.data.node_groups if "measured_materials_lamps" in tree]:
    for node in [n for n in tree.nodes if n.bl_idname == "NodeGroupOutput" and not n.is_active_output]:
        tree.nodes.remove(node)
    del tree[group.SWITCHED_KEY]
    tree[group.HASH_KEY] = group.content_hash(tree)
bpy.ops.wm.save_as_mainfile(filepath="start1.blend")
"""


def prepare(share: Path) -> None:
    """What the edits import: a measurement, and the surroundings with something to aim at."""
    write_merl(share / "lacquer.binary", by_name("ggx", alpha=0.2, f0=(0.5, 0.3, 0.2), diffuse=0.2))
    sky = np.full((64, 128, 3), 0.1, np.float32)
    sky[10:13, 30:33] = 500
    write_image(share / "spot.exr", sky, Storage.FLOAT32)
    shutil.copy(HERE / "window_edits.py", share)
    (share / "fresh.py").write_text(_FRESH)
    (share / "start.py").write_text(_START)


def edits(blender: Blender, seed: int, count: int) -> str:
    """Words on what went wrong; empty if nothing did."""
    share = blender.share
    script = [f"start{seed % 2}.blend", "--python", "window_edits.py", "--", str(seed), str(count)]
    done = blender.window(*script, timeout=120 + 30 * count)
    journal = (share / "journal.txt").read_text().splitlines() if (share / "journal.txt").exists() else ["nothing"]
    if done.returncode or not any(line.startswith("ended") for line in journal):
        return "\n".join([f"exit code {done.returncode}; the last lines of the journal:", *journal[-12:]])
    kept = json.loads((share / "table.json").read_text())
    lines = blender.run("edited.blend", "--python", "fresh.py").splitlines()
    fresh = json.loads(next(line for line in lines if line.startswith("fresh:")).removeprefix("fresh:"))
    if not np.allclose(kept["table"], fresh["table"], rtol=1e-5) or kept["groups"] != fresh["groups"]:
        return f"the saved file, opened afresh, has another table:\n{kept}\n{fresh}"
    print(f"window: ok   seed {seed}: {journal[0]}; {journal[-1]}", flush=True)
    return ""


def main() -> None:
    """The edits, the tutorials, or both."""
    parser = argparse.ArgumentParser()
    parser.add_argument("place", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1], help="odd: a file of a version before")
    parser.add_argument("--count", type=int, default=200, help="edits of each seed")
    parser.add_argument("--only", choices=("edits", "tutorials"), help="without the other")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each step of the tutorials")
    options = parser.parse_args()
    if options.only != "tutorials":
        _edit(options)
    if options.only != "edits":
        repeat_tutorials(options.place, options.pictures)


def _edit(options: argparse.Namespace) -> None:
    """All seeds, to the first fault."""
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        prepare(share)
        blender = Blender(options.place, share)
        print(f"window: ok   install: {blender.install()}", flush=True)
        blender.run("--python-exit-code", "9", "--python", "start.py")
        for seed in options.seeds:
            if words := edits(blender, seed, options.count):
                sys.exit(f"window: FAIL seed {seed}: {words}")


main()
