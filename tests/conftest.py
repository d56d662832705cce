"""Fixtures shared by the whole suite."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from support.imports import library, measurement, plate, registered  # noqa: F401

_EXIT_STATUS = pytest.StashKey[int]()

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of measured inputs beside the repository; users do not have it, so its absence skips."""
    if not (SHARED / "data").is_dir():
        pytest.skip(f"measured inputs are not here ({SHARED.name}/data beside the repository)")
    return SHARED / "data"


@pytest.fixture(scope="session")
def shared_tools(shared_data: Path) -> Path:
    """Scripts beside the repository, among them the MERL reconstructor."""
    return SHARED / "tools"


@pytest.fixture(autouse=True)
def engine_kept() -> Iterator[None]:
    """Whatever a test or the operators it calls choose as the engine, the next test finds the scene as it was.

    The tests of one process share Blender's one file, and which of them come before is left to chance.
    """
    bpy = sys.modules.get("bpy")
    # The wheel sets the context up with the first file; before that there is no scene.
    scene = getattr(bpy.context, "scene", None) if bpy else None
    engine = scene.render.engine if scene else None
    yield
    if engine is not None and bpy.context.scene is not None:
        bpy.context.scene.render.engine = engine


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Kept for `pytest_unconfigure`."""
    session.config.stash[_EXIT_STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """End at once after everything is said: a process that has rendered with the bpy wheel may never end by itself.

    One of Blender's destructors waits for a thread that waits for it (seen in gdb once in a few dozen runs).
    """
    if "bpy" in sys.modules and _EXIT_STATUS in config.stash:
        for stream in (config.get_terminal_writer(), sys.stdout, sys.stderr):
            with suppress(OSError):
                stream.flush()
        os._exit(config.stash[_EXIT_STATUS])
