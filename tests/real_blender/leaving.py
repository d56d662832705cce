"""Installed, disabled, enabled and uninstalled in a real Blender: what is left of the extension, and its pictures.

`python leaving.py DIR|BLENDER` runs this part of check.py alone.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from application import HERE, Blender
from measured_materials.bake.images.image_io import read_image
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl

NAME = "measured_materials"
PROGRAMS = ("common", "traces")


def verdicts(blender: Blender, share: Path) -> Iterator[tuple[str, bool, str]]:
    """What is checked, whether it is so, and words on it; the extension is gone after that."""
    told = _run(blender, share, "installed")
    yield "enabled", len(told["enabled"]) > 50, f"{len(told['enabled'])} classes, properties, handlers and menu entries"
    left = [*told["disabled"], *told["disabled again"]]
    yield "disabled and enabled twice", not left and told["enabled"] == told["enabled again"], _words(left)
    yield "what bakes took is kept for the next session", told["kept"], "in a file of the extension's own folder"
    first = _picture(blender, share, "with")
    blender.run("--command", "extension", "remove", NAME)
    told = _run(blender, share, "removed")
    files = [str(path.relative_to(share)) for path in (share / "home").rglob(f"*{NAME}*")]
    yield "uninstalled", not told["found"], _words(told["found"])
    yield "its files", not files, _words(files)
    commands = blender.run("--command", "help")
    yield "its command", NAME not in commands, "is not listed any more"
    second = _picture(blender, share, "without")
    same = bool(np.array_equal(first, second))
    yield "a .blend renders the same without the extension", same and first.max() > 0, f"mean {second.mean():.6f}"


def _run(blender: Blender, share: Path, part: str) -> dict[str, list[str]]:
    blender.run("--python-exit-code", "9", "--python", "traces.py", "--", part)
    found: dict[str, list[str]] = json.loads((share / f"{part}.json").read_text())
    return found


def _picture(blender: Blender, share: Path, name: str) -> np.ndarray:
    blender.run("kept.blend", "--render-output", f"//{name}_####", "--render-frame", "1")
    return read_image(share / f"{name}_0001.exr")[..., :3]


def _words(left: list[str]) -> str:
    return f"left: {', '.join(left[:5])}" if left else "nothing is left"


def main(place: Path) -> None:
    """This part alone."""
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        write_merl(share / "lacquer.binary", by_name("ggx", alpha=0.2, f0=(0.5, 0.3, 0.2), diffuse=0.2))
        for program in PROGRAMS:
            shutil.copy(HERE / f"{program}.py", share)
        blender = Blender(place, share)
        print(f"leaving: {blender.install()}", flush=True)
        bad = False
        for name, good, words in verdicts(blender, share):
            print(f"leaving: {'ok  ' if good else 'FAIL'} {name}: {words}", flush=True)
            bad |= not good
    sys.exit(int(bad))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
