"""Shading maps in Cycles: the identity stack against f_r itself, envelope + residual against mirror, and quadrature."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.shading_maps.shading_map import ShadingMap
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat
from measured_materials.nodes.shading_map_material import build_shading_map
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_same
from support.scenes import TestScene, diffuse_material, furnace, lit_sphere
from support.swatches import identity_map, map_bundle, rough_map

EFFECT = 0.01
COLOUR = (1.3, 1.0, 0.7)
TINT = (0.9, 1.0, 0.8)
# Modes whose noise differs: samples for the same detectable effect.
SAMPLES = {"reference": 64, "exact": 32}


def tinted(material: bpy.types.Material) -> bpy.types.Material:
    """The same material, by its Tint."""
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    node.inputs["Tint"].default_value = (*TINT, 1)
    return material


def coloured(part: float) -> tuple[float, ...]:
    """A part of the swatch's colour, tinted."""
    return tuple(part * colour * tint for colour, tint in zip(COLOUR, TINT))


def glossy_material(alpha: float, colour: tuple[float, ...]) -> bpy.types.Material:
    """Cycles' own GGX."""
    material = compat.new_material("glossy")
    tree = material.node_tree
    closure, output = tree.nodes.new("ShaderNodeBsdfAnisotropic"), tree.nodes.new("ShaderNodeOutputMaterial")
    closure.distribution = "GGX"
    closure.inputs["Color"].default_value = (*colour, 1)
    closure.inputs["Roughness"].default_value = math.sqrt(alpha)
    tree.links.new(closure.outputs[0], output.inputs["Surface"])
    material.cycles.use_bump_map_correction = False
    return material


def agree_and_find(scene: TestScene, reference: np.ndarray, material: bpy.types.Material, samples: int) -> None:
    """No difference is found, and with a planted 2 % one is."""
    scene.show(material)
    assert_same(reference, scene.render(samples, range(100, 108)), scene.mask(), 0.0, EFFECT)


@pytest.mark.parametrize("mode", [pytest.param("reference", marks=pytest.mark.slow), "exact"])
def test_identity_stack_is_diffuse(tmp_path: Path, mode: str) -> None:
    """Sky, area lamp and bounce light."""
    render = RenderSettings(Lobe("lambert"), sigma=0.5, mode=mode)
    bundle = map_bundle(tmp_path / "identity", identity_map(), render)
    with lit_sphere(diffuse_material(coloured(0.5)), 64, lamp_size=4.0) as scene:
        scene.leave_terminator()
        agree_and_find(scene, scene.render(32, 6), tinted(build_shading_map(bundle)), SAMPLES[mode])


@pytest.mark.parametrize(
    "above, mode",
    [
        ("scale", "exact"),
        ("clamp", "reference"),
        pytest.param("scale", "reference", marks=pytest.mark.slow),
        pytest.param("clamp", "exact", marks=pytest.mark.slow),
    ],
)
def test_identity_stack_is_gloss(tmp_path: Path, above: str, mode: str) -> None:
    """GGX; towards grazing it exceeds its peak at the normal, which "scale" reproduces and "clamp" cuts."""
    render = RenderSettings(Lobe("ggx", 0.4), sigma=0.6, mode=mode, above=above)
    if above == "clamp":
        # a_max above everything that f_r reaches, as with calibrated photographs of a dull swatch.
        grazing = np.array([math.sqrt(1 - 1e-6), 0.0, 1e-3])
        render = replace(render, a_max=0.6 * float(render.lobe.peak(grazing)))
    bundle = map_bundle(tmp_path / "identity", identity_map(), render)
    with lit_sphere(glossy_material(0.4, coloured(0.6)), 64, lamp_size=4.0) as scene:
        scene.leave_terminator()
        agree_and_find(scene, scene.render(32, 6), tinted(build_shading_map(bundle)), SAMPLES[mode])


@pytest.mark.parametrize(
    "lobe, above",
    [
        pytest.param(Lobe("lambert"), "clamp", marks=pytest.mark.slow),
        (Lobe("ggx", 0.5), "scale"),
        pytest.param(Lobe("lambert"), "scale", marks=pytest.mark.slow),
        pytest.param(Lobe("ggx", 0.5), "clamp", marks=pytest.mark.slow),
        pytest.param(Lobe("phong", 12.0, 0.4), "clamp", marks=pytest.mark.slow),
        pytest.param(Lobe("phong", 12.0, 0.4), "scale", marks=pytest.mark.slow),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_envelope_and_residual_are_the_mirror(tmp_path: Path, lobe: Lobe, above: str) -> None:
    """A rough map, lit beyond its brightest photograph, must not depend on how it is split."""
    render = RenderSettings(lobe, sigma=0.8, above=above)
    render = replace(render, a_max=0.5 * float(lobe.peak(np.array([0.0, 0.0, 1.0]))))
    bundle = map_bundle(tmp_path / "rough", rough_map(), render)
    reference = tinted(build_shading_map(bundle, settings=replace(render, mode="reference"), lamps=lamp_image()))
    with lit_sphere(reference, 64, lamp_size=2.0) as scene:
        scene.leave_terminator()
        pictures = scene.render(80, 8)
        whole = tinted(build_shading_map(bundle, settings=render, lamps=lamp_image()))
        agree_and_find(scene, pictures, whole, 80)


@pytest.mark.parametrize("compression", ["none", "power", "basis"])
@pytest.mark.parametrize("mode", [pytest.param("reference", marks=pytest.mark.slow), "exact"])
def test_furnace_shows_the_integral_of_the_response(tmp_path: Path, compression: str, mode: str) -> None:
    """A uniform swatch S(x) = x^2 (k = 1, K = 2): under light from everywhere, 2 pi a_max / 3 for a Lambertian f_r."""
    slices = 12
    levels = np.linspace(0, 1, slices)[:, None, None, None]
    shading_map = ShadingMap(np.broadcast_to(levels**2, (slices, 2, 2, 3)).astype(np.float32))
    render = RenderSettings(sigma=0.9, mode=mode)
    bundle = map_bundle(tmp_path / "square", shading_map, render, compression=compression)
    a_max = 0.9 / math.pi
    # x = cos theta, so the integral over the hemisphere is 2 pi a_max times that of c^2; straight pieces lie above it.
    pieces = 0.0 if compression == "power" else 1 / (6 * (slices - 1) ** 2)
    expected = 2 * math.pi * a_max * (1 / 3 + pieces)
    with furnace(build_shading_map(bundle), resolution=48) as scene:
        middle = scene.render(256, 2).mean(0)[16:32, 16:32].mean()
    assert abs(middle / expected - 1) < 0.006


def test_measured_f_r(tmp_path: Path) -> None:
    """f_r from a table: the furnace shows the albedo that numpy finds for map and table together."""
    source = analytic.Ggx(alpha=0.5, f0=(0.9, 0.6, 0.3))
    measured = bake_source(source, tmp_path / "f_r", BakeSettings(resolution=32, alpha=(0.5, 0.3), envelope=False))
    stack = PhotoStack(rough_map(size=1).slices[1:], tuple("abcde"), None, False, ())
    settings = ArcSettings(
        slices=6, storage=Storage.FLOAT32, brdf=measured.path, render=RenderSettings(None, sigma=1.3, mode="reference")
    )
    result = bake_stack(stack, tmp_path / "both", settings)
    expected = np.array(result.facts["albedo"]["directional"][0])
    with furnace(build_shading_map(read_bundle(result.path)), resolution=48) as scene:
        middle = scene.render(256, 2).mean(0)[20:28, 20:28].mean((0, 1))
    assert np.abs(middle / expected - 1).max() < 0.01
