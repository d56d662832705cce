"""A window's scene that does not keep others from sampling their lamps."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest


@pytest.fixture
def sharp_bounces() -> Iterator[None]:
    """Within, the scene that Blender starts with filters no glossy light: with that no lamp is sampled in any scene."""
    cycles = bpy.context.scene.cycles
    before, cycles.blur_glossy = cycles.blur_glossy, 0.0
    yield
    cycles.blur_glossy = before
