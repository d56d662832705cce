"""A fixture that a module of tests takes up by importing it."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    """No material, group or image reaches the next test, nor any lamp, world, mesh or text that this one makes."""
    data = bpy.data
    lasting = [(blocks, set(blocks)) for blocks in (data.lights, data.worlds, data.meshes, data.texts)]
    yield
    for collection, kept in [(data.materials, set()), (data.node_groups, set()), (data.images, set()), *lasting]:
        for block in set(collection) - kept:
            collection.remove(block)
