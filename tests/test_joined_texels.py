"""Texels of a swatch that were joined for good, where the camera has come nearer since: the scene check tells of it."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
from mathutils import Matrix
from measured_materials.addon.material.bake_photographs import swatch_from
from measured_materials.addon.material.kinds import SHADING_MAP
from measured_materials.addon.material.rebuild import rendering_of
from measured_materials.addon.material.scene_fit import LEVELS_EFFECT
from measured_materials.addon.material.texel_footprint import units_seen
from measured_materials.addon.scene_check import swatch_rules
from measured_materials.addon.scene_check.check import check_scene, mend
from measured_materials.addon.scene_check.findings import WRONG, Finding, subject_of
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.nodes.surface_inputs import SWATCH_MAPPING
from support.scenes import TestScene
from test_addon import registered  # noqa: F401
from test_detail_levels import from_afar, rough_bundle


def of_texels(scene: TestScene) -> list[Finding]:
    return [finding for finding in check_scene(scene.scene) or () if finding.rule == "swatch_texels"]


def test_a_camera_that_comes_nearer_is_told_of_where_texels_were_joined(tmp_path: Path, registered: None) -> None:
    material = swatch_from(BakeResult(rough_bundle(tmp_path).path, {}, 0.0), None, pack=True)
    with from_afar(material, 400.0, 1.0) as scene:
        camera, render = scene.scene.camera, scene.scene.render

        def fitted() -> float:
            camera.location.z, scene.sphere.scale = 400, (1, 1, 1)
            render.resolution_x = render.resolution_y = 16
            SHADING_MAP.refit(material, scene.scene)
            return rendering_of(material).joined

        assert fitted() > 0 and not of_texels(scene)
        # A texel of eighths of a pixel was joined by twos or more, up to half a pixel: nearer than that it is seen.
        camera.location.z = 800
        assert not of_texels(scene)
        for nearer in ("distance", "size", "picture"):
            if nearer == "distance":
                camera.location.z = 40
            elif nearer == "size":
                scene.sphere.scale = (10, 1, 1)
            else:
                render.resolution_x = render.resolution_y = 160
            (found,) = of_texels(scene)
            assert found.severity == WRONG and "times as large as may be joined" in found.found
            assert mend([found]) and not of_texels(scene), nearer
            fitted()
        camera.keyframe_insert("location", frame=1)
        (found,) = of_texels(scene)
        assert "joined, and the camera moves" in found.found
        assert mend([found]) and not rendering_of(material).joined and not of_texels(scene)


def test_it_is_told_at_the_distance_at_which_it_is_seen(tmp_path: Path, registered: None) -> None:
    """Between the last distance that asks for the same texels and one a fifth nearer than the nearest of it."""
    material = swatch_from(BakeResult(rough_bundle(tmp_path).path, {}, 0.0), None, pack=True)
    with from_afar(material, 400.0, 1.0) as scene:
        SHADING_MAP.refit(material, scene.scene)
        told = []
        for distance in (400 / 1.15**k for k in range(12)):
            scene.scene.camera.location.z = distance
            told.append((distance, bool(of_texels(scene))))
        first = next(distance for distance, yes in told if yes)
        scene.scene.camera.location.z = first * 1.15 * 1.1
        before = rendering_of(material).joined
        SHADING_MAP.refit(material, scene.scene)
        again = rendering_of(material).joined
        assert abs(again / before - 1) < 0.02
        scene.scene.camera.location.z = first / 1.05
        SHADING_MAP.refit(material, scene.scene)
        assert rendering_of(material).joined > 1.5 * before


def test_a_check_goes_on_where_texture_coordinates_are_scaled_to_nothing(tmp_path: Path, registered: None) -> None:
    """As while the scale of the mapping is dragged through 0."""
    material = swatch_from(BakeResult(rough_bundle(tmp_path).path, {}, 0.0), None, pack=True)
    with from_afar(material, 400.0, 1.0) as scene:
        SHADING_MAP.refit(material, scene.scene)
        assert rendering_of(material).joined
        mapping = next(node for node in material.node_tree.nodes if node.label == SWATCH_MAPPING)
        mapping.inputs["Scale"].default_value = (0, 1, 1)
        assert check_scene(scene.scene) is not None
        SHADING_MAP.refit(material, scene.scene)
        assert not rendering_of(material).joined


def test_what_is_scaled_to_nothing_keeps_its_texels(tmp_path: Path, registered: None) -> None:
    """It may be made as large as anything."""
    material = swatch_from(BakeResult(rough_bundle(tmp_path).path, {}, 0.0), None, pack=True)
    with from_afar(material, 400.0, 1.0) as scene:
        scene.sphere.scale = (0, 0, 0)
        SHADING_MAP.refit(material, scene.scene)
        assert not rendering_of(material).joined
        effects = {effect.name: effect for effect in rendering_of(material).effects}
        assert effects["Texels"].kept and "scaled to nothing" in effects["Texels"].why
        assert not effects[LEVELS_EFFECT].kept
        scene.sphere.scale = (1, 1, 1)
        SHADING_MAP.refit(material, scene.scene)
        assert rendering_of(material).joined


def test_no_more_is_told_than_is_seen(tmp_path: Path, registered: None) -> None:
    """Of two meshes either may come nearer; a scale that is applied or an object that is hidden changes no picture."""
    material = swatch_from(BakeResult(rough_bundle(tmp_path).path, {}, 0.0), None, pack=True)
    with from_afar(material, 400.0, 1.0) as scene:
        plane, mesh = scene.sphere, scene.sphere.data.copy()
        mesh.transform(Matrix.Scale(0.01, 4))
        small = bpy.data.objects.new("small", mesh)
        small.scale, small.location = (100, 100, 100), (3, 0, 0)
        scene.scene.collection.objects.link(small)
        SHADING_MAP.refit(material, scene.scene)
        assert rendering_of(material).joined and not of_texels(scene)
        for either, other in ((plane, small), (small, plane)):
            either.location.z = 380
            (found,) = of_texels(scene)
            assert "times as large" in found.found, either.name
            other.hide_set(True, view_layer=scene.scene.view_layers[0])
            assert of_texels(scene), either.name
            other.hide_set(False, view_layer=scene.scene.view_layers[0])
            either.hide_set(True, view_layer=scene.scene.view_layers[0])
            assert not of_texels(scene), either.name
            either.hide_set(False, view_layer=scene.scene.view_layers[0])
            either.location.z = 0
        mesh.transform(Matrix.Scale(100, 4))
        small.scale = (1, 1, 1)
        assert not of_texels(scene)
        small.location.z = 380
        assert of_texels(scene)
        plane.data.transform(Matrix.Scale(0.01, 4))
        plane.scale, small.location.z = (100, 100, 100), 0
        assert not of_texels(scene)
        scene.scene.camera.data.type = "PANO"
        assert not of_texels(scene)
        bpy.data.objects.remove(small)
        bpy.data.meshes.remove(mesh)


def test_instances_are_looked_at_once(tmp_path: Path, registered: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of however many materials, and not at all where no texels were joined; what is instanced nearer is told of."""
    bundle = rough_bundle(tmp_path)
    first, second = (swatch_from(BakeResult(bundle.path, {}, 0.0), None, pack=True) for _ in range(2))
    asked: list[int] = []
    monkeypatch.setattr(
        swatch_rules,
        "units_seen",
        lambda scene, materials: asked.append(len(materials)) or units_seen(scene, materials),
    )
    with from_afar(first, 400.0, 1.0) as scene:
        other = bpy.data.objects.new("other", scene.sphere.data.copy())
        other.data.materials[0] = second
        scene.scene.collection.objects.link(other)
        assert check_scene(scene.scene) is not None and not asked
        for material in (first, second):
            SHADING_MAP.refit(material, scene.scene)
        assert not of_texels(scene) and asked == [2]
        group = bpy.data.collections.new("group")
        group.objects.link(other)
        near = bpy.data.objects.new("near", None)
        near.instance_type, near.instance_collection, near.location.z = "COLLECTION", group, 380
        scene.scene.collection.objects.link(near)
        (found,) = of_texels(scene)
        assert found.where == f"material {second.name}" and "times as large" in found.found and asked == [2, 2]
        bpy.data.batch_remove([near, group, other.data, other])


