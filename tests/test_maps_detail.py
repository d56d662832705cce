"""Maps of fewer texels keep the highlight's width: against the mean of the lobes themselves, and on a plane to the
horizon."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from measured_materials.addon.gantry.photograph_arc import photograph_view
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.bake import xp_numpy
from measured_materials.bake.errors import BakeError
from measured_materials.bake.maps.bake import MapSettings
from measured_materials.bake.maps.detail import filtered_roughness, reduced_maps
from measured_materials.bake.maps.folder import MapsFolder, read_maps_folder
from measured_materials.bake.maps.gloss import Gloss, half_vectors
from measured_materials.bake.maps.write import FileKind, Maps, write_maps
from measured_materials.nodes.principled_maps import build_principled
from support.known_maps import N, relief
from support.scenes import TestScene

ROUGHNESS, F0 = 0.4, 0.2


def fine(slope: float = 0.12, roughness: float = ROUGHNESS) -> Maps:
    """Random facets of a Gaussian of slopes: what a cloth or a grain is from far away."""
    p, q = np.random.default_rng(4).normal(0, slope, (2, N, N)) + np.array([0.1, -0.05])[:, None, None]
    normal = np.dstack([-p, -q, np.ones_like(p)])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    flat = np.ones((N, N), np.float32)
    return Maps(normal.astype(np.float32), relief()[2].astype(np.float32), 0 * flat, roughness * flat, F0 * flat)


def highlight(maps: Maps, tilts: np.ndarray) -> np.ndarray:
    """Mean gloss of the frame under lights whose half vectors lean by these degrees towards +x."""
    lean = np.radians(tilts)
    half = np.stack([np.sin(lean), 0 * lean, np.cos(lean)], -1)
    directions = 2 * half[:, 2:] * half - np.array([0, 0, 1])
    np.testing.assert_allclose(half_vectors(directions), half, atol=1e-9)
    told = np.ones(maps.height.shape, bool)
    return Gloss(maps.roughness, maps.reflectance, told).shown(directions, maps.normal).mean((1, 2))


def plain(maps: Maps, factor: int) -> Maps:
    """The means of normals and roughness, as a texture's mip levels are."""
    reduced = reduced_maps(maps, factor)
    roughness = maps.roughness[0, 0] + 0 * reduced.roughness
    return Maps(reduced.normal, reduced.albedo, reduced.height, roughness, reduced.reflectance)


@pytest.mark.parametrize("factor", [4, 16, 48])
def test_a_highlight_keeps_its_width_and_peak(factor: int) -> None:
    """A third of what plain means are off by: GGX of the same variance has a narrower middle and longer tails."""
    maps, tilts = fine(), np.linspace(-40, 40, 81)
    exact = highlight(maps, tilts)
    found, without = highlight(reduced_maps(maps, factor), tilts), highlight(plain(maps, factor), tilts)
    errors = [np.sqrt(np.mean((x - exact) ** 2)) / np.sqrt(np.mean(exact**2)) for x in (found, without)]
    assert errors[0] < 0.35 * errors[1]
    widths = [np.ptp(tilts[x > x.max() / 2]) for x in (exact, found, without)]
    assert widths[2] <= 0.6 * widths[0] < 0.65 * widths[0] < widths[1]
    assert 0.9 < found.max() / exact.max() < 1.4 and without.max() > 2 * exact.max()


