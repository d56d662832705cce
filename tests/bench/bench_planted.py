"""Mistakes planted into a copy of the sources, and whether the tests see them; the mistakes lie in `tests/planted`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from planted import harness


def run(out: Path, quick: bool, names: Sequence[str] = ()) -> int:
    """All of them, or those named. Returns 0 where enough were caught."""
    return harness.run(names, quick, out)
