"""A swatch photographed against the light as well: baked, read again, and rendered, against quadrature of its maps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.albedo import LobeSource, resolved_scale
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.source import Array
from measured_materials.nodes import compat
from measured_materials.nodes.osl_script import use_osl
from measured_materials.nodes.shading_map_material import build_shading_map
from support.clean_blend import clean_blend  # noqa: F401
from support.direct_light import environment
from support.osl import skip_without_osl
from support.scenes import add_lamp, diffuse_material
from support.sharp_bounces import sharp_bounces  # noqa: F401
from support.sheet_scenes import (
    BEFORE,
    BEHIND,
    BELOW,
    TURNED,
    assert_mean,
    assert_shows,
    set_sky,
    sheet_scene,
    sky,
    spread,
    upper_hemisphere,
    viewer,
)
from test_denoiser_passes import denoiser_input
from test_sampled_sheets import add_room

LEVELS = np.array([0.1, 0.25, 0.4, 0.6, 0.8, 1.0])
# Light that is let through reddens as it grows, what is reflected turns blue: neither map is linear in any channel.
TILT = {"reflected": np.array([-0.5, 0.1, 0.4]), "through": np.array([0.6, -0.1, -0.5])}
BRIGHTEST = {"reflected": 0.15, "through": 0.12}  # in 1/sr
SETTINGS = ArcSettings(slices=8, storage=Storage.FLOAT32)


def photographs(part: str, size: int = 4) -> PhotoStack:
    """Even swatches whose colour depends on how much light there is."""
    hue = 1 + TILT[part] * (LEVELS[:, None] - 0.5)
    images = BRIGHTEST[part] * LEVELS[:, None] * hue
    whole = np.repeat(images[:, None, None], size, 1).repeat(size, 2).astype(np.float32)
    return PhotoStack(whole, tuple("abcdef"), None, True, ())


def bake(folder: Path, render: RenderSettings, **changes: Any) -> ShadingMapRecord:
    settings = replace(SETTINGS, render=render, **changes)
    made = bake_stack(photographs("reflected"), folder / "cloth", settings, through=photographs("through"))
    return ShadingMapRecord.read(read_bundle(made.path))


def looks(record: ShadingMapRecord, render: RenderSettings) -> Callable[[Array, Array], Array]:
    """f cos (n, 3) of one side's map by the formula, for local directions of the light above the horizon."""
    levels, means = np.linspace(0, 1, record.map.slices), record.load_map().slices[:, 0, 0]
    assert render.lobe is not None
    sigma, a_max = resolved_scale(render, record.map.a_max)
    f_r = LobeSource(render.lobe)

    def look(wi: Array, wo: Array) -> Array:
        x = sigma / a_max * f_r.evaluate(wi, wo) * np.maximum(wi[..., 2:], 0)
        value = np.stack([np.interp(x[..., k], levels, means[:, k]) for k in range(3)], -1)
        return a_max * value * (np.maximum(x, 1) if render.above == "scale" else 1)

    return look


def truth_under_sky(
    record: ShadingMapRecord, render: RenderSettings, theta: float, radiance: Callable[[Array], Array] = sky
) -> Array:
    """Radiance (3,) by quadrature; seen from either side the swatch looks alike."""
    turn = np.ones(3) if theta < 90 else TURNED
    wi, wo = upper_hemisphere(), (viewer(theta) * turn)[None]
    behind = record.transmitted()
    assert behind is not None
    reflected, through = looks(record, render), looks(behind, render.of_transmission(True))
    cosine = wi[:, 2:]
    light = reflected(wi, wo) * radiance(wi * turn) + through(wi, wo) * radiance(wi * BELOW * turn)
    return math.pi * (light / cosine).mean(0)


def truth_by_lamp(record: ShadingMapRecord, render: RenderSettings, theta: float, lamp: bpy.types.Object) -> Array:
    """The same of one square lamp that faces the origin."""
    u = (np.arange(40) + 0.5) / 40 - 0.5
    across = np.stack(np.meshgrid(u, u), -1).reshape(-1, 2) * lamp.data.size
    matrix = np.array(lamp.matrix_world)
    place = matrix[:3, 3] + across @ matrix[:3, :2].T
    distance = np.linalg.norm(place, axis=-1, keepdims=True)
    wi, wo = place / distance, viewer(theta)[None]
    facing = np.abs(wi @ matrix[:3, 2:3])
    through = wi[0, 2] < 0
    part = record.transmitted() if through else record
    assert part is not None
    look = looks(part, render.of_transmission(True) if through else render)
    solid = facing * lamp.data.size**2 / len(u) ** 2 / distance**2
    return (look(wi * (BELOW if through else 1), wo) * solid).sum(0) * lamp.data.energy / math.pi / lamp.data.size**2


LAMBERT = RenderSettings(sigma=0.45, transmission_sigma=0.35)
VEIL = replace(LAMBERT, transmission=Lobe("oren_nayar", 0.5))
SHEER = replace(LAMBERT, transmission=Lobe("phong", 12.0, 0.4), above="scale")


