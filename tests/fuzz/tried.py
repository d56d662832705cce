"""What became of spoiled files: kept in `tried.json`, of the most files of each format, and printed as one table."""

from __future__ import annotations

import json
import subprocess
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from support.fuzz import Tally

FILE = Path(__file__).with_name("tried.json")
ROOT = FILE.parents[2]


def kept() -> dict[str, dict[str, Any]]:
    """Fields of `support.fuzz.Tally`, commit and date, by format."""
    return dict(json.loads(FILE.read_text(encoding="utf-8"))) if FILE.is_file() else {}


def keep(name: str, tally: Tally) -> None:
    """Keep a tally unless more files of this format were tried before."""
    found = kept()
    if found.get(name, {"tried": 0})["tried"] <= tally.tried:
        found[name] = {**asdict(tally), "commit": _commit(), "date": time.strftime("%Y-%m-%d")}
        FILE.write_text(json.dumps(dict(sorted(found.items())), indent=1) + "\n", encoding="utf-8")


def _commit() -> str:
    """With a plus sign where what reads or spoils files differs from it."""

    def git(*call: str) -> str:
        return subprocess.run(["git", "-C", str(ROOT), *call], capture_output=True, text=True).stdout.strip()

    return git("describe", "--always", "--exclude=*") + "+" * bool(
        git("status", "--porcelain", "bake", "tests/support")
    )


def table() -> str:
    """One line for each format, and what all of them come to.

    A hang is a file that took more than `MOST_SECONDS` of processor, a leak a process that grows by more than
    `MOST_GROWTH`; a file that raises anything but a clean error ends its run, of which nothing is kept.
    """
    from support.fuzz import MOST_GROWTH

    head = ("", "tried", "clean errors", "read", "hangs", "leaks", "slowest, s", "peak, MiB", "growth, MiB", "commit")
    lines = ["".join(f"{word:>14s}" if k else f"{word:26s}" for k, word in enumerate(head))]
    for name, one in kept().items():
        failed = [one["hangs"], int(one["growth"] > MOST_GROWTH)]
        numbers = [one["tried"], one["tried"] - one["read"], one["read"], *failed]
        memory = [one["peak"] / 2**20, one["growth"] / 2**20]
        cells = [*map(str, numbers), f"{one['slowest']:.2f}", *(f"{value:.1f}" for value in memory), one["commit"]]
        lines.append(f"{name:26s}" + "".join(f"{cell:>14s}" for cell in cells))
    found = list(kept().values())
    tried, refused = sum(one["tried"] for one in found), sum(one["tried"] - one["read"] for one in found)
    return "\n".join([*lines, f"{len(found)} formats: {tried} tried, {refused} clean errors"])
