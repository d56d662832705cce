"""Procedural swatches: seamless, without holes, equal every time, about height 0."""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy
import numpy as np
import pytest
from measured_materials.addon.gantry.photograph_arc import Gantry, gantry_scene
from measured_materials.addon.gantry.swatches import SWATCHES, Swatch, periodic, surfaces
from measured_materials.addon.studio import studio
from measured_materials.bake.lobes.lobes import Lobe

Array = np.ndarray
SIZE = 64


def meshes(swatch: Swatch) -> list[Array]:
    """Points of the objects, which are deleted again."""
    with gantry_scene(swatch, size=1, samples=1) as gantry:
        return [points for points, _ in geometry(gantry)]


def geometry(gantry: Gantry) -> list[tuple[Array, int]]:
    found = []
    for obj in gantry.tile_objects:
        points = np.empty(len(obj.data.vertices) * 3, np.float32)
        obj.data.vertices.foreach_get("co", points)
        found.append((points.reshape(-1, 3), len(obj.data.polygons)))
    return found


@pytest.mark.parametrize("name", SWATCHES)
def test_swatch(name: str) -> None:
    swatch = SWATCHES[name](1)
    assert swatch.name == name and swatch.description
    assert Lobe.of(swatch.lobe, **swatch.lobe_parameters).name == swatch.lobe
    before = len(bpy.data.meshes), len(bpy.data.materials)
    with gantry_scene(swatch, size=SIZE, samples=4) as gantry:
        parts = geometry(gantry)
        points = np.concatenate([points for points, _ in parts])
        assert np.isfinite(points).all()
        assert 50_000 < sum(faces for _, faces in parts) < 600_000
        assert 0.5 * swatch.height < np.ptp(points[:, 2]) < 1.5 * swatch.height
        # Half the yarns of a weave lie below, but a view from the side must turn about what one sees.
        assert abs(np.median(points[:, 2])) < swatch.height / 2
        assert (points[:, :2] > -0.3).all() and (points[:, :2] < 1.3).all()
        assert_no_holes(gantry)
        assert_answers_light(gantry, swatch)
    assert (len(bpy.data.meshes), len(bpy.data.materials)) == before


def assert_no_holes(gantry: Gantry) -> None:
    gantry.scene.render.film_transparent = True
    gantry.set_light(0, 0)
    for view in ((0, 0), (math.radians(55), 0.8)):
        gantry.set_view(*view)
        assert (studio.render_rgba(gantry.scene)[..., 3] == 1).all()
    gantry.scene.render.film_transparent = False


def assert_answers_light(gantry: Gantry, swatch: Swatch) -> None:
    gantry.set_view(0, 0)
    means = []
    for elevation in (80, 45, 15):
        gantry.set_light(math.radians(90 - elevation), 0)
        picture = gantry.render()
        assert np.isfinite(picture).all() and picture.min() >= 0
        means.append(picture.mean(axis=(0, 1)))
        assert_seamless(picture)
    assert (means[0] > means[1]).all() and (means[1] > means[2]).all() and means[2].min() > 0
    # A matte surface of albedo 1 shows 1 / pi; flat gloss under a high sun shows more.
    assert means[0].max() < (1 if swatch.lobe == "phong" else 1 / math.pi)
    assert picture.std() > 0.1 * picture.mean()  # relief


def assert_seamless(picture: Array) -> None:
    """Opposite borders differ as neighbouring columns and rows inside do."""
    for axis in (0, 1):
        other = 1 - axis
        steps = np.abs(np.diff(picture, axis=axis)).mean(axis=(other, 2))
        across = np.abs(picture.take(0, axis) - picture.take(-1, axis)).mean()
        # The border of a weave runs between two yarns, where the steps are largest and vary by a quarter.
        assert across < 1.5 * steps.max()


@pytest.mark.parametrize("name", ["suede", "jeans"])
def test_seed_decides_everything(name: str) -> None:
    first, again, other = (meshes(SWATCHES[name](seed)) for seed in (3, 3, 4))
    assert all(np.array_equal(a, b) for a, b in zip(first, again))
    assert not all(np.array_equal(a, b) for a, b in zip(first, other))


# --- fields and surfaces --------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [periodic.smooth_noise, periodic.fractal_noise])
def test_noise_is_normal_and_without_seam(make: Callable) -> None:
    field = make(np.random.default_rng(0), 64, 0.2)
    assert abs(field.mean()) < 1e-12 and abs(field.std() - 1) < 1e-12
    steps = np.abs(np.diff(field, axis=1)).mean(axis=0)
    assert np.abs(field[:, 0] - field[:, -1]).mean() < 1.2 * steps.max()


def test_sample_meets_the_texels_and_repeats() -> None:
    field = np.random.default_rng(1).random((5, 5))
    u, v = periodic.grid(5)
    for shift in (0, 1, -2):
        np.testing.assert_allclose(periodic.sample(field, u + shift, v - shift), field, atol=1e-12)
    between = periodic.sample(field, np.array(0.9), np.array(0.0))
    np.testing.assert_allclose(between, (field[0, 4] + field[0, 0]) / 2, atol=1e-12)


def test_cells_agree_with_a_search_over_all_points() -> None:
    count, places = 6, np.random.default_rng(2).random((2, 500))
    cells = periodic.voronoi(np.random.default_rng(3), count, *places)
    # The points, found where the offset from them says.
    points = {}
    for k, index in enumerate(cells.index):
        points.setdefault(int(index), (places[:, k] - cells.offset[k]) % 1)
    away = np.array([points[index] for index in sorted(points)])[:, None] - places.T
    distances = np.sort(np.linalg.norm(away - np.round(away), axis=-1), axis=0)
    assert len(points) == count**2
    np.testing.assert_allclose(cells.nearest, distances[0], atol=1e-12)
    np.testing.assert_allclose(cells.second, distances[1], atol=1e-12)


def test_domes_follow_the_nearest_point() -> None:
    u, v = periodic.grid(40)
    nearest = periodic.voronoi(np.random.default_rng(3), 5, u, v).nearest
    # Several terms of the sum only ever raise it, by log(n) / sharpness for n equal ones.
    raised = periodic.domes(np.random.default_rng(3), 5, u, v, 50.0) + (5 * nearest) ** 2
    assert raised.min() > -1e-9 and raised.max() < math.log(4) / 50


def test_height_field_has_the_slopes_of_its_formula() -> None:
    u, _ = periodic.grid(256)
    surface = surfaces.height_field(0.02 * np.sin(2 * np.pi * u), np.ones(3))
    u, normals = surface.points[:, 0], surface.normals
    slope = 0.02 * 2 * np.pi * np.cos(2 * np.pi * u)
    np.testing.assert_allclose(-normals[:, 0] / normals[:, 2], slope, atol=2e-5)
    assert len(surface.quads) == 256**2


def test_tubes_keep_their_distance_from_the_polyline() -> None:
    t = np.linspace(0, 3, 80)
    helix = np.stack([np.cos(t), np.sin(t), 0.3 * t], -1)[None]
    tube = surfaces.tubes(helix, 0.05, np.ones(3), sides=6)
    ring = tube.points.reshape(80, 6, 3) - helix[0][:, None]
    np.testing.assert_allclose(np.linalg.norm(ring, axis=-1), 0.05, rtol=1e-9)
    # Faces look outwards: their normals point away from the polyline.
    corners = tube.points[tube.quads]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = np.repeat((helix[0][:-1] + helix[0][1:]) / 2, 6, axis=0)
    assert ((corners.mean(axis=1) - middle) * normal).sum(-1).min() > 0
