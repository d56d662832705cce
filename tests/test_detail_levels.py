"""Means of a swatch's texels by distance: their layout, means of light where S is held at 0, and the nodes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from measured_materials.addon.material.adjust.swatch import swatch_mapping
from measured_materials.addon.material.bake_photographs import swatch_from
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.kinds import SHADING_MAP
from measured_materials.addon.material.rebuild import effects_of
from measured_materials.addon.material.scene_fit import LEVELS_EFFECT, Effect, plan_levels
from measured_materials.addon.material.texel_footprint import Footprint
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.scene_check.check import check_scene, mend
from measured_materials.addon.scene_check.findings import WRONG, Finding
from measured_materials.bake import xp_numpy
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis, levels_of
from measured_materials.bake.shading_maps.azimuth.azimuth_envelope import azimuth_envelope
from measured_materials.bake.shading_maps.azimuth.curve_layout import CurveLayout, pack_curves
from measured_materials.bake.shading_maps.azimuth.mean_coefficients import light_coefficients
from measured_materials.bake.shading_maps.reduced_map import DetailLayout, detail_layout, mean_tiles, pack_levels
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.shading_maps.slice_atlas import MAX_EXTENT, SliceLayout
from measured_materials.nodes import compat, expr
from measured_materials.nodes.azimuth_group import AzimuthImages, azimuth_group
from measured_materials.nodes.group import call
from measured_materials.nodes.map_models import basis_group
from measured_materials.nodes.shading_map_material import build_shading_map
from measured_materials.nodes.slices_group import Detail, SliceImages, SliceOptions, slices_group
from support.azimuth import clamped_basis, write_azimuth_bundle
from support.azimuth_truth import between
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.scenes import TestScene
from support.swatches import map_bundle, rough_map
from test_addon import registered  # noqa: F401

# Of no common factor with the levels, and one side twice the other.
HEIGHT, WIDTH = 37, 74
TILES = np.random.default_rng(3).random((3, HEIGHT, WIDTH, 4), np.float32)
ANYWHERE = np.random.default_rng(4).uniform(-2, 3, (300, 2))
SEAMS = np.random.default_rng(5).choice([0.0, 1.0, 0.5 / WIDTH, -1e-3, 0.999], (40, 2))
UV = np.concatenate([ANYWHERE, SEAMS])
# A float32 coordinate of an image of 300 rows, times slopes of up to 1 a texel.
TOLERANCE = 3e-4
PIXEL = 1e-3


def layout_of(tiles: int = len(TILES)) -> DetailLayout:
    found = detail_layout(SliceLayout(tiles, HEIGHT, WIDTH))
    assert found is not None
    return found


def level_of(tiles: np.ndarray, level: int) -> np.ndarray:
    return tiles if level == 0 else mean_tiles(tiles, *_size(level))


def _size(level: int) -> tuple[int, int]:
    return layout_of().levels[level].height, layout_of().levels[level].width


def test_levels_begin_at_four_texels_and_end_at_four() -> None:
    assert layout_of().factors == (1, 4, 8)
    assert [(one.height, one.width) for one in layout_of().levels] == [(37, 74), (9, 18), (4, 9)]
    assert detail_layout(SliceLayout(1, 512, 512)).factors == (1, 4, 8, 16, 32, 64, 128)
    assert detail_layout(SliceLayout(7, 512, 512)).rows < 1.6 * SliceLayout(7, 512, 512).rows
    assert detail_layout(SliceLayout(1, 15, 400)) is None
    assert detail_layout(SliceLayout(MAX_EXTENT // 520, 512, 512)) is None


@pytest.mark.parametrize("level, texels", [(0, 0.0), (0, 7.9), (1, 8.1), (1, 15.9), (2, 16.1), (2, 1e30)])
def test_a_place_reads_the_mean_of_its_level(level: int, texels: float) -> None:
    """Across every seam, in every tile, as if each level were an image of its own that repeats."""
    layout = layout_of()
    image = pack_levels(TILES, TILES, layout)
    assert image.shape == (layout.rows, layout.width, 4)
    u, v = UV[:, 0], UV[:, 1] - np.floor(UV[:, 1])
    across, top, pitch = layout.place(xp_numpy, np.full(len(UV), texels), u, v)
    for index, tile in enumerate(level_of(TILES, level)):
        found = between(image, np.stack([across, layout.image_v(top, pitch, index)], -1))
        np.testing.assert_allclose(found, between(tile, np.stack([u, v], -1)), atol=1e-6)


def test_every_level_has_the_whole_light() -> None:
    for level in range(3):
        np.testing.assert_allclose(level_of(TILES, level).mean((1, 2)), TILES.mean((1, 2)), rtol=1e-5)


# --- held at 0 ------------------------------------------------------------------------------------------


def dark_basis() -> AzimuthBasis:
    """Lambertian texels of steep normals in four curves: half of all sides leave one dark, and some sums below 0."""
    slopes = np.random.default_rng(6).normal(0, 1, (HEIGHT, WIDTH, 2))
    for axis in (0, 1):  # as of threads a few texels wide
        slopes = sum(np.roll(slopes, shift, axis) for shift in range(5)) / 5
    slopes *= 1.5 / slopes.std()
    normals = np.concatenate([slopes.reshape(-1, 2), np.ones((HEIGHT * WIDTH, 1))], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    phi, x = np.meshgrid(2 * np.pi * np.arange(12) / 12, levels_of(6), indexing="ij")
    towards = np.stack([np.sqrt(1 - x**2) * np.cos(phi), np.sqrt(1 - x**2) * np.sin(phi), x])
    lit = np.maximum(np.einsum("tk,kpn->tpn", normals, towards), 0)
    left, values, curves = np.linalg.svd(lit.reshape(len(lit), -1), full_matrices=False)
    mixed = (left * values)[:, None, :4] * np.array([1.0, 0.7, 0.4])[:, None]
    coefficients = mixed.reshape(HEIGHT, WIDTH, 3, 4).astype(np.float32)
    kept = curves[:4].reshape(4, 12, 6)
    kept[:, :, 0] = kept[:, :, 1]  # as of a bake
    return AzimuthBasis(coefficients, kept.astype(np.float32))


def test_means_of_light_where_texels_are_held_at_zero() -> None:
    """At every level and azimuth: nearer to the mean of S than mean coefficients are, and right on the whole."""
    basis = dark_basis()
    light = light_coefficients(basis)
    across, up = (np.arange(4 * side) / (4 * side) for side in (WIDTH, HEIGHT))
    places = np.stack(np.meshgrid(across, up), -1)  # between the texels too, where their coefficients are blended
    errors = []
    for coefficients in (light, basis.coefficients):
        mean = coefficients.mean((0, 1), dtype=np.float64)
        worst = []
        for x in (0.15, 0.4, 0.7, 1.0):
            for phi in 2 * np.pi * np.arange(5) / 5:
                whole = basis.at(places, np.full(places.shape[:2], x), np.full(places.shape[:2], phi)).mean((0, 1))
                worst.append(np.maximum(mean @ basis.weights(x, phi), 0) / whole - 1)
        errors.append((np.sqrt(np.mean(np.square(worst))), abs(np.mean(worst))))
    assert errors[0][0] < 0.5 * errors[1][0] and errors[0][1] < 0.3 * errors[1][1], errors
    # What is nowhere below 0 stays as it is.
    bright = clamped_basis()
    bright = replace(bright, coefficients=bright.coefficients * 0 + np.array([1, 0, 0, 0, 0], np.float32))
    np.testing.assert_array_equal(light_coefficients(bright), bright.coefficients)


# --- nodes ----------------------------------------------------------------------------------------------


def detail_at(texels: float, tiles: int) -> Detail:
    """A card's camera is a little less than 1 above it: 0.9 to 1, wherever rays begin."""
    return Detail(layout_of(tiles), layout_of(1), texels)


