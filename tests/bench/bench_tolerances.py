"""How much of its tolerance each numeric assertion of the suite uses: those that allow over three times what they need.

On another machine, with another BLAS or in Blender 5.0 float32 may err a little more: a factor of three is left for
that. A tolerance that is wider has its reason beside it, or is tightened.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ENOUGH = 3.0


def run(out: Path, quick: bool) -> None:
    """The quick suite, in one process; --quick takes the files that use no Blender. Writes tolerances.csv."""
    files = [file for file in sorted(TESTS.glob("test_*.py")) if not quick or is_plain(file)]
    print(f"{len(files)} files of tests; with every assertion watched")
    path = out / "tolerances.csv"
    code = watch(files, path)
    rows = [row for row in read(path) if row[1] * ENOUGH < row[2]]
    for place, achieved, allowed, words in sorted(rows, key=lambda row: -row[2] / max(row[1], 1e-300)):
        times = f"{allowed / achieved:9.3g}" if achieved else "    exact"
        print(f"{times} {achieved:9.2e} of {allowed:9.2e}  {place}  {words}")
    print(f"{len(rows)} assertions allow over {ENOUGH:g} times what was seen (tests ended with {code}); all in {path}")


def is_plain(file: Path) -> bool:
    """Whether a test says nothing of Blender: no rendering, no nodes."""
    text = file.read_text(encoding="utf-8")
    return not any(word in text for word in ("bpy", "measured_materials.nodes", "measured_materials.addon", "cards"))


def watch(files: list[Path], path: Path, *options: str) -> int:
    """Run tests with `support.tolerances`; the exit code of pytest."""
    environment = {**os.environ, "MM_TOLERANCES": str(path), "PYTHONPATH": str(TESTS)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "support.tolerances", "-m", "not slow"]
    command += ["-o", "enable_assertion_pass_hook=true", "-p", "no:cacheprovider", *options, *map(str, files)]
    return subprocess.run(command, env=environment, cwd=TESTS.parent, stdout=subprocess.DEVNULL).returncode


def read(path: Path) -> list[tuple[str, float, float, str]]:
    """Place, achieved, allowed and words of each assertion."""
    with path.open(newline="", encoding="utf-8") as stream:
        return [(r["place"], float(r["achieved"]), float(r["allowed"]), r["assertion"]) for r in csv.DictReader(stream)]
