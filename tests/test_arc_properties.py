"""Settings of shading maps as Blender properties: nothing is lost on the way there and back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.material.facts import record_of
from measured_materials.addon.material.lighting import lighting_of, show_lighting
from measured_materials.addon.summary.bake_stages import USUAL_SIZE
from measured_materials.addon.ui.properties.photographs import _shown, arc_settings_of, show_arc_settings
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import LOBES, Lobe
from measured_materials.bake.photographs.settings import StackSettings
from measured_materials.bake.shading_maps.against_light import ThroughSettings
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from support.stacks import write_frame, write_stack
from test_addon import registered  # noqa: F401


@pytest.mark.parametrize(
    "settings",
    [
        ArcSettings(stack=StackSettings(size=USUAL_SIZE)),
        ArcSettings(
            slices=5, storage=Storage.FLOAT32, compression="basis", rank=3, tileable="quilt", lobe_auto=True,
            render=RenderSettings(Lobe("phong", 60.0, 0.3), 0.7, "scale", "angular", "reference", "extend", 0.25),
            stack=StackSettings(
                decode="gamma:1.8", azimuth=40, spread=7.5, sides="both", crop=(1, 2, 30, 40), albedo=0.3
            ),
        ),
        ArcSettings(azimuths="all", azimuth_rank=7),
        ArcSettings(azimuths="arc", compression="power"),
        ArcSettings(through=ThroughSettings(
            Path("behind").resolve(), Path("dirs.csv").resolve(), transmittance=0.125
        )),
        ArcSettings(through=ThroughSettings(
            Path("behind").resolve(), diffuser=(1, 2, 30, 40), diffuser_transmittance=0.375
        )),
        ArcSettings(
            brdf=Path("gloss.mmat").resolve(),
            render=RenderSettings(None, 0.5),
            stack=StackSettings(
                size=64, decode="linear", lights=Path("dirs.lp").resolve(), flat_field=Path("flat.exr").resolve(),
                corners=((1, 1), (9.5, 1), (9, 8), (1, 8)), white_card=(0, 0, 4, 4), white_reflectance=0.8, align="off",
            ),
        ),
    ],
)  # fmt: skip
def test_settings_survive_the_properties(settings: ArcSettings) -> None:
    material = bpy.data.materials.new("settings")
    try:
        assert _settings(material) == ArcSettings(stack=StackSettings(size=USUAL_SIZE))
        show_arc_settings(material.measured_arc, settings, pack=False)
        show_lighting(material, settings.render)
        assert _settings(material) == settings
        assert material.measured_arc.pack is False
    finally:
        bpy.data.materials.remove(material)


def test_light_from_every_side_leaves_out_what_is_said_of_an_arc() -> None:
    """As the dialogue does, which no longer shows it."""
    material = bpy.data.materials.new("settings")
    try:
        arc = material.measured_arc
        arc.azimuths, arc.compression, arc.one_plane, arc.azimuth = "all", "power", True, 40
        arc.spread, arc.sides, arc.azimuth_rank = 7.5, "both", 3
        usual = StackSettings(size=USUAL_SIZE)
        assert _settings(material) == ArcSettings(azimuths="all", azimuth_rank=3, stack=usual)
        shown = _shown(arc, material.measured_lighting)
        assert shown["lights"] == ("lights", "spheres", "azimuths", "azimuth_rank", "fit_lobe")
        assert shown["files"] == ("storage", "pack") and "slices" not in shown["swatch"]
        arc.azimuths = "arc"
        assert "azimuth_rank" not in _shown(arc, material.measured_lighting)["lights"]
        assert "slices" in _shown(arc, material.measured_lighting)["swatch"]
        settings = _settings(material)
        assert settings.azimuth_rank is None
        assert (settings.stack.azimuth, settings.stack.spread, settings.stack.sides) == (40, 7.5, "both")
    finally:
        bpy.data.materials.remove(material)


def test_spheres_are_kept_for_the_same_photographs_alone(plate: Any, tmp_path: Path) -> None:
    """The panel shows them; on other photographs circles are elsewhere."""
    spheres, folder = ((48.0, 48.0, 40.0),), tmp_path / "ball"
    folder.mkdir()
    x, y = np.meshgrid(*2 * [(np.arange(96) + 0.5 - 48) / 40])
    for k, elevation in enumerate((30, 50, 70)):
        half = np.sin(np.radians(90 - elevation) / 2)  # where a mirror shows the light, to the right
        spot = (x - half) ** 2 + y**2 < 0.006
        write_frame(folder / f"p{k}.exr", np.repeat(np.where(spot, 40.0, 0.2)[..., None], 3, -1).astype(np.float32))
    settings = ArcSettings(stack=StackSettings(spheres=spheres, align="off"))
    bundle = bake_arc(folder, tmp_path / "ball.mmat", settings).path
    bpy.ops.measured_materials.import_bundle(filepath=str(bundle))
    material = plate.active_material
    properties = material.measured_arc
    assert properties.spheres == "48,48,40"
    others = str(write_stack(tmp_path / "others"))
    for chosen, kept in ((str(folder), spheres), ("", spheres), ("unset", spheres), (others, ()), ("", ())):
        if chosen == "unset":
            properties.property_unset("spheres")
            chosen = ""
        assert bpy.ops.measured_materials.bake_again(filepath=chosen) == {"FINISHED"}
        assert record_of(material).settings.stack.spheres == kept
        assert bool(properties.spheres) == bool(kept)


@pytest.fixture
def material(registered: None) -> Iterator[bpy.types.Material]:  # noqa: F811
    made = bpy.data.materials.new("settings")
    yield made
    bpy.data.materials.remove(made)


def test_spheres_of_a_panel_are_those_of_the_bake(material: bpy.types.Material) -> None:
    properties = material.measured_arc
    two = ((812.0, 340.0, 95.5), (1200.25, 64.0, 88.0))
    for text, spheres, shown in (
        ("", (), ""),
        ("812, 340 ,95.5", two[:1], "812,340,95.5"),
        (" 812,340,95.5  1200.25,64,88 ", two, "812,340,95.5 1200.25,64,88"),
    ):
        properties.spheres = text
        settings = _settings(material)
        assert settings.stack.spheres == spheres
        show_arc_settings(properties, settings, pack=True)
        assert properties.spheres == shown
    for wrong in ("812,340", "812;340;95", "812,340,x", "812,340,95,"):
        properties.spheres = wrong
        with pytest.raises(BakeError, match=r"photograph settings: (Mirror Spheres|radius of a sphere) is '"):
            _settings(material)


def test_a_file_of_lights_hides_the_spheres(material: bpy.types.Material) -> None:
    material.measured_arc.spheres = "812,340,95"
    for lights, spheres in (("/lights.csv", ()), ("", ((812, 340, 95),))):
        material.measured_arc.lights = lights
        assert _settings(material).stack.spheres == spheres
        shown = _shown(material.measured_arc, material.measured_lighting)["lights"]
        assert ("spheres" in shown) == bool(spheres)


def _settings(material: bpy.types.Material) -> ArcSettings:
    return arc_settings_of(material.measured_arc, material.measured_lighting, material.measured_quality.mode)


@pytest.mark.parametrize("name", LOBES)
def test_lighting_survives_the_properties(name: str) -> None:
    material = bpy.data.materials.new("lighting")
    try:
        settings = RenderSettings(Lobe(name), 0.123, a_max=0.5)
        show_lighting(material, settings)
        assert lighting_of(material.measured_lighting, material.measured_quality.mode) == settings
        assert material.measured_lighting.problem == ""
    finally:
        bpy.data.materials.remove(material)


def test_lighting_of_another_material_does_nothing() -> None:
    plain = bpy.data.materials.new("plain")
    try:
        plain.measured_lighting.sigma = 0.9
        assert plain.measured_lighting.sigma == pytest.approx(0.9) and plain.measured_lighting.problem == ""
    finally:
        bpy.data.materials.remove(plain)
