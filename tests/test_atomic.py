"""A bundle's writer is interrupted everywhere; under the name stands the old bundle or the new one."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from measured_materials.bake import atomic_write
from measured_materials.bake.bundle import bundle
from measured_materials.bake.bundle.bundle import StoredImage, read_bundle, write_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images import image_io
from measured_materials.bake.images.storage import Storage

# .hdr needs no library, whose own work cannot be interrupted here anyway, and is quick.
IMAGES = {"table": StoredImage(np.ones((3, 9, 3)), Storage.RGBE)}
PREVIEW = np.zeros((2, 2, 3), np.uint8)


def write(path: Path, version: int) -> None:
    write_bundle(path, {"version": version}, IMAGES, PREVIEW)


def version_of(path: Path) -> int:
    found = read_bundle(path)
    assert found.load("table").shape == (3, 9, 3)
    return int(found.material["version"])


@pytest.fixture(params=["exchange", "two renames"])
def renaming(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Where the system swaps two folders in one step, and where it cannot."""
    if request.param == "two renames":
        monkeypatch.setattr(atomic_write, "_exchange", lambda first, second: False)
    return str(request.param)


def test_this_system_swaps_in_one_step(tmp_path: Path) -> None:
    if sys.platform not in ("linux", "darwin"):
        pytest.skip("no such call on this system")
    (tmp_path / "a").mkdir()
    (tmp_path / "b").write_text("b")
    if not atomic_write._exchange(tmp_path / "a", tmp_path / "b"):
        pytest.skip("no such call on this file system")
    assert (tmp_path / "a").read_text() == "b" and (tmp_path / "b").is_dir()
    assert not atomic_write._exchange(tmp_path / "a", tmp_path / "absent")


# --- system calls that fail -------------------------------------------------------------------------------

CALLS = [(os, "rename"), (os, "replace"), (os, "mkdir"), (os, "fsync"), ("builtins", "open")]
CLEANING_CALLS = [(os, "open"), (os, "unlink"), (os, "rmdir"), (os, "listdir")]


@contextlib.contextmanager
def failing(calls: list[Any], first: int, persistent: bool, error: BaseException) -> Iterator[list[int]]:
    """Call number `first` of these functions fails, and all later ones too if `persistent`."""
    count = [0]

    def wrap(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **options: Any) -> Any:
            count[0] += 1
            if count[0] == first or (persistent and count[0] > first):
                raise error
            return function(*arguments, **options)

        return wrapped

    with pytest.MonkeyPatch.context() as patch:
        for module, name in calls:
            target = sys.modules[module] if isinstance(module, str) else module
            patch.setattr(target, name, wrap(getattr(target, name)))
        yield count


@pytest.mark.parametrize("older", [False, True])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("breakdown", ["one call", "all from then on", "cleaning too"])
def test_any_system_call_may_fail(
    tmp_path: Path, renaming: str, older: bool, error: BaseException, breakdown: str
) -> None:
    path, calls = tmp_path / "felt.mmat", CALLS + (CLEANING_CALLS if breakdown == "cleaning too" else [])
    for first in range(1, 200):
        shutil.rmtree(path, ignore_errors=True)
        if older:
            write(path, 1)
        raised = False
        with failing(calls, first, breakdown != "one call", error) as count:
            try:
                write(path, 2)
            except (BakeError, KeyboardInterrupt) as caught:
                raised = True
                assert isinstance(error, KeyboardInterrupt) or "No space left" in str(caught)
        if count[0] < first:
            assert not raised and first > 8
            break
        if older or path.exists():
            assert version_of(path) in ((1, 2) if raised else (2,))
        if breakdown == "one call":
            assert os.listdir(tmp_path) == ([path.name] if path.exists() else [])
    else:
        raise AssertionError("the writer never came to its end")
    write(path, 3)
    assert version_of(path) == 3 and os.listdir(tmp_path) == [path.name]


# --- interruption between any two lines -------------------------------------------------------------------

FILES = {module.__file__ for module in (atomic_write, bundle, image_io)}


@contextlib.contextmanager
def interrupted_at_line(number: int) -> Iterator[list[str]]:
    """KeyboardInterrupt before the given line that the writer executes; gives the names of the functions."""
    functions: list[str] = []

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        if frame.f_code.co_filename not in FILES:
            return None
        if event == "line":
            functions.append(frame.f_code.co_name)
            if len(functions) == number:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        yield functions
    finally:
        sys.settrace(before)


