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

from measured_materials.addon.library.lock import LOCK
from measured_materials.bake.bundle.bundle import MATERIAL, read_bundle
from measured_materials.bake.errors import BakeError

from support.clusters import command, wait_until
from support.stacks import write_stack

NAMES = tuple(f"cloth{k}" for k in range(6))
"""Swatches of a library: photographs of a few texels, which are baked in a tenth of a second. The first is there."""
OLDER = NAMES[0]
_PATIENCE = 120.0
# Until a kill has met somebody alive.
_ATTEMPTS = 5


@dataclass
class Damage:
    """Faults that did happen, bundles that are gone or not whole, and files outside the library that were touched."""

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
    return [path.name for path in library.iterdir() if path.name.startswith(".") and path.name != LOCK]


def killed(folder: Path, draw: random.Random, whom: str) -> Damage:
    """Kill -9 at a random moment: "client", one "worker", or "all" at once as by a power cut.

    Done again, in another folder, until it has met living ones: `tried` is 0 where it never has.
    """
    found = Damage()
    for attempt in range(_ATTEMPTS):
        found += _killed_once(folder / str(attempt), draw, whom)
        if found.tried:
            break
    return found


def _killed_once(folder: Path, draw: random.Random, whom: str) -> Damage:
    scene = Scene(folder)
    process = subprocess.Popen(
        scene.command("--jobs", "2"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    ended = draw.randrange(len(NAMES) - 1)
    wait_until(
        lambda: process.poll() is not None or (_baked(scene) >= ended and bool(children(process.pid))), _PATIENCE, 0.002
    )
    time.sleep(draw.uniform(0, 0.3))
    workers = children(process.pid)
    chosen = {"client": [process.pid], "worker": workers[:1], "all": [process.pid, *workers]}[whom]
    met = kill(*chosen)
    process.wait(_PATIENCE)
    until = time.monotonic() + _PATIENCE
    while any(is_alive(pid) for pid in workers):
        assert time.monotonic() < until, "workers outlive what they work for"
        time.sleep(0.05)
    found = scene.damage()
    found.tried = int(workers != [] and met == len(chosen))
    return found + scene.repaired()


def _baked(scene: Scene) -> int:
    """Bundles that are there beside the older one."""
    return sum(map(scene.has, NAMES[1:]))


def disk_full(folder: Path, limit: int) -> Damage:
    """No file may grow beyond so many bytes (RLIMIT_FSIZE): as on a full disk, writing fails in the middle."""
    import resource

    scene = Scene(folder)
    done = scene.run(
        *scene.command("--jobs", "1"), preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    )
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
    return scene.damage() + scene.repaired()


def task_where_files_cannot_grow(folder: Path, limit: int) -> tuple[int, str]:
    """The exit code and the words of a farm's task under such a limit."""
    import resource

    words = command("bake", "library", write_stack(folder / "cloth"), "--out", folder, "--task", "--exit-zero")
    done = subprocess.run(
        words,
        capture_output=True,
        text=True,
        timeout=_PATIENCE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    return done.returncode, done.stderr


def raced(folder: Path) -> Damage:
    """Two bakes of the library and one of a bundle in it at once: one library waits for no other and says so.

    The first holds still with its lock until the others have ended; its worker goes on.
    """
    scene = Scene(folder)
    lock = scene.library / LOCK
    single = command("bake", "photographs", folder / "swatches" / NAMES[1], "--out", scene.library)
    first = subprocess.Popen(scene.command("--jobs", "1"), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: lock.is_file() and f"process {first.pid} on" in lock.read_text(), _PATIENCE, 0.002)
    try:
        assert _is_stopped(first.pid), "the first bake has ended before the others began"
        other = subprocess.Popen(single, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        second = scene.run(*scene.command("--jobs", "1"))
        told = other.communicate(timeout=_PATIENCE)[1]
    finally:
        first.send_signal(signal.SIGCONT)
    assert second.returncode == 1 and f"is in use by process {first.pid} on" in second.stderr, second.stderr
    assert other.returncode == 0, told
    told = first.communicate(timeout=_PATIENCE)[1]
    assert first.returncode == 0, told
    return scene.damage() + scene.repaired()


def hostile(folder: Path, edit: Callable[[Path, Path], None]) -> Damage:
    """The older bundle edited by an attacker, who is given it and the folder outside, then a bake of the library.

    It may refuse that bundle, but bakes all others. The bundle is then removed, and the library baked again.
    """
    scene = Scene(folder)
    older = scene.library / f"{OLDER}.mmat"
    edit(older, scene.outside)
    done = scene.run(*scene.command("--jobs", "1"))
    assert "Traceback" not in done.stderr, done.stderr
    found = scene.damage()
    found.lost = sum(not scene.has(name) for name in NAMES[1:])
    # What nobody can read is the attacker's; what the bake has written is whole.
    found.half_written = sum(scene.has(name) and not _is_whole(scene.library / f"{name}.mmat") for name in NAMES[1:])
    if older.is_symlink():
        older.unlink()
    else:
        shutil.rmtree(older)
    return found + scene.repaired()


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
    (bundle.parent / LOCK).unlink(missing_ok=True)
    (bundle.parent / LOCK).symlink_to(outside / "diary.txt")


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
    return _state(pid) not in ("", "Z", "X")


def _state(pid: int) -> str:
    """The system's letter for what a process does; "" where there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return ""


def kill(*pids: int) -> int:
    """Kill processes at once, and return how many of them lived until then: they are stopped first, to be seen."""
    met = [pid for pid in pids if _is_stopped(pid)]
    for pid in met:
        os.kill(pid, signal.SIGKILL)
    return len(met)


def _is_stopped(pid: int) -> bool:
    """Stop a process, unless it has ended."""
    try:
        os.kill(pid, signal.SIGSTOP)
    except ProcessLookupError:
        return False
    until = time.monotonic() + _PATIENCE
    while is_alive(pid):
        if _state(pid) == "T":
            return True
        assert time.monotonic() < until, "a process does not stop"
        time.sleep(0.001)
    return False


def all_of(damages: Sequence[Damage]) -> Damage:
    """The sum."""
    return sum(damages, Damage())
