"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

if sys.platform != "win32":
    import fcntl

_ABANDONED_AFTER = 3600.0  # seconds, where no lock shows whether a writer still lives
_PARTIAL, _ASIDE = "partial", "old"


@contextlib.contextmanager
def replacing_file(path: Path) -> Iterator[Path]:
    """Give a temporary sibling (same suffix) to write to; it becomes `path` when the block succeeds.

    Whatever leaves the block by an exception, KeyboardInterrupt included, leaves an older file untouched
    and no temporary one. So does a power cut: the content is on disk before it has the name. Raises OSError.
    """
    temporary = path.with_name(f".{uuid4().hex[:12]}.{_PARTIAL}{path.suffix}")
    try:
        yield temporary
        _flush_file(temporary)
        os.replace(temporary, path)
        _flush_names(path.parent)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing_folder(target: Path) -> Iterator[Path]:
    """Give an empty temporary sibling folder; it becomes `target` when the block succeeds.

    Linux and macOS swap an older folder with the new one in a single step, so that even a killed process
    leaves one of the two under the name. Elsewhere the older folder is moved aside first; `recover`, which
    runs before every read and write, puts it back should the process die between the two steps. Remains of
    killed writers of this name are removed. Raises OSError.
    """
    recover(target)
    remove_leftovers(target)
    temporary = _sibling(target, _PARTIAL)
    try:
        temporary.mkdir()
        with _claim(temporary):
            yield temporary
            _flush(temporary)
            _publish(temporary, target)
            _flush_names(target.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextlib.contextmanager
def staging_folder(target: Path) -> Iterator[Path]:
    """Give a folder beside `target` for work that may become it by `publish_folder`; gone at the end of the block.

    Should this process die before that, the next writer of `target` removes it. Raises OSError.
    """
    remove_leftovers(target)
    staging = _sibling(target, _PARTIAL)
    try:
        staging.mkdir()
        with _claim(staging):
            yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def publish_folder(whole: Path, target: Path) -> None:
    """Have a folder that lies on the same disk become `target`, in the place of an older one. Raises OSError.

    As at the end of `replacing_folder`; an older folder may be left at `whole`.
    """
    recover(target)
    _publish(whole, target)
    _flush_names(target.parent)


def recover(target: Path) -> None:
    """Put back a folder that a writer had moved aside when it was killed; nothing if `target` exists."""
    if os.path.lexists(target):
        return
    # A link is nobody's who writes here.
    aside = [folder for folder, state in _siblings(target) if state == _ASIDE and not folder.is_symlink()]
    if aside:
        newest = max(aside, key=lambda folder: folder.stat().st_mtime)
        with contextlib.suppress(OSError):
            os.rename(newest, target)


def remove_leftovers(target: Path) -> None:
    """Remove what killed writers of `target` left beside it; folders of living writers stay. No link is followed."""
    for folder, state in _siblings(target):
        if folder.is_symlink():
            with contextlib.suppress(OSError):
                folder.unlink()
        elif state == _ASIDE or not _in_use(folder):
            shutil.rmtree(folder, ignore_errors=True)


def sweep(folder: Path, *suffixes: str) -> None:
    """Put back and remove what killed writers of anything in this folder left there; living ones stay.

    Files with one of these suffixes go too: of them it cannot be seen whether their writer lives, so nobody else may
    write such files there.
    """
    partial = re.compile(rf"\.(?:(.+)\.)?[0-9a-f]{{12}}\.(?:{_PARTIAL}|{_ASIDE})(\.\w+)?")
    targets = set()
    for name in os.listdir(folder):
        if not (match := partial.fullmatch(name)):
            continue
        if match[1] and not match[2]:
            targets.add(match[1])
        elif match[2] in suffixes and not match[1]:
            with contextlib.suppress(OSError):
                (folder / name).unlink()
    for name in targets:
        recover(folder / name)
        remove_leftovers(folder / name)


def _sibling(target: Path, state: str) -> Path:
    return target.with_name(f".{target.name}.{uuid4().hex[:12]}.{state}")


def _siblings(target: Path) -> list[tuple[Path, str]]:
    pattern = re.compile(rf"\.{re.escape(target.name)}\.[0-9a-f]{{12}}\.({_PARTIAL}|{_ASIDE})")
    try:
        names = os.listdir(target.parent)
    except FileNotFoundError:
        return []
    found = [(target.with_name(name), pattern.fullmatch(name)) for name in names]
    return [(folder, match[1]) for folder, match in found if match]


def _publish(new: Path, target: Path) -> None:
    if not os.path.lexists(target):
        os.rename(new, target)
        return
    if _exchange(new, target):
        return
    aside = _sibling(target, _ASIDE)
    try:
        os.rename(target, aside)
        os.rename(new, target)
    except BaseException:
        if not os.path.lexists(target):
            os.rename(aside, target)
        raise
    finally:
        if os.path.lexists(target):
            shutil.rmtree(aside, ignore_errors=True)


def _exchange(first: Path, second: Path) -> bool:
    """Swap two names in one step; False where the system or the file system cannot."""
    try:
        library = ctypes.CDLL(None, use_errno=True)
        names = os.fsencode(first), os.fsencode(second)
        if sys.platform == "linux":
            here, swap = -100, ctypes.c_uint(2)  # AT_FDCWD, RENAME_EXCHANGE
            return bool(library.renameat2(here, names[0], here, names[1], swap) == 0)
        if sys.platform == "darwin":
            return bool(library.renamex_np(*names, ctypes.c_uint(2)) == 0)  # RENAME_SWAP
    except (OSError, AttributeError, TypeError):  # TypeError: Windows has no CDLL(None)
        pass
    return False


@contextlib.contextmanager
def _claim(folder: Path) -> Iterator[None]:
    """Hold a lock on the folder, which the system drops when the process dies, however it dies."""
    if sys.platform == "win32":
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # some network file systems know no locks
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def _in_use(folder: Path) -> bool:
    try:
        if sys.platform == "win32":
            return time.time() - folder.stat().st_mtime < _ABANDONED_AFTER
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return False
    except BlockingIOError:
        return True
    except OSError:
        return time.time() - os.fstat(handle).st_mtime < _ABANDONED_AFTER
    finally:
        os.close(handle)


def _flush(folder: Path) -> None:
    """Have the content on disk before the name points to it, or a power cut leaves empty files."""
    for file in folder.iterdir():
        _flush_file(file)
    _flush_names(folder)


def _flush_file(file: Path) -> None:
    with open(file, "r+b") as stream:
        os.fsync(stream.fileno())


def _flush_names(folder: Path) -> None:
    if sys.platform == "win32":
        return
    with contextlib.suppress(OSError):  # some file systems cannot flush a folder
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
