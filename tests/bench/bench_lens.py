"""Noise with and without Quiet Camera, of Principled BSDF and of Exact as OSL, in the scene of `bench engine`."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
from engine_materials import KINDS, Kind, bake_all, bundle_path
from engine_scenes import LIGHTS, Noise, Sizes, compare, lit
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image
from measured_materials.addon.rendering.quiet_camera import quiet_camera
from measured_materials.addon.report.principled_match import fit_principled
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.nodes.osl_material import build_osl_material
from rich.console import Console
from rich.table import Table

WITH_LAMPS = ("small lamp", "sun and sky")
MATERIALS = ("paper", "satin", "metallic paint")
PRINCIPLED, EXACT = "Principled", "exact, OSL"


def run(out: Path, quick: bool) -> None:
    """A row for each material and light; --quick takes one material in two lightings."""
    kinds = [kind for kind in KINDS if kind.name in (MATERIALS[:1] if quick else MATERIALS)]
    sizes = Sizes(seeds=2 if quick else 4)
    table = Table("material", "light", *(f"{name}{quiet}" for name in (PRINCIPLED, EXACT) for quiet in ("", ", quiet")))
    table.title = f"RMS noise at {sizes.samples} samples over the mean, and the mean; quiet: with Quiet Camera"
    with TemporaryDirectory() as folder:
        bake_all(kinds, Path(folder), BakeSettings())
        for kind in kinds:
            bundle = read_bundle(bundle_path(kind, Path(folder)))
            for light in ["sky", "small lamp"] if quick else LIGHTS:
                off, on = _in_light(kind, bundle, light, sizes, Path(folder))
                pairs = [found[name] for name in (PRINCIPLED, EXACT) for found in (off, on)]
                table.add_row(kind.name, light, *(f"{noise.rms:.2%}  {noise.mean:.4f}" for noise in pairs))
    Console(width=150).print(table)


def _in_light(
    kind: Kind, bundle: Bundle, light: str, sizes: Sizes, folder: Path
) -> tuple[dict[str, Noise], dict[str, Noise]]:
    """Without and with Quiet Camera."""
    with lit(light) as scene:
        aimed = lamp_image() if light in WITH_LAMPS else None
        lights = lamp_light_image() if light in WITH_LAMPS else None
        exact = build_osl_material(bundle, mode="exact", lamps=aimed, lights=lights)
        materials = {PRINCIPLED: fit_principled(kind.source(folder)).material(), EXACT: exact}
        off = compare(scene, materials, sizes)
        quiet_camera(scene, [obj for obj in scene.objects if obj.name.startswith("sphere")])
        on = compare(scene, materials, sizes)
    for material in materials.values():
        bpy.data.materials.remove(material)
    return off, on
