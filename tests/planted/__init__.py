"""Mistakes to plant into the sources, and which tests have to see each: run by `./run bench planted`.

A topic is a module of this folder with a tuple MISTAKES, listed in `TOPICS`, or a .json file with a list of objects
that have the fields of `Mistake`. That every entry still fits its source is a test of the suite,
`tests/test_planted.py`; that it is caught, only this bench can show.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator
from pathlib import Path

from .mistake import Mistake

TOPICS = ("engine", "samplers", "readers")


def all_mistakes() -> dict[str, Mistake]:
    """Of all topics, by name, in their order. Raises ValueError where two have one name."""
    found: dict[str, Mistake] = {}
    for mistake in _listed():
        if mistake.name in found:
            raise ValueError(f"two mistakes are called {mistake.name!r}")
        found[mistake.name] = mistake
    return found


def _listed() -> Iterator[Mistake]:
    for topic in TOPICS:
        yield from importlib.import_module(f".{topic}", __name__).MISTAKES
    for path in sorted(Path(__file__).parent.glob("*.json")):
        for entry in json.loads(path.read_text(encoding="utf-8")):
            name, tests = entry["name"].replace(" ", "-"), tuple(entry["tests"])
            yield Mistake(**{**entry, "name": name, "tests": tests})