def test_light_and_slope_stay() -> None:
    """Means of albedo and reflectance, of a side that is no multiple too; the mean slope; a flat swatch is as it is."""
    maps = fine()
    for factor in (5, 7):
        reduced = reduced_maps(maps, factor)
        assert reduced.normal.shape == (N // factor, N // factor, 3)
        np.testing.assert_allclose(reduced.albedo.mean((0, 1)), maps.albedo.mean((0, 1)), rtol=1e-4)
        assert reduced.reflectance.mean() == pytest.approx(F0, rel=1e-6)
        np.testing.assert_allclose(np.linalg.norm(reduced.normal, axis=-1), 1, atol=1e-6)
    mean = reduced_maps(maps, N).normal[0, 0]
    np.testing.assert_allclose(-mean[:2] / mean[2], [0.1, -0.05], atol=0.01)
    flat = fine(0.0)
    np.testing.assert_allclose(reduced_maps(flat, 8).roughness, ROUGHNESS, rtol=1e-3)
    assert reduced_maps(maps, 1) is maps
    with pytest.raises(BakeError, match="reduce: is 0"):
        MapSettings(reduce=0)


@pytest.mark.parametrize("slope", [0.0, 0.06, 0.12, 0.25])
def test_a_mean_normal_tells_its_variance(slope: float) -> None:
    """Roughness by the length of a mean normal is that of the texels as one."""
    maps = fine(slope)
    length = np.linalg.norm(maps.normal.mean((0, 1), dtype=np.float64))
    expected = reduced_maps(maps, N).roughness[0, 0]
    assert filtered_roughness(xp_numpy, ROUGHNESS, length) == pytest.approx(float(expected), rel=0.03)
    assert slope < 0.1 or filtered_roughness(xp_numpy, ROUGHNESS, length) > 1.05 * ROUGHNESS
    assert filtered_roughness(xp_numpy, 0.9, 0.0) == 1 and filtered_roughness(xp_numpy, 0.3, 1.001) == 0.3


def shown_roughness(maps: Maps, folder: Path, kind: FileKind, size: int, interpolation: str) -> np.ndarray:
    """What reaches the Principled BSDF of a filtered material, (size, size)."""
    material = build_principled(written(maps, folder, kind), relief="filtered", pack=True)
    tree = material.node_tree
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeTexImage":
            node.interpolation = interpolation
    closure = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    shining = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(closure.inputs["Roughness"].links[0].from_socket, shining.inputs["Strength"])
    tree.links.new(shining.outputs[0], tree.get_output_node("ALL").inputs["Surface"])
    return photograph_view(material, size=size, samples=4).mean(-1)


def test_the_material_is_rougher_where_normals_are_averaged(tmp_path: Path) -> None:
    """Stripes of two normals: between them a linear filter reads the mean, in the middle of each there is none."""
    lean, flat = 0.15, np.ones((4, 4), np.float32)
    p = np.where(np.arange(4) % 2, lean, -lean) + np.zeros((4, 4))
    normal = (np.dstack([-p, 0 * p, np.ones_like(p)]) / np.hypot(1, lean)).astype(np.float32)
    maps = Maps(normal, relief()[2][:4, :4].astype(np.float32), 0 * flat, 0.3 * flat, F0 * flat)
    found = shown_roughness(maps, tmp_path / "stripes", "exr", 128, "Linear").mean(0)
    expected = filtered_roughness(xp_numpy, 0.3, 1 / np.hypot(1, lean))
    assert expected > 1.25 * 0.3
    np.testing.assert_allclose((found[31:127:32] + found[32:128:32]) / 2, expected, rtol=0.01)
    np.testing.assert_allclose(found[15:128:32], 0.3, rtol=0.03)


@pytest.mark.parametrize("kind", ["exr", "png8"])
def test_normals_as_they_are_written_keep_their_roughness(tmp_path: Path, kind: FileKind) -> None:
    """Also those whose length eight bits have changed."""
    found = shown_roughness(fine(0.3, 0.2), tmp_path / "facets", kind, N, "Closest")
    np.testing.assert_allclose(found, 0.2, atol=0.5 / 255 if kind == "png8" else 1e-3)


def written(maps: Maps, folder: Path, kind: FileKind) -> MapsFolder:
    folder.mkdir()
    facts = {"program": "measured_materials maps", "source": folder.name, "mean_albedo": [0.0] * 3}
    (folder / "maps.json").write_text(json.dumps({**facts, "maps": write_maps(folder, maps, "opengl", kind)}))
    return read_maps_folder(folder)


def to_the_horizon(maps: Maps, folder: Path, samples: int) -> np.ndarray:
    """Rows (H,) of a plane with four swatches a metre, seen from a metre above towards a low sun, as far as it goes."""
    material = build_principled(written(maps, folder, "exr"), pack=True)
    mapping = next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (4, 4, 1)
    scene, mesh = bpy.data.scenes.new("horizon"), bpy.data.meshes.new("plane")
    corners = [(-100, -1, 0), (100, -1, 0), (100, 200, 0), (-100, 200, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    for loop, (x, y, _) in zip(mesh.uv_layers.new(name="UVMap").data, corners, strict=True):
        loop.uv = (x, y)
    mesh.materials.append(material)
    plane = bpy.data.objects.new("plane", mesh)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.angle = 0.01
    sun.matrix_world = Matrix.Rotation(np.radians(-60), 4, "X")
    view = bpy.data.objects.new("view", bpy.data.cameras.new("view"))
    view.data.angle, view.data.clip_end = np.radians(50), 500
    view.matrix_world = Matrix.Translation((0, 0, 1)) @ Matrix.Rotation(np.radians(68), 4, "X")
    for obj in (plane, sun, view):
        scene.collection.objects.link(obj)
    scene.camera = view
    scene.render.resolution_x, scene.render.resolution_y = 24, 48
    set_unbiased(scene, samples=samples, seed=0)
    with TestScene(scene, plane) as test:
        return test.render(samples, 1)[0].mean((1, 2))


@pytest.mark.slow
def test_a_plane_to_the_horizon_keeps_its_glitter_path(tmp_path: Path) -> None:
    """Black facets under a low sun: one texel a swatch shows about the path of all, its plain mean a mirror's."""
    maps = fine(roughness=0.25)
    maps = Maps(maps.normal, 0 * maps.albedo, maps.height, maps.roughness, maps.reflectance)
    exact = to_the_horizon(maps, tmp_path / "exact", 1024)
    found = to_the_horizon(reduced_maps(maps, N), tmp_path / "reduced", 256)
    without = to_the_horizon(plain(maps, N), tmp_path / "plain", 256)
    seen = exact > 1e-3 * exact.max()
    errors = [float(np.sqrt(np.mean((x - exact)[seen] ** 2) / np.mean(exact[seen] ** 2))) for x in (found, without)]
    assert errors[0] < 0.35 and errors[0] < 0.5 * errors[1]
    assert 0.7 < found.max() / exact.max() < 1 and without.max() > 1.9 * exact.max()