@pytest.mark.parametrize(
    ("mode", "theta", "render"),
    [
        ("exact", 30.0, LAMBERT),
        ("reference", 130.0, LAMBERT),
        ("exact", 30.0, SHEER),
        pytest.param("reference", 75.0, SHEER, marks=pytest.mark.slow),
        pytest.param("exact", 75.0, LAMBERT, marks=pytest.mark.slow),
        pytest.param("exact", 150.0, SHEER, marks=pytest.mark.slow),
    ],
)
def test_under_a_sky(tmp_path: Path, mode: Any, theta: float, render: RenderSettings) -> None:
    render = replace(render, mode=mode)
    record = bake(tmp_path, render)
    with sheet_scene(build_shading_map(record), theta) as scene:
        set_sky(scene.scene)
        assert_shows(scene, truth_under_sky(record, render, theta), samples=128, seeds=24)


def test_a_swatch_is_quiet_under_a_sky_alone(tmp_path: Path) -> None:
    """As a sheet of measured BRDFs is; the spread had been 0.10 and 0.067."""
    for mode, most in (("exact", 0.06), ("reference", 0.05)):
        (folder := tmp_path / mode).mkdir()
        record = bake(folder, replace(SHEER, mode=mode))
        with sheet_scene(build_shading_map(record), 30.0) as scene:
            set_sky(scene.scene)
            assert spread(scene) < most


@pytest.mark.parametrize(
    ("theta", "place", "aimed"),
    [(20.0, BEHIND, True), (20.0, BEFORE, True), pytest.param(60.0, BEHIND, False, marks=pytest.mark.slow)],
)
def test_a_lamp_behind_and_before(tmp_path: Path, theta: float, place: tuple[float, float, float], aimed: bool) -> None:
    record = bake(tmp_path, LAMBERT)
    material = build_shading_map(record, lamps=lamp_image() if aimed else None)
    with sheet_scene(material, theta) as scene:
        lamp = add_lamp(scene, "AREA", place, energy=300, size=3.0)
        lamp.visible_camera = True
        assert_shows(scene, truth_by_lamp(record, LAMBERT, theta, lamp), samples=128 if aimed else 384)


def by_scripts(record: ShadingMapRecord, **options: Any) -> bpy.types.Material:
    """One that samples lamps, whose rays are OSL, as in every Blender."""
    skip_without_osl()
    options |= {"lamps": lamp_image(), "lights": lamp_light_image(), "scripted": True, "pack": True}
    return build_shading_map(record, **options)


@pytest.mark.parametrize(
    ("theta", "place", "size", "render"),
    [
        (20.0, BEHIND, 3.0, replace(SHEER, mode="balanced")),
        pytest.param(20.0, BEFORE, 1.0, SHEER, marks=pytest.mark.slow),
        # No native closure carries what is let through: all of it is the mirror's and the emission's.
        pytest.param(75.0, BEHIND, 3.0, VEIL, marks=pytest.mark.slow),
        pytest.param(75.0, BEFORE, 3.0, SHEER, marks=pytest.mark.slow),
    ],
)
def test_a_lamp_on_either_side_is_sampled(
    tmp_path: Path,
    sharp_bounces: None,  # noqa: F811
    theta: float,
    place: tuple[float, float, float],
    size: float,
    render: RenderSettings,
) -> None:
    """Also one that the camera does not see."""
    record = bake(tmp_path, render)
    with sheet_scene(by_scripts(record), theta) as scene:
        use_osl(scene.scene)
        lamp = add_lamp(scene, "AREA", place, energy=300, size=size)
        lamp.visible_camera = False
        assert not update_scene(scene.scene).inexact
        assert_mean(scene, truth_by_lamp(record, render, theta, lamp), samples=256)


@pytest.mark.slow
def test_the_world_is_sampled_on_both_sides(
    tmp_path: Path,
    sharp_bounces: None,  # noqa: F811
) -> None:
    record = bake(tmp_path, SHEER)
    with sheet_scene(diffuse_material(), 50.0) as scene:
        pixels = add_room(scene)
        around = surroundings_of(update_scene(scene.scene))
        assert around is not None
        scene.show(by_scripts(record, surroundings=around))
        use_osl(scene.scene)
        update_scene(scene.scene)
        truth = truth_under_sky(record, SHEER, 50.0, environment(pixels))
        assert_mean(scene, truth, samples=256, tolerance=5e-3)


def test_preview_lets_as_much_through(tmp_path: Path) -> None:
    """Of the photograph at the level that stands for all; native closures alone."""
    render = replace(LAMBERT, mode="preview")
    record = bake(tmp_path, render)
    material = build_shading_map(record)
    with sheet_scene(material, 40.0) as scene:
        scene.scene.world, background = compat.new_world("furnace")
        background.inputs["Color"].default_value = (1, 1, 1, 1)
        shown = scene.render(16, 1).mean((0, 1, 2))
    colour = [1 + TILT[part] * 0.25 for part in ("reflected", "through")]
    np.testing.assert_allclose(shown, 0.45 * colour[0] + 0.35 * colour[1], rtol=0.02)
    assert not any(node.bl_idname == "ShaderNodeBsdfRayPortal" for tree in bpy.data.node_groups for node in tree.nodes)


def test_the_denoiser_gets_what_leaves_the_swatch(tmp_path: Path) -> None:
    record = bake(tmp_path, LAMBERT)
    with sheet_scene(build_shading_map(record, features=True), 40.0) as scene:
        scene.scene.cycles.samples = 1
        albedo = denoiser_input(scene, "Albedo")[..., :3]
    colour = [1 + TILT[part] * 0.25 for part in ("reflected", "through")]
    np.testing.assert_allclose(albedo.mean((0, 1)), 0.45 * colour[0] + 0.35 * colour[1], rtol=0.02)
    assert albedo.std((0, 1)).max() < 1e-5
