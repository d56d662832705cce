"""A fixture that a module of tests takes up by importing it."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    """Materials, groups and images of one test do not reach the next."""
    yield
    for collection in (bpy.data.materials, bpy.data.node_groups, bpy.data.images):
        for block in list(collection):
            collection.remove(block)