# Interrupted just before it leaves a `with open`, Python closes the file later and warns of it.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_interrupted_between_any_two_lines(tmp_path: Path, renaming: str) -> None:
    path = tmp_path / "felt.mmat"
    write(path, 1)
    interruptions = 0
    for number in range(1, 2000):
        with interrupted_at_line(number) as functions, contextlib.suppress(KeyboardInterrupt):
            write(path, 2)
        assert version_of(path) in (1, 2)
        if len(functions) < number:
            break
        interruptions += 1
        if functions[-1] not in ("replacing_folder", "_claim", "_publish"):  # these do the cleaning
            assert os.listdir(tmp_path) == [path.name]
        write(path, 1)
        # Interrupted just where it lets go of its lock, this process still seems to be writing.
        assert os.listdir(tmp_path) == [path.name] or functions[-1] == "_claim"
        for folder in tmp_path.glob(".*"):
            shutil.rmtree(folder)
    assert interruptions > 100


# --- killed processes -------------------------------------------------------------------------------------

KILLED = """
import itertools, sys
from pathlib import Path
import numpy as np
from measured_materials.bake import atomic_write
from measured_materials.bake.bundle.bundle import StoredImage, write_bundle
from measured_materials.bake.images.storage import Storage
if sys.argv[2] == "two renames":
    atomic_write._exchange = lambda first, second: False
images = {"table": StoredImage(np.ones((3, 9, 3)), Storage.RGBE)}
for version in itertools.count(1):
    write_bundle(Path(sys.argv[1]), {"version": version}, images)
    if version == 1:
        print("ready", flush=True)
"""


def test_killed_writers(tmp_path: Path, renaming: str) -> None:
    path = tmp_path / "felt.mmat"
    write(path, 0)
    rng = np.random.default_rng(0)
    for _ in range(4):
        arguments = [sys.executable, "-P", "-c", KILLED, str(path), renaming]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None and process.stdout.readline() == b"ready\n"
            time.sleep(rng.uniform(0.05, 0.1))
            process.send_signal(signal.SIGKILL)
        assert version_of(path) >= 1
    write(path, 1)
    assert version_of(path) == 1 and os.listdir(tmp_path) == [path.name]


def leftovers(path: Path) -> dict[str, Path]:
    names = {"partial": f".{path.name}.{'a' * 12}.partial", "old": f".{path.name}.{'b' * 12}.old"}
    return {state: path.with_name(name) for state, name in names.items()}


def test_killed_between_two_renames_is_recovered(tmp_path: Path) -> None:
    path = tmp_path / "felt.mmat"
    for act in (lambda: version_of(path), lambda: write(path, 2)):
        write(path, 1)
        path.rename(leftovers(path)["old"])
        act()
        assert os.listdir(tmp_path) == [path.name]


def test_remains_are_cleaned_and_neighbours_are_not(tmp_path: Path) -> None:
    path = tmp_path / "felt.mmat"
    write(path, 1)
    for folder in leftovers(path).values():
        (folder / "deep").mkdir(parents=True)
    neighbours = [".felt.mmat.backup", ".felt.mmat.0123.partial", f".silk.mmat.{'a' * 12}.partial", "felt"]
    for name in neighbours:
        (tmp_path / name).mkdir()
    write(path, 2)
    assert sorted(os.listdir(tmp_path)) == sorted([path.name, *neighbours])


def test_a_living_writer_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "felt.mmat"
    with atomic_write.replacing_folder(path) as temporary:
        (temporary / "half").write_text("done")
        write(path, 1)
        assert temporary.is_dir() and version_of(path) == 1
        shutil.rmtree(path)
    assert (path / "half").read_text() == "done" and os.listdir(tmp_path) == [path.name]


# --- folders that may not be written ----------------------------------------------------------------------


@pytest.fixture
def ordinary_user() -> Iterator[Path]:
    """A folder of this test's own and, where tests run as root, the rights of nobody."""
    folder = Path(tempfile.mkdtemp())
    root = os.geteuid() == 0
    if root:
        os.chown(folder, 65534, 65534)
        os.seteuid(65534)
    yield folder
    if root:
        os.seteuid(0)
    os.chmod(folder, 0o700)
    shutil.rmtree(folder)


def test_read_only_folder(ordinary_user: Path) -> None:
    path = ordinary_user / "felt.mmat"
    write(path, 1)
    os.chmod(ordinary_user, 0o500)
    with pytest.raises(BakeError, match=re.escape(f"{path}: cannot be written (Permission denied)")):
        write(path, 2)
    assert version_of(path) == 1 and os.listdir(ordinary_user) == [path.name]
    os.chmod(path, 0)
    for act in (lambda: version_of(path), lambda: write(path, 2)):
        with pytest.raises(BakeError):
            act()
    os.chmod(path, 0o700)
    assert version_of(path) == 1
