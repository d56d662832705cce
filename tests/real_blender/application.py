"""A real Blender with the extension, built as users get it and installed in a home of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TOOL = Path(bpy.utils.resource_path("LOCAL")) / "scripts/addons_core/bl_pkg/cli/blender_ext.py"
# What the log says of a shader that is too large, and black.
NO_STACK = "out of SVM stack space"
_HEADLESS = 'cd "$0" && exec "$@"'
# A window that nobody sees, drawn by software. The X server chooses a display that is free.
_WINDOW = """
cd "$0"
chosen=$(mktemp)
Xvfb -displayfd 4 -screen 0 WIDTHxHEIGHTx24 +extension GLX +render -noreset -nolisten tcp 4>"$chosen" >/dev/null 2>&1 &
server=$!
trap 'kill $server; rm -f "$chosen"' EXIT
for _ in $(seq 100); do [ -s "$chosen" ] && break; sleep 0.1; done
export DISPLAY=":$(cat "$chosen")" LIBGL_ALWAYS_SOFTWARE=1 GALLIUM_DRIVER=llvmpipe
"$@"
"""


class Blender:
    """The program under test, run in the folder `share` with a home of its own there.

    Parameters
    ----------
    place : the program, or a folder with a whole Linux system and Blender in it
    """

    def __init__(self, place: Path, share: Path) -> None:
        self.share = share
        (share / "home").mkdir()
        if place.is_dir():
            self.enter = [str(HERE / "enter.sh"), str(place), str(share)]
            self.program, self.inside = "blender", "/share"
            self.variables = dict(os.environ)
        else:
            self.enter, self.program, self.inside = [], str(place.resolve()), str(share)
            self.variables = {**os.environ, "BLENDER_USER_RESOURCES": str(share / "home")}

    def install(self) -> str:
        """Build the extension and enable it; returns Blender's name and version."""
        subprocess.run(
            [sys.executable, TOOL, "build", "--source-dir", ROOT, "--output-filepath", self.share / "built.zip"],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        self.run("--command", "extension", "install-file", "-r", "user_default", "--enable", "built.zip")
        return self.run("--version").splitlines()[0]

    def run(self, *arguments: str, expect: int = 0) -> str:
        """Its output without a window, after checking the exit code and that nothing went wrong on the way."""
        done = self.headless(*arguments)
        if done.returncode != expect or "Traceback" in done.stderr or NO_STACK in done.stderr:
            sys.exit(f"check: {' '.join(arguments[:3])} gave {done.returncode}\n{done.stdout}\n{done.stderr}")
        return done.stdout

    def headless(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run it without a window, with whatever exit code."""
        return self._call(_HEADLESS, ["--quiet", "--background", *arguments], 1200)

    def window(
        self, *arguments: str, timeout: float, size: tuple[int, int] = (960, 640)
    ) -> subprocess.CompletedProcess[str]:
        """Run it in a window until it quits by itself, with whatever exit code; 124 where it did not in time."""
        try:
            width, height = map(str, size)
            script = _WINDOW.replace("WIDTH", width).replace("HEIGHT", height)
            return self._call(script, ["-p", "0", "0", width, height, *arguments], timeout)
        except subprocess.TimeoutExpired as error:
            return subprocess.CompletedProcess(error.cmd, 124, "", "")

    def _call(self, script: str, arguments: list[str], timeout: float) -> subprocess.CompletedProcess[str]:
        command = [*self.enter, "bash", "-c", script, self.inside, self.program, *arguments]
        pipe = subprocess.PIPE
        with subprocess.Popen(
            command, cwd=self.share, env=self.variables, stdout=pipe, stderr=pipe, text=True, start_new_session=True
        ) as process:
            try:
                out, err = process.communicate(timeout=timeout)
            except BaseException:  # Blender and its X server are children of children
                os.killpg(process.pid, signal.SIGKILL)
                raise
        return subprocess.CompletedProcess(command, process.returncode, out, err)
