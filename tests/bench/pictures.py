"""Bake, build and render one picture: what every picture bench does."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import bpy
from measured_materials.addon.studio.studio import build_studio, remove_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.nodes.material import build_material


def picture(
    source: BrdfSource,
    settings: BakeSettings,
    *,
    size: int,
    samples: int,
    environment: Path | None = None,
    shape: str = "ball",
    filter: str | None = None,
) -> tuple[Array, BakeResult]:
    """Linear pixels (size, size, 3) of a source baked with these settings, and the bake; files are temporary."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        # What is shown is the table itself, by mirror alone.
        result = bake_source(source, Path(folder) / "material", replace(settings, envelope=False))
        material = build_material(read_bundle(result.path), filter=filter)
        scene = build_studio(
            material, resolution=(size, size), samples=samples, seed=1, environment=environment, shape=shape
        )
        try:
            pixels = render_linear(scene)
        finally:
            remove_studio(scene)
            images = [image for image in bpy.data.images if image.filepath.startswith(folder)]
            bpy.data.materials.remove(material)
            for image in images:
                bpy.data.images.remove(image)
    print(f"  {source.name} {settings.parameterization} {settings.resolution}: {time.perf_counter() - started:.0f} s")
    return pixels, result
