"""What may befall a library while it is baked, done on purpose, and what is left of it: lost, half-written, escaped.

Each function makes a library in an empty folder, with an older bundle in it and files beside it that are nobody's
business, lets one fault happen, counts what it has spoiled, and bakes again what is missing.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from measured_materials.bake.bundle.bundle import MATERIAL, read_bundle
from measured_materials.bake.errors import BakeError

from support.clusters import command, wait_until
from support.stacks import write_stack

NAMES = tuple(f"cloth{k}" for k in range(6))
"""Swatches of a library: photographs of a few texels, which are baked in a tenth of a second. The first is there."""
OLDER = NAMES[0]
_PATIENCE = 120.0


@dataclass
class Damage:
    """Bundles that are gone, bundles that are not whole, and files outside the library that were touched."""

    tried: int = 0
    lost: int = 0
    half_written: int = 0
    escaped: int = 0

    def __add__(self, other: Damage) -> Damage:
        return Damage(*(getattr(self, name) + getattr(other, name) for name in vars(self)))


class Scene:
    """A folder with a library in it, an older bundle, and files beside it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.library, self.outside = folder, folder / "library", folder / "outside"
        self.outside.mkdir()
        (self.outside / "diary.txt").write_text("nobody's business")
        (self.outside / MATERIAL).write_text("{}")
        self.library.mkdir()
        for name in NAMES:
            write_stack(folder / "swatches" / name)
        older = write_stack(folder / "older", (20, 50, 80))
        done = self.run(*command("bake", "photographs", older, "--out", self.library / f"{OLDER}.mmat"))
        assert done.returncode == 0, done.stderr
        self._outside = contents(self.outside)

    def command(self, *more: str) -> list[str]:
        """The bake of the library, which replaces the older bundle."""
        return command("bake", "library", self.folder / "swatches", "--out", self.library, "--replace", *more)

    def run(self, *words: str, **how: Any) -> subprocess.CompletedProcess[str]:
        """Run to the end."""
        return subprocess.run(words, capture_output=True, text=True, timeout=_PATIENCE, **how)

    def has(self, name: str) -> bool:
        """Whether the library has this bundle."""
        return (self.library / f"{name}.mmat" / MATERIAL).is_file()

    def damage(self) -> Damage:
        """Of one fault: before anything is baked again."""
        found = Damage(tried=1)
        found.lost = int(not self.has(OLDER))
        for bundle in self.library.glob("*.mmat"):
            try:
                read_bundle(bundle).check()
            except BakeError:
                found.half_written += 1
        found.escaped = int(contents(self.outside) != self._outside)
        return found

    def repaired(self) -> Damage:
        """Bake again, and count what is then still missing or left over."""
        done = self.run(*self.command("--jobs", "1"))
        found = self.damage()
        found.tried = 0
        found.lost += sum(not self.has(name) for name in NAMES) + (done.returncode != 0)
        found.half_written += len(leftovers(self.library))
        return found


def contents(folder: Path) -> dict[str, str]:
    """Names and hashes of all that lies in a folder; links as where they point."""
    return {
        str(path.relative_to(folder)): os.readlink(path)
        if path.is_symlink()
        else hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else "folder"
        for path in sorted(folder.rglob("*"))
    }


def marks(library: Path) -> dict[str, tuple[int, int]]:
    """Of each bundle there the inode and the time of its document, both of which change when it is baked again."""
    told = {file.parent.stem: file.stat() for file in library.glob(f"*.mmat/{MATERIAL}")}
    return {name: (found.st_ino, found.st_mtime_ns) for name, found in told.items()}


def leftovers(library: Path) -> list[str]:
    """What an interrupted bake has left beside the bundles."""
    return [path.name for path in library.iterdir() if path.name.startswith(".") and path.name != ".library.lock"]


