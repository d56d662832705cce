"""One bake of a library at a time: the lock on its folder, which the system drops when its holder dies."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

from ...bake.errors import BakeError

if sys.platform != "win32":
    import fcntl

LOCK = ".library.lock"


@contextlib.contextmanager
def library_lock(out: Path, shared: bool = False) -> Iterator[None]:
    """Hold the lock of the library `out`, which is there, for the block.

    `shared`: many tasks of a farm may hold it at once, beside no other bake. Where the system or the file system knows
    no locks nothing is held: bundles still appear whole or not at all.

    Raises
    ------
    BakeError : another bake holds it, or nothing can be written there
    """
    file = out / LOCK
    try:
        if file.is_symlink():  # ours never is: it leads out of the library
            file.unlink()
        handle = os.open(file, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
    except OSError as error:
        cause = f"cannot be written ({error.strerror})"
        raise BakeError(out, cause, "choose a folder you may write to, and check the free space") from error
    try:
        _claim(handle, out, shared)
        # Of one that was killed its words are still there.
        _say(handle, "" if shared else f"process {os.getpid()} on {socket.gethostname()}\n")
        try:
            yield
        finally:
            if not shared:
                _say(handle, "")
    finally:
        os.close(handle)


def _say(handle: int, holder: str) -> None:
    """Have the lock's file name its holder."""
    with contextlib.suppress(OSError):
        os.ftruncate(handle, 0)
        os.lseek(handle, 0, os.SEEK_SET)
        os.write(handle, holder.encode())


def _claim(handle: int, out: Path, shared: bool) -> None:
    if sys.platform == "win32":
        return
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError as error:
        holder = os.read(handle, 200).decode(errors="replace").strip()
        by = holder if holder and holder.isprintable() else "another bake, or by tasks of a farm"
        remedy = "wait until that has ended, or give another --out"
        raise BakeError(out, f"is in use by {by}", remedy) from error
    except OSError:  # some network file systems know no locks
        pass
