"""Mitsuba in an environment of its own beside .venv, made on first use: neither the product nor the tests need it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CONSTRAINTS = ROOT / "tests" / "constraints.txt"
_FOLDER = ROOT / ".venv-mitsuba"
_TIMEOUT = 3600


def mitsuba_python() -> str:
    """The interpreter; ends the bench with one line where it cannot be had."""
    python, stamp = _FOLDER / "bin" / "python", _FOLDER / ".installed"
    wanted = CONSTRAINTS.read_text(encoding="utf-8")
    if not (stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted):
        print(f"bench mitsuba: making {_FOLDER.name} with the pinned Mitsuba, once", flush=True)
        install = [str(python), "-m", "pip", "install", "--quiet", "-c", str(CONSTRAINTS), "mitsuba", "numpy"]
        for command in ([sys.executable, "-m", "venv", "--clear", str(_FOLDER)], install):
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                sys.exit(
                    f"bench mitsuba: {' '.join(command[:4])} failed: {(done.stderr or done.stdout).strip()[-500:]}"
                )
        stamp.write_text(wanted, encoding="utf-8")
    return str(python)


def render(python: str, told: dict[str, Any]) -> list[float]:
    """Processor seconds of the jobs that `mitsuba_child.py` was given, in a fresh process.

    Raises
    ------
    ChildProcessError : the variant does not run on this machine, and why
    """
    script = Path(__file__).with_name("mitsuba_child.py")
    command = [python, "-P", str(script), json.dumps(told)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT)
    lines = [line for line in done.stdout.splitlines() if line.startswith("FOUND")]
    ended = f"its process ended with {done.returncode}; {' '.join(done.stderr.split())[:200]}"
    answer = json.loads(lines[-1].removeprefix("FOUND")) if lines else {"error": ended}
    if "error" in answer:
        raise ChildProcessError(answer["error"])
    return list(answer["seconds"])