def killed(folder: Path, draw: random.Random, whom: str) -> Damage:
    """Kill -9 at a random moment: "client", one "worker", or "all" at once as by a power cut."""
    scene = Scene(folder)
    process = subprocess.Popen(
        scene.command("--jobs", "2"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    ended = draw.randrange(len(NAMES))
    wait_until(lambda: _baked(scene) >= ended and children(process.pid), _PATIENCE, 0.002)
    time.sleep(draw.uniform(0, 0.3))
    workers = children(process.pid)
    chosen = {"client": [process.pid], "worker": workers[:1], "all": [process.pid, *workers]}[whom]
    for pid in chosen:
        kill(pid)
    process.wait(_PATIENCE)
    until = time.monotonic() + _PATIENCE
    while any(is_alive(pid) for pid in workers):
        assert time.monotonic() < until, "workers outlive what they work for"
        time.sleep(0.05)
    return scene.damage() + scene.repaired()


def _baked(scene: Scene) -> int:
    """Bundles that are there beside the older one."""
    return sum(map(scene.has, NAMES[1:]))


def disk_full(folder: Path, limit: int) -> Damage:
    """No file may grow beyond so many bytes, as on a disk that is full."""
    import resource

    scene = Scene(folder)
    done = scene.run(
        *scene.command("--jobs", "1"), preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    )
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
    return scene.damage() + scene.repaired()


def raced(folder: Path) -> Damage:
    """Two bakes of the library and one of a bundle in it at once: one library waits for no other and says so."""
    scene = Scene(folder)
    single = command("bake", "photographs", folder / "swatches" / NAMES[1], "--out", scene.library)
    both = [scene.command("--jobs", "1"), scene.command("--jobs", "1"), single]
    running = [subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for words in both]
    told = [process.communicate(timeout=_PATIENCE)[1] for process in running]
    codes = [process.returncode for process in running]
    assert sorted(codes[:2]) in ([0, 1], [0, 0]) and codes[2] == 0, told
    return scene.damage() + scene.repaired()


def hostile(folder: Path, edit: Callable[[Path, Path], None]) -> Damage:
    """The older bundle edited by an attacker, given it and the folder outside, then replaced by a bake."""
    scene = Scene(folder)
    edit(scene.library / f"{OLDER}.mmat", scene.outside)
    done = scene.run(*scene.command("--jobs", "1"))
    assert "Traceback" not in done.stderr, done.stderr
    found = scene.damage()
    found.lost = sum(not scene.has(name) for name in NAMES[1:])
    # What nobody can read is the attacker's; what the bake has written is whole.
    found.half_written = sum(scene.has(name) and not _is_whole(scene.library / f"{name}.mmat") for name in NAMES[1:])
    return found


def _is_whole(bundle: Path) -> bool:
    try:
        read_bundle(bundle).check()
    except BakeError:
        return False
    return True


def _document(bundle: Path, change: Callable[[dict[str, Any]], None]) -> None:
    document = json.loads((bundle / MATERIAL).read_text())
    change(document)
    (bundle / MATERIAL).write_text(json.dumps(document))


def _image(bundle: Path) -> Path:
    return next(iter(sorted(bundle.glob("*_slices.exr"))))


def _to_outside(bundle: Path, outside: Path) -> None:
    shutil.rmtree(bundle)
    bundle.symlink_to(outside, target_is_directory=True)


def _image_outside(bundle: Path, outside: Path) -> None:
    image = _image(bundle)
    shutil.move(image, outside.parent / "moved.exr")
    image.symlink_to(outside / "diary.txt")


def _named_outside(bundle: Path, outside: Path) -> None:
    _document(bundle, lambda told: told["images"]["slices"].update(file="../../outside/diary.txt"))


def _huge(bundle: Path, outside: Path) -> None:
    _document(bundle, lambda told: told["images"]["slices"].update(width=1 << 24, height=1 << 24))


def _lock_outside(bundle: Path, outside: Path) -> None:
    (bundle.parent / ".library.lock").unlink(missing_ok=True)
    (bundle.parent / ".library.lock").symlink_to(outside / "diary.txt")


def _table_outside(bundle: Path, outside: Path) -> None:
    (bundle.parent / "library.json").symlink_to(outside / "diary.txt")


def _names_outside(bundle: Path, outside: Path) -> None:
    rows = [{"identity": "0" * 32, "name": "../outside/diary"}, {"identity": 5, "name": None}, 7]
    (bundle.parent / "library.json").write_text(json.dumps({"materials": rows}))


def _remains_outside(bundle: Path, outside: Path) -> None:
    for state in ("partial", "old"):
        (bundle.parent / f".{NAMES[1]}.mmat.0123456789ab.{state}").symlink_to(outside, target_is_directory=True)


EDITS: dict[str, Callable[[Path, Path], None]] = {
    "the bundle is a link to a folder outside": _to_outside,
    "an image is a link to a file outside": _image_outside,
    "an image is named by a path outside": _named_outside,
    "an image is said to be huge": _huge,
    "the lock is a link to a file outside": _lock_outside,
    "the table is a link to a file outside": _table_outside,
    "the table names paths outside": _names_outside,
    "remains of a bake are links to a folder outside": _remains_outside,
}


def children(pid: int) -> list[int]:
    """Processes that this one has started."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(entry.read_text().rpartition(")")[2].split()[1]) == pid:
                found.append(int(entry.parent.name))
        except (OSError, ValueError, IndexError):
            continue
    return found


def is_alive(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def kill(pid: int) -> None:
    """Kill a process that may have ended."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def all_of(damages: Sequence[Damage]) -> Damage:
    """The sum."""
    return sum(damages, Damage())