def looked_up(group: bpy.types.ShaderNodeTree, *rest: np.ndarray) -> list[np.ndarray]:
    uv = np.concatenate([UV, np.zeros((len(UV), 1))], -1).astype(np.float32)
    return card(lambda at, *more: call(group, at, *more), uv, *rest)


@pytest.mark.parametrize("level, texels", [(0, 7.5), (1, 9.4), (2, 18.0)])
def test_slices_read_the_level_of_the_ray(level: int, texels: float) -> None:
    envelope = np.random.default_rng(7).random((1, HEIGHT, WIDTH, 4), np.float32)
    images = SliceImages(
        data_image("residual", pack_levels(TILES[..., :3], TILES[..., :3], layout_of())),
        data_image("envelope", pack_levels(envelope, envelope, layout_of(1))),
        SliceLayout(len(TILES), HEIGHT, WIDTH),
        detail=detail_at(texels, len(TILES)),
    )
    group = slices_group("test levels", images, SliceOptions())
    x = np.tile(np.linspace(0, 1, 17), 20).astype(np.float32)
    _, residual, m, share = looked_up(group, x, x * 0 + 1, x * 0)
    slices = np.concatenate([np.zeros((1, len(UV), 3)), [between(t, UV) for t in level_of(TILES[..., :3], level)]])
    position = x * (len(slices) - 1)
    base = np.minimum(position.astype(int), len(slices) - 2)
    part, at = (position - base)[:, None], np.arange(len(UV))
    np.testing.assert_allclose(residual, (1 - part) * slices[base, at] + part * slices[base + 1, at], atol=TOLERANCE)
    texel = between(level_of(envelope, level)[0], UV)
    np.testing.assert_allclose(np.column_stack([m, share]), texel, atol=TOLERANCE)


