"""Ctrl-C on the command line, also while Blender renders and lets no Python run."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator

from .result import complain

INTERRUPTED = 130
_PATIENCE = 2.0  # seconds in which Python itself has ended what it does


def told() -> None:
    """Say that the work was interrupted."""
    complain("interrupted; nothing was left half-made")


@contextlib.contextmanager
def keyboard_interrupts() -> Iterator[None]:
    """Have Ctrl-C raise KeyboardInterrupt, and end the process where that has no effect.

    Blender's own handler in the background does not stop Python, and a render returns to Python only when it
    is finished. What is written appears under its name when it is complete, so that the process can end at
    any time; temporary folders made within the block are removed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    near, far = socket.socketpair()
    near.setblocking(False)
    ended = threading.Event()
    with near, far, _own_temporary_folder() as folder:
        handler = signal.signal(signal.SIGINT, signal.default_int_handler)
        wakeup = signal.set_wakeup_fd(near.fileno(), warn_on_full_buffer=False)
        watcher = threading.Thread(target=_watch, args=(far, ended, folder), daemon=True)
        watcher.start()
        try:
            yield
        finally:
            ended.set()
            signal.set_wakeup_fd(wakeup)
            # None: the handler was not set from Python, and cannot be set back by it.
            if handler is not None:
                signal.signal(signal.SIGINT, handler)
            with contextlib.suppress(OSError):
                near.send(b"\0")
            watcher.join()


def _watch(signals: socket.socket, ended: threading.Event, folder: str) -> None:
    """End the process when a signal has come and the main thread has not taken notice in time."""
    while not ended.is_set():
        number = signals.recv(1)
        if number == bytes([signal.SIGINT]) and not ended.wait(_PATIENCE):
            told()
            shutil.rmtree(folder, ignore_errors=True)
            bpy = sys.modules.get("bpy")
            if bpy is not None:
                shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
            os._exit(INTERRUPTED)


@contextlib.contextmanager
def _own_temporary_folder() -> Iterator[str]:
    """Have temporary files made in one folder, which goes with all that is in it."""
    before = tempfile.tempdir
    with tempfile.TemporaryDirectory(prefix="measured_materials-", ignore_cleanup_errors=True) as folder:
        tempfile.tempdir = folder
        try:
            yield folder
        finally:
            tempfile.tempdir = before
