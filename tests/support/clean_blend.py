"""A fixture that a module of tests takes up by importing it."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest

_LASTING = ("lights", "worlds", "meshes")


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    """No material, group, image or text reaches the next test, nor any lamp, world or mesh that this one makes."""
    # By number: a test that opens another file leaves no datablock of before, and asking one that is gone crashes.
    kept = {block.session_uid for name in _LASTING for block in getattr(bpy.data, name)}
    yield
    for name in ("materials", "node_groups", "images", "texts", *_LASTING):
        collection = getattr(bpy.data, name)
        for block in [block for block in collection if block.session_uid not in kept]:
            collection.remove(block)
