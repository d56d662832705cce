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
        if not shared:
            with contextlib.suppress(OSError):
                os.ftruncate(handle, 0)
                os.write(handle, f"process {os.getpid()} on {socket.gethostname()}\n".encode())
        yield
    finally:
        os.close(handle)


def _claim(handle: int, out: Path, shared: bool) -> None:
    if sys.platform == "win32":
        return
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError as error:
        holder = os.read(handle, 200).decode(errors="replace").strip()
        by = f" by {holder}" if holder and holder.isprintable() else ""
        remedy = "wait until that has ended, or give another --out"
        raise BakeError(out, f"is being baked to{by} already", remedy) from error
    except OSError:  # some network file systems know no locks
        pass
