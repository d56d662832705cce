"""Mistakes to plant into the sources, and which tests have to see each: run by `./run bench planted`.

A topic is one module of this folder with a tuple MISTAKES; whoever adds one lists it in `TOPICS`. That every entry
still fits its source is a test of the suite (`tests/test_planted.py`); that it is caught, only this bench can tell.
"""

from __future__ import annotations

import importlib

from .mistake import Mistake

TOPICS = ("engine", "samplers", "readers")


def all_mistakes() -> dict[str, Mistake]:
    """Of all topics, by name, in their order. Raises ValueError where two have one name."""
    found: dict[str, Mistake] = {}
    for topic in TOPICS:
        for mistake in importlib.import_module(f".{topic}", __name__).MISTAKES:
            if mistake.name in found:
                raise ValueError(f"two mistakes are called {mistake.name!r}")
            found[mistake.name] = mistake
    return found
