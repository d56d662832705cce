"""What an artist does with a measured material's nodes, files and libraries is neither lost nor broken by a rebuild."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.material import bake_material, rebuild
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.textures.kept import image_nodes
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes.group import trees_below
from measured_materials.nodes.material import build_material
from support.scenes import diffuse_material, lit_sphere
from test_addon import registered  # noqa: F401

SETTINGS = BakeSettings(resolution=16, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("artist")
    paint = analytic.MetallicPaint(diffuse=(0.05, 0.1, 0.3), flake=(0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
    return bake_source(paint, folder / "paint", SETTINGS).path


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    yield
    bpy.ops.wm.read_homefile(use_empty=True)


def _material(path: Path, *, pack: bool) -> bpy.types.Material:
    return bake_material.material_from(BakeResult(path, read_bundle(path).material, 0.0), pack=pack)


def test_modes_of_a_saved_file_keep_its_textures(registered: None, bundle: Path, tmp_path: Path) -> None:  # noqa: F811
    """Paths are relative there, and textures lie beside the .blend rather than in it."""
    path = Path(shutil.copytree(bundle, tmp_path / "paint.mmat"))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    material = _material(path, pack=False)
    for mode in ("reference", "exact", "balanced", "exact"):
        material.measured_quality.mode = mode
        assert not material.measured_quality.problem
        images = [node.image for node in image_nodes(material.node_tree)]
        assert images and all(min(image.size) > 1 or image.name.startswith("MM") for image in images)
        found = {Path(bpy.path.abspath(image.filepath)).resolve().parent for image in images if image.filepath}
        assert found == {path.resolve()}


def test_a_group_inside_an_artists_group_is_rebuilt_there(registered: None, bundle: Path) -> None:  # noqa: F811
    """As Ctrl-G leaves it; nothing beside it is touched."""
    material = _material(bundle, pack=True)
    tree = material.node_tree
    node = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeGroup")
    artists = bpy.data.node_groups.new("Artist", "ShaderNodeTree")
    artists.interface.new_socket("BSDF", in_out="OUTPUT", socket_type="NodeSocketShader")
    inner = artists.nodes.new("ShaderNodeGroup")
    inner.node_tree = node.node_tree
    inner.inputs["Tint"].default_value = (0.5, 0.25, 1.0, 1)
    for key in node.keys():
        inner[key] = node[key]
    artists.links.new(inner.outputs["BSDF"], artists.nodes.new("NodeGroupOutput").inputs[0])
    target = node.outputs["BSDF"].links[0].to_socket
    tree.nodes.remove(node)
    outer, rust, mix = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Group", "BsdfPrincipled", "MixShader"))
    outer.node_tree = artists
    tree.links.new(outer.outputs[0], mix.inputs[1])
    tree.links.new(rust.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], target)
    before = sorted(n.name for n in tree.nodes)

    rebuild.rebuild_brdf(material, Choices(mode="reference"))
    assert sorted(n.name for n in tree.nodes) == before
    assert target.links[0].from_node == mix and mix.inputs[1].links[0].from_node == outer
    assert tuple(inner.inputs["Tint"].default_value) == (0.5, 0.25, 1.0, 1.0)
    assert rebuild.current_choices(material).mode == "reference"
    assert any("sampler" in node.image.name for node in image_nodes(artists))


def test_nodes_without_the_measured_group_are_left_alone(registered: None, bundle: Path) -> None:  # noqa: F811
    material = _material(bundle, pack=True)
    tree = material.node_tree
    tree.nodes.remove(next(n for n in tree.nodes if n.bl_idname == "ShaderNodeGroup"))
    tree.nodes.new("ShaderNodeBsdfPrincipled").name = "mine"
    before = sorted(n.name for n in tree.nodes)
    with pytest.raises(BakeError, match="no longer among its nodes"):
        rebuild.rebuild_brdf(material, Choices(mode="reference"))
    assert sorted(n.name for n in tree.nodes) == before


def test_a_local_material_needs_no_library(registered: None, bundle: Path, tmp_path: Path) -> None:  # noqa: F811
    """Groups equal to those of a linked material are made once more."""
    _material(bundle, pack=True).name = "linked"
    bpy.data.materials["linked"].use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.materials = ["linked"]
    assert bpy.data.materials["linked"].library
    material = _material(bundle, pack=True)
    assert not [tree.name for tree in trees_below(material.node_tree) if tree.library]


@pytest.mark.parametrize("degrees", [pytest.param(70, marks=pytest.mark.slow), 80])
def test_a_dark_material_against_the_sun(bundle: Path, tmp_path: Path, degrees: int) -> None:
    """Viewer and sun opposite each other and low: weights of 1e-6 are drawn where a metal's edge reflects half."""
    path = bake_source(analytic.Lambert((0.05, 0.05, 0.05)), tmp_path / "dark", SETTINGS).path
    material = build_material(read_bundle(path), mode="reference", lamps=lamp_image())
    with lit_sphere(diffuse_material((0.05, 0.05, 0.05)), 16, lamp=False, ground=False, resolution=24) as scene:
        scene.scene.world.node_tree.nodes.clear()
        theta = math.radians(degrees)
        mesh = scene.sphere.data
        plane = bpy.data.meshes.new("plane")
        plane.from_pydata([(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)], [], [(0, 1, 2, 3)])
        plane.materials.append(mesh.materials[0])
        scene.sphere.data = plane
        sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        sun.data.angle, sun.data.energy, sun.rotation_euler = math.radians(0.526), 3, (0, -theta, 0)
        scene.scene.collection.objects.link(sun)
        camera = scene.scene.camera
        camera.data.type, camera.data.ortho_scale = "ORTHO", 1
        camera.location = (10 * math.sin(theta), 0, 10 * math.cos(theta))
        camera.rotation_euler = (0, theta, 0)
        truth = scene.render(16, 1).mean()
        plane.materials[0] = material
        update_scene(scene.scene)
        found = scene.render(128, 6)
        means = found.reshape(len(found), -1).mean(-1)
        scene.sphere.data = mesh
    error = means.mean() / truth - 1
    # It was +3 % at 70 degrees and +18 % at 80 when a difference of 0.4 and 0.4 was to be 1e-6.
    assert abs(error) < 0.012 + 2 * means.std(ddof=1) / math.sqrt(len(means)) / truth, error
    assert np.isfinite(found).all()