def test_a_basis_reads_means_of_its_coefficients() -> None:
    coefficients = TILES[..., :3]
    images = SliceImages(
        data_image("coefficients", pack_levels(coefficients, coefficients, layout_of())),
        data_image("envelope", pack_levels(TILES[:1] * 0, TILES[:1] * 0, layout_of(1))),
        SliceLayout(len(TILES), HEIGHT, WIDTH),
        detail=detail_at(9.4, len(TILES)),
    )
    slopes = np.array([1.0, 0.5, 0.2])
    group = basis_group("test levels", images, tuple((0.0, float(s)) for s in slopes), SliceOptions())
    x = np.tile(np.linspace(0, 1, 17), 20).astype(np.float32)
    reflected = looked_up(group, x, x * 0 + 1, x * 0)[0]
    expected = (
        sum(s * between(tile, UV) for s, tile in zip(slopes, level_of(coefficients, 1), strict=True)) * x[:, None]
    )
    np.testing.assert_allclose(reflected, expected, atol=TOLERANCE)


@pytest.mark.parametrize("level, texels", [(1, 9.4), pytest.param(2, 18.0, marks=pytest.mark.slow)])
def test_a_map_over_azimuth_reads_means_of_light(level: int, texels: float) -> None:
    basis = dark_basis()
    split = azimuth_envelope(basis)
    tiles, light = (np.moveaxis(c, -1, 0) for c in (basis.coefficients, light_coefficients(basis)))
    envelope = np.concatenate([split.envelope, split.share[..., None]], -1)[None]
    images = AzimuthImages(
        data_image("coefficients", pack_levels(tiles, light, layout_of(basis.rank))),
        data_image("envelope", pack_levels(envelope, envelope, layout_of(1))),
        SliceLayout(basis.rank, HEIGHT, WIDTH),
        curves=data_image("curves", pack_curves(basis.curves)),
        curve_layout=CurveLayout(*basis.curves.shape),
        detail=detail_at(texels, basis.rank),
    )
    group = azimuth_group("test levels", images, SliceOptions())
    x = np.tile(np.linspace(0, 1, 17), 20).astype(np.float32)
    phi = np.linspace(-3, 3, len(x))
    towards = np.stack([np.cos(phi), np.sin(phi), 0 * phi], -1).astype(np.float32)
    reflected = looked_up(group, x, x * 0 + 1, x * 0, towards)[0]
    coefficients = between(np.moveaxis(level_of(light, level), 0, -1), UV)
    sums = np.einsum("pcr,pr->pc", coefficients, basis.weights(x, phi))
    expected = np.maximum(sums, between(level_of(envelope, level)[0], UV)[:, :3] * x[:, None])
    np.testing.assert_allclose(reflected, expected, atol=4 * TOLERANCE)


