"""A swatch's texels in the camera's pixels, and the swatch of fewer texels that far ones become."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from measured_materials.addon.material.texel_footprint import texel_footprint
from measured_materials.bake.shading_maps.reduced_map import area_weights, reduced_slices
from measured_materials.bake.shading_maps.slice_atlas import SliceLayout, pack_slices, unpack_slices


@pytest.fixture
def view() -> Iterator[tuple[bpy.types.Scene, bpy.types.Object, bpy.types.Material]]:
    """A camera of 90 degrees, 100 pixels across, 50 units above a square of 2 units whose UVs are 0 to 1."""
    scene = bpy.data.scenes.new("view")
    scene.render.resolution_x = scene.render.resolution_y = 100
    mesh = bpy.data.meshes.new("plate")
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().uv.foreach_set("vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    material = bpy.data.materials.new("swatch")
    mesh.materials.append(material)
    plate = bpy.data.objects.new("plate", mesh)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.angle = np.pi / 2
    camera.matrix_world = Matrix.Translation((0, 0, 50))
    for obj in (plate, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    yield scene, plate, material
    for blocks in (bpy.data.objects, bpy.data.meshes, bpy.data.cameras, bpy.data.materials):
        for block in list(blocks):
            blocks.remove(block)
    bpy.data.scenes.remove(scene)


def test_pixels_of_a_texel(view: tuple) -> None:
    """At 50 units 1 unit has 1 pixel; the nearest corner of the bounding ball is 1.41 units nearer."""
    scene, plate, material = view
    found = texel_footprint(material, scene, (10, 10))
    assert found.pixels == pytest.approx(0.2 * 50 / (50 - np.sqrt(2)), rel=1e-3)
    plate.matrix_world = Matrix.Diagonal((3, 1, 1, 1))  # the stretched side counts
    assert texel_footprint(material, scene, (10, 10)).pixels == pytest.approx(0.6 * 50 / (50 - np.sqrt(10)), rel=1e-3)


def test_a_pixel_of_the_corners_is_the_narrowest(view: tuple) -> None:
    """Of a lens of 90 degrees it spans a third of what one in the middle does, at the end of a ray of equal length."""
    scene, _, material = view
    found = texel_footprint(material, scene, (10, 10))
    assert found.texels == pytest.approx(1 / (0.2 * 50) / 3, rel=1e-3)
    assert found.farthest == pytest.approx(50 + np.sqrt(2), rel=1e-3)
    scene.camera.data.shift_x = 0.5  # one corner is then twice as far to the side
    assert texel_footprint(material, scene, (10, 10)).texels == pytest.approx(1 / (0.2 * 50) / 6, rel=1e-3)
    scene.camera.data.shift_x, scene.camera.data.angle = 0.0, 0.01
    assert texel_footprint(material, scene, (10, 10)).texels == pytest.approx(np.tan(0.005) / (0.2 * 50), rel=1e-3)


def test_an_orthographic_camera_has_no_distance(view: tuple) -> None:
    scene, _, material = view
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 20.0
    assert texel_footprint(material, scene, (10, 10)).pixels == pytest.approx(1.0, rel=1e-3)


def test_the_nearest_object_counts(view: tuple) -> None:
    """The scene in which leaving texels out would be wrong: one plate is far away, its copy is not."""
    scene, plate, material = view
    near = plate.copy()
    near.location = (0, 0, 45)
    scene.collection.objects.link(near)
    assert texel_footprint(material, scene, (10, 10)).pixels > 2


def test_what_cannot_be_known_keeps_the_texels(view: tuple) -> None:
    scene, plate, material = view
    assert texel_footprint(material, scene, None).why_unknown
    nothing = texel_footprint(material, scene, (0.0, 10.0))
    assert nothing.pixels == np.inf and "scaled to nothing" in nothing.why_unknown
    scene.camera.keyframe_insert("location", frame=1)
    assert texel_footprint(material, scene, (10, 10)).why_unknown == "the camera moves or zooms"
    scene.camera.animation_data_clear()
    scene.camera.data.type = "PANO"
    assert "flat picture" in texel_footprint(material, scene, (10, 10)).why_unknown
    scene.camera.data.type = "PERSP"
    plate.data.uv_layers.remove(plate.data.uv_layers[0])
    plate.data.update()
    assert "no UV map" in texel_footprint(material, scene, (10, 10)).why_unknown
    plate.data.materials.clear()
    assert "no object" in texel_footprint(material, scene, (10, 10)).why_unknown
    scene.camera = None
    assert texel_footprint(material, scene, (10, 10)).pixels == np.inf


@pytest.mark.parametrize("n, m", [(8, 2), (10, 3), (7, 7), (5, 1)])
def test_area_weights_average(n: int, m: int) -> None:
    weights = area_weights(n, m)
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-12)
    np.testing.assert_allclose(weights.sum(0), m / n, atol=1e-12)
    if n % m == 0:
        np.testing.assert_allclose(weights @ np.arange(n), np.arange(n).reshape(m, -1).mean(1))


def test_means_of_slices_keep_the_sum_of_envelope_and_residual() -> None:
    rng = np.random.default_rng(1)
    tiles, envelope = rng.random((3, 20, 14, 3), np.float32), rng.random((20, 14, 4), np.float32)
    layout = SliceLayout(3, 20, 14)
    residual, m, small = reduced_slices(pack_slices(tiles), envelope, layout, 4)
    assert (small.height, small.width) == (5, 3) and m.shape == (5, 3, 4)
    found = unpack_slices(residual, small)
    np.testing.assert_allclose(found.mean((1, 2)), tiles.mean((1, 2)), rtol=1e-5)
    np.testing.assert_allclose(
        found[1] + m[..., :3],
        reduced_slices(pack_slices(tiles + envelope[..., :3]), envelope, layout, 4)[0].reshape(3, -1, 3, 3)[1, 4:9],
        rtol=1e-5,
    )
    assert reduced_slices(pack_slices(tiles), envelope, layout, 1 << 10)[2] == SliceLayout(3, 1, 1)
