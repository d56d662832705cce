"""What a bake returns, and what it tells on its way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..source import Facts

# Called with the name of a stage and its share done.
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class BakeResult:
    """Result of a bake: the bundle's folder, the facts written into it, and the time it took in seconds."""

    path: Path
    facts: Facts
    seconds: float
