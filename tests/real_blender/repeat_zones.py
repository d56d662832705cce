"""Lamps that a direction may meet, by a Repeat zone and unrolled: `python repeat_zones.py DIR|BLENDER`.

What a shader does for each lamp stands once in a zone or as often as there are lamps, with equal pictures. Told are the
nodes of the tree and the processor's seconds to build it, of the first sample, and of a million samples more; from
Blender 5.0 on, whose shaders have such zones, and 5.1, whose nodes have rays.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path

from application import HERE, Blender

NONE = "no Repeat zone with rays in this Blender"  # as repeat_zones_inside.py has it


def main(place: Path) -> None:
    """A line for each number of lamps; ends with 1 where the pictures differ."""
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        for name in ("common", "repeat_zones_inside"):
            shutil.copy(HERE / f"{name}.py", share)
        blender = Blender(place, share)
        print(f"repeat zones: {blender.install()}", flush=True)
        told = blender.run("--python-exit-code", "9", "--python", "repeat_zones_inside.py")
        if NONE in told:
            print(f"repeat zones: skipped: {NONE}", flush=True)
            return
        different = 0
        for count, found in json.loads((share / "zones.json").read_text(encoding="utf-8")).items():
            zone, unrolled = found["zone"], found["unrolled"]
            same = abs(zone["mean"] - unrolled["mean"]) <= 1e-5 * unrolled["mean"] and unrolled["mean"] > 0
            figures = ", ".join(
                f"{what} {zone[what]:.4g} for {unrolled[what]:.4g}" for what in ("nodes", "build", "first", "million")
            )
            print(f"repeat zones: {'ok  ' if same else 'FAIL'} {count} lamps: {figures}", flush=True)
            different += not same
    sys.exit(different > 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
