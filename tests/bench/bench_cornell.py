"""The Cornell paints, fitted without 10 % of their samples, and judged on those."""

from __future__ import annotations

from pathlib import Path

from materials import cornell_files
from measured_materials.bake.sources import cornell


def run(out: Path, quick: bool) -> None:
    """Print the table; --quick does one paint."""
    cornell.main([str(path) for path in cornell_files()[: 1 if quick else None]])
