"""A temporary copy of the repository, for tests to run in: however the bench ends, the working tree was untouched."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_LEFT_OUT = shutil.ignore_patterns(".git", ".venv*", ".*_cache", ".hypothesis", "__pycache__", "out", "build", "dist")


@dataclass
class CopiedTree:
    """A copy whose name is the package's, so that its parent folder on PYTHONPATH comes before the editable install.

    Parameters
    ----------
    folder : to hold the copy and nothing else
    """

    folder: Path
    _running: subprocess.Popen[str] | None = field(default=None, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)
    _stopped: bool = False

    def __post_init__(self) -> None:
        shutil.copytree(ROOT, self.root, ignore=_LEFT_OUT, symlinks=True)
        if (shared := ROOT.parent / "shared").is_dir():
            (self.folder / "shared").symlink_to(shared)

    @property
    def root(self) -> Path:
        """Where the package lies."""
        return self.folder / "measured_materials"

    def package(self) -> str:
        """The file that Python imports as the package, as the tests do."""
        code = "import measured_materials.bake as b; print(b.__file__)"
        return self._run([sys.executable, "-P", "-c", code], 60)[1].strip()

    def pytest(self, arguments: list[str], timeout: float) -> tuple[int | None, str]:
        """Exit status, None after the timeout, and what was printed."""
        tool = [sys.executable, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", "--no-header", "-rN"]
        return self._run([*tool, *arguments], timeout)

    def stop(self) -> None:
        """End what runs, and let nothing start again."""
        with self._lock:
            self._stopped = True
            if self._running is not None:
                _kill(self._running)

    def _run(self, command: list[str], timeout: float) -> tuple[int | None, str]:
        # A source that changes twice within a second keeps its time stamp, and Python would take the old byte code.
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1"}
        with self._lock:
            if self._stopped:
                raise KeyboardInterrupt
            self._running = subprocess.Popen(
                command,
                cwd=self.root,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
        status: int | None = None
        try:
            text = self._running.communicate(timeout=timeout)[0]
            status = self._running.returncode
        except subprocess.TimeoutExpired:
            _kill(self._running)
            text = self._running.communicate()[0]
        if self._stopped:
            raise KeyboardInterrupt
        return status, text


def _kill(process: subprocess.Popen[str]) -> None:
    """With all that it has started; it leads a session of its own."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