def test_a_pixel_holds_more_texels_the_farther_it_is() -> None:
    """Of a plane that leans away from the camera: its distance, measured along the ray, times those at 1."""
    scene, mesh = bpy.data.scenes.new("leaning"), bpy.data.meshes.new("plane")
    mesh.from_pydata([(-50, 0, 0), (50, 0, 0), (50, 90, 0), (-50, 90, 0)], [], [(0, 1, 2, 3)])
    plane, camera = bpy.data.objects.new("plane", mesh), bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    camera.matrix_world = Matrix.Translation((0, 0, 2)) @ Matrix.Rotation(np.radians(60), 4, "X")
    camera.data.angle, camera.data.clip_start = np.radians(20), 1e-3
    material = compat.new_material("texels")
    tree = material.node_tree
    with expr.building(tree):
        shown = expr.node("ShaderNodeEmission", {}, {"Strength": detail_at(0.5, 1).in_a_pixel})
        output = expr.node("ShaderNodeOutputMaterial", {}, {})
        tree.links.new(shown.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    for obj in (plane, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = 1, 9
    compat.ensure_cycles()
    set_unbiased(scene, samples=1, seed=0)
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 0.01
    with TestScene(scene, plane) as test:
        found = test.render(1, 1)[0][:, 0, 0]
    tangent = np.tan(np.radians(10)) / 9 * (9 - 1 - 2 * np.arange(9))
    down = np.radians(30) - np.arctan(tangent)
    np.testing.assert_allclose(found, 0.5 * 2 / np.sin(down), rtol=0.02)


# --- materials ------------------------------------------------------------------------------------------


@contextmanager
def from_afar(material: bpy.types.Material, distance: float, half: float = 100.0) -> Iterator[TestScene]:
    """A plane under an even sky, looked down at; a pixel is a thousandth of the distance across."""
    compat.ensure_cycles()
    scene, mesh = bpy.data.scenes.new("afar"), bpy.data.meshes.new("plane")
    corners = [(x * half, y * half, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    for loop, (x, y, _) in zip(mesh.uv_layers.new(name="UVMap").data, corners, strict=True):
        loop.uv = (x, y)
    mesh.materials.append(material)
    plane, camera = bpy.data.objects.new("plane", mesh), bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    camera.location, camera.data.angle = (0, 0, distance), 2 * np.arctan(16 * PIXEL / 2)
    camera.data.clip_end = 2 * distance
    for obj in (plane, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    scene.world, _ = compat.new_world("even")
    scene.render.resolution_x = scene.render.resolution_y = 16
    set_unbiased(scene, samples=1, seed=0)
    with TestScene(scene, plane, [camera]) as test:
        yield test


def rough_bundle(folder: Path) -> Bundle:
    return map_bundle(folder / "rough.mmat", rough_map(size=64), RenderSettings(mode="preview", sigma=0.5, a_max=0.2))


def test_far_texels_have_their_mean_without_noise(tmp_path: Path) -> None:
    """A pixel is 40 texels across: four samples tell what it shows, where they told four texels' light."""
    bundle = rough_bundle(tmp_path)
    distance = 40 / (32 * PIXEL)  # of 32 texels a unit
    pictures = {}
    for name, (texels, reduce) in {"texels": (0.0, 1), "levels": (32 * PIXEL, 1), "both": (32 * PIXEL, 2)}.items():
        material = build_shading_map(bundle, texels=texels, reduce=reduce)
        with from_afar(material, distance) as scene:
            pictures[name] = scene.render(samples=4, seeds=2)
    noise = {name: float(found.std((0, 1, 2)).mean() / found.mean()) for name, found in pictures.items()}
    assert noise["levels"] < 0.1 * noise["texels"] and noise["texels"] > 0.1
    # A mean of 2 x 256 pixels.
    means = {name: found.mean() for name, found in pictures.items()}
    # Of means in the place of texels there are means too.
    assert noise["both"] == pytest.approx(noise["levels"], rel=0.5) and means["both"] == pytest.approx(
        means["levels"], rel=0.01
    )
    assert means["levels"] == pytest.approx(means["texels"], rel=4 * noise["texels"] / np.sqrt(2 * 256))


def test_near_texels_stay(tmp_path: Path) -> None:
    """Where a pixel is smaller than eight texels the picture is the same but for the last digits."""
    bundle, pictures = rough_bundle(tmp_path), []
    for texels in (0.0, 32 * PIXEL):
        with from_afar(build_shading_map(bundle, texels=texels), 7 / (32 * PIXEL)) as scene:
            pictures.append(scene.render(samples=1, seeds=1))
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=2e-3)


def test_a_material_over_azimuth_holds_means_of_light(tmp_path: Path) -> None:
    basis = dark_basis()
    bundle = write_azimuth_bundle(tmp_path / "dome.mmat", basis, RenderSettings(sigma=0.5, a_max=0.2))
    build_shading_map(bundle, texels=1.0)
    image = next(image for image in bpy.data.images if image.name.endswith("coefficients detail"))
    found = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(found)
    tiles, light = (np.moveaxis(c, -1, 0) for c in (basis.coefficients, light_coefficients(basis)))
    expected = pack_levels(tiles, light, layout_of(basis.rank)) * bundle.material["map"]["scale"]
    np.testing.assert_allclose(found.reshape(image.size[1], -1, 4)[::-1, :, :3], expected, rtol=1e-3, atol=1e-4)
    # The next material of the same bundle takes the same textures.
    build_shading_map(bundle, texels=2.0)
    assert sum(image.name.count(" detail") for image in bpy.data.images) == 2


def of_levels(scene: TestScene) -> list[Finding]:
    return [finding for finding in check_scene(scene.scene) or () if finding.rule == "swatch_levels"]


def test_a_plane_to_the_horizon_is_built_with_levels(tmp_path: Path, registered: None) -> None:  # noqa: F811
    """Though the camera stands within the plane's bounding ball, and moves; what is near as a whole is not."""
    material = swatch_from(BakeResult(rough_bundle(tmp_path).path, {}, 0.0), None, pack=True)
    with from_afar(material, 10.0, 1.0) as scene:
        for size, kept in ((1.0, False), (500.0, True)):
            mesh = scene.sphere.data
            mesh.transform(Matrix.Scale(size, 4))
            for loop, vertex in zip(mesh.uv_layers[0].data, mesh.vertices, strict=True):
                loop.uv = vertex.co[:2]
            if kept:
                scene.scene.camera.keyframe_insert("location", frame=1)
            SHADING_MAP.refit(material, scene.scene)
            effects = {effect.name: effect for effect in effects_of(material)}
            assert effects[LEVELS_EFFECT].kept is kept, effects[LEVELS_EFFECT].why
            assert any("detail" in image.name for image in bpy.data.images) is kept
        # The check tells of a larger picture, and of a larger swatch, and mends both; a smaller one is merely finer.
        assert not of_levels(scene)
        for owner, name, larger in ((scene.scene.render, "resolution_x", 32), (swatch_mapping(material), "Scale", 0.2)):
            if name == "Scale":
                owner.inputs[name].default_value = (larger,) * 3
            else:
                owner.resolution_x = owner.resolution_y = larger
            (found,) = of_levels(scene)
            assert found.severity == WRONG and "times as large" in found.found and mend([found])
            assert not of_levels(scene)
        scene.scene.render.resolution_x = scene.scene.render.resolution_y = 16
        assert not of_levels(scene)
        scene.scene.camera.data.keyframe_insert("lens", frame=1)
        SHADING_MAP.refit(material, scene.scene)
        assert not next(effect for effect in effects_of(material) if effect.name == LEVELS_EFFECT).kept


# --- where they are worth it ----------------------------------------------------------------------------


def test_levels_follow_the_scene() -> None:
    far, some = Footprint(1.0, texels=0.4, farthest=50.0), SliceLayout(7, 64, 64)

    def planned(model: str, seen: Footprint = far, layout: SliceLayout = some, **asked: str) -> Effect:
        return plan_levels(
            Choices(detail=asked.get("detail", "auto")), model, layout, asked.get("tiling", "repeat"), seen
        )

    assert all(planned(model).kept for model in ("slices", "azimuth", "basis"))
    assert "up to 20 texels" in planned("slices").why
    assert "4.0 texels at most" in planned("slices", replace(far, farthest=10.0)).why
    moving = planned("slices", replace(far, farthest=float("inf")))
    assert moving.kept and "the camera moves" in moving.why
    refused = {
        "Always": planned("slices", detail="always"),
        "no mean": planned("power"),
        "border": planned("slices", tiling="extend"),
        "few": planned("slices", layout=SliceLayout(7, 15, 64)),
        "too large": planned("slices", layout=SliceLayout(7, 2048, 2048)),
        "wears it": planned("slices", Footprint(float("inf"), "no object of this scene wears it")),
    }
    assert not any(effect.kept for effect in refused.values())
    assert all(word in effect.why for word, effect in refused.items())