def test_what_geometry_nodes_scatter_is_looked_at_too(tmp_path: Path, registered: None) -> None:
    """Several meshes of one owner, of objects that no collection of the scene holds."""
    bundle = rough_bundle(tmp_path)
    first, second = (swatch_from(BakeResult(bundle.path, {}, 0.0), None, pack=True) for _ in range(2))
    with from_afar(first, 400.0, 1.0) as scene:
        SHADING_MAP.refit(first, scene.scene)
        held = [bpy.data.objects.new("held", scene.sphere.data.copy()) for _ in range(2)]
        held[1].data.materials[0] = second
        tree = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        join, output = tree.nodes.new("GeometryNodeJoinGeometry"), tree.nodes.new("NodeGroupOutput")
        for obj in held:
            shown = tree.nodes.new("GeometryNodeObjectInfo")
            shown.inputs["Object"].default_value, shown.inputs["As Instance"].default_value = obj, True
            tree.links.new(shown.outputs["Geometry"], join.inputs[0])
        tree.links.new(join.outputs[0], output.inputs[0])
        owner = bpy.data.objects.new("owner", bpy.data.meshes.new("owner"))
        owner.modifiers.new("scatter", "NODES").node_group = tree
        scene.scene.collection.objects.link(owner)
        assert set(subject_of(scene.scene).wearers) == {first, second}
        (found,) = of_texels(scene)
        assert found.where == f"material {first.name}" and "joined, and owner moves" in found.found
        bpy.data.batch_remove([owner.data, owner, tree, *(obj.data for obj in held), *held])
