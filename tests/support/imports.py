"""A measurement to import in the window, and an object to import it for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.shading_maps.bake import bake_arc
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl

from support.stacks import write_stack

# Blender is imported where it is used: most of the suite does without.


@pytest.fixture(scope="module")
def measurement(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of a lacquer, in MERL's format."""
    path = tmp_path_factory.mktemp("measurement") / "lacquer.binary"
    write_merl(path, by_name("ggx", alpha=0.3, diffuse=0.2))
    return path


@pytest.fixture
def registered() -> Iterator[None]:
    """The extension, while a test runs."""
    import measured_materials

    measured_materials.register()
    yield
    measured_materials.unregister()


@pytest.fixture
def plate(registered: None) -> Iterator[Any]:
    """An active object without a material; everything made in the test goes with it."""
    import bpy

    known = datablocks()
    mesh = bpy.data.meshes.new("plate")
    obj = bpy.data.objects.new("plate", mesh)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    yield obj
    bpy.data.objects.remove(obj)
    bpy.data.meshes.remove(mesh)
    for kind, before in known.items():
        bpy.data.batch_remove(set(getattr(bpy.data, kind)) - before)


def datablocks() -> dict[str, set[Any]]:
    """All that imports make."""
    import bpy

    return {kind: set(getattr(bpy.data, kind)) for kind in ("materials", "images", "node_groups")}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of bundles: a formula's and a swatch's, with the photographs of the latter."""
    folder = tmp_path_factory.mktemp("library")
    settings = BakeSettings(6, "squared", basis="half", envelope=False)
    bake_source(by_name("ggx", alpha=0.3), folder / "gold.mmat", settings)
    bake_arc(write_stack(folder / "felt", suffix=".exr"), folder / "felt.mmat")
    return folder
