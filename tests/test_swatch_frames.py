"""Frames of swatches over azimuth: one for each, in blends, past reroutes, and beside an artist's own vectors."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
from measured_materials.addon.material.adjust.blend import blend_with, remove_blend
from measured_materials.addon.material.adjust.swatch import random_tiling_node, set_random_tiling, swatch_mapping
from measured_materials.addon.scene_check.check import mend
from measured_materials.nodes.second_group import second_node
from measured_materials.nodes.shading_map_material import build_shading_map
from measured_materials.nodes.surface_inputs import coordinates_before_tiling, frame_before, source_of
from measured_materials.nodes.swatch_frame_group import ALONG_U, ALONG_V
from support.azimuth import write_azimuth_bundle
from support.clean_blend import clean_blend  # noqa: F401
from support.scenes import lit_sphere
from support.swatches import map_bundle, rough_map
from test_azimuth_material import LIT, basis_of, found_in, group_of


def dome(path: Path, name: str, turned: float = 0.0) -> bpy.types.Material:
    """A swatch lit from every side that is turned by so much."""
    material = build_shading_map(write_azimuth_bundle(path / f"{name}.mmat", basis_of(), LIT))
    swatch_mapping(material).inputs["Rotation"].default_value[2] = turned
    return material


def lies_by_its_own(node: bpy.types.Node) -> bool:
    frame = frame_before(node)
    return frame is not None and source_of(frame.inputs["UV"]) == coordinates_before_tiling(node)


def blended(path: Path) -> tuple[bpy.types.Material, bpy.types.Node, bpy.types.Node]:
    """Two swatches in one tree, the second turned; the nodes that hold their groups."""
    material = dome(path, "first")
    blend_with(material, dome(path, "second", 1.0))
    return material, group_of(material), second_node(material.node_tree)


def test_each_of_two_blended_swatches_has_its_frame(tmp_path: Path) -> None:
    material, first, second = blended(tmp_path)
    assert lies_by_its_own(first) and lies_by_its_own(second)
    assert frame_before(first) != frame_before(second)
    assert coordinates_before_tiling(second).node.inputs["Rotation"].default_value[2] == 1.0
    remove_blend(material)
    assert lies_by_its_own(first)
    assert len(material.node_tree.nodes) == len(dome(tmp_path, "other").node_tree.nodes)


def test_a_frame_that_two_swatches_share_is_told_and_parted(tmp_path: Path) -> None:
    """As blends of older files have it: the first lies by the coordinates of the second."""
    material, first, second = blended(tmp_path)
    tree, shared = material.node_tree, frame_before(second)
    for name in (ALONG_U, ALONG_V):
        tree.links.new(shared.outputs[name], first.inputs[name])
    with lit_sphere(material, 16, resolution=16) as scene:
        assert mend([found_in(scene)["swatch_frame_apart"]]) and not found_in(scene)
    assert lies_by_its_own(first) and lies_by_its_own(second) and frame_before(second) == shared


def test_a_second_that_becomes_one_over_azimuth_gets_its_frame(tmp_path: Path) -> None:
    """By *Bake Again* of its own material. Without it the check tells, though the node is not the material's own."""
    arc = build_shading_map(map_bundle(tmp_path / "arc", rough_map(), LIT))
    material = dome(tmp_path, "first")
    before = len(material.node_tree.nodes)
    blend_with(material, arc)
    second = second_node(material.node_tree)
    assert ALONG_U not in second.inputs
    build_shading_map(write_azimuth_bundle(tmp_path / "again.mmat", basis_of(), LIT), arc)
    assert lies_by_its_own(second) and lies_by_its_own(group_of(material))
    with lit_sphere(material, 16, resolution=16) as scene:
        assert not found_in(scene)
        material.node_tree.nodes.remove(frame_before(second))
        gone = found_in(scene)["swatch_frame"]
        assert gone.found == "nothing is linked to Along U and Along V"
        assert mend([gone]) and not found_in(scene) and lies_by_its_own(second)
    remove_blend(material)
    assert len(material.node_tree.nodes) == before


def rerouted(socket: bpy.types.NodeSocket) -> None:
    """Put a reroute before an input."""
    tree, source = socket.id_data, socket.links[0].from_socket
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(source, reroute.inputs[0])
    tree.links.new(reroute.outputs[0], socket)


@pytest.mark.parametrize("tiled", [False, True], ids=["plain", "tiled at random"])
def test_reroutes_change_nothing(tmp_path: Path, tiled: bool) -> None:
    material = dome(tmp_path, "swatch")
    node = group_of(material)
    set_random_tiling(material, tiled)
    frame, count = frame_before(node), len(material.node_tree.nodes)
    places = [node.inputs["UV"], frame.inputs["UV"], *(node.inputs[name] for name in (ALONG_U, ALONG_V))]
    if tiled:
        places.append(random_tiling_node(material).inputs["UV"])
    for socket in places:
        rerouted(socket)
    assert (random_tiling_node(material) is not None) == tiled
    assert coordinates_before_tiling(node).node == swatch_mapping(material) and frame_before(node) == frame
    with lit_sphere(material, 16, resolution=16) as scene:
        assert not found_in(scene)
        material.node_tree.links.remove(node.inputs[ALONG_V].links[0])
        assert mend([found_in(scene)["swatch_frame"]]) and not found_in(scene)
    assert frame_before(node) == frame and len(material.node_tree.nodes) == count + len(places)


def test_an_own_vector_stays_where_the_other_is_loose(tmp_path: Path) -> None:
    material = dome(tmp_path, "swatch")
    tree, node = material.node_tree, group_of(material)
    own = tree.nodes.new("ShaderNodeTangent")
    tree.links.new(own.outputs[0], node.inputs[ALONG_U])
    tree.links.remove(node.inputs[ALONG_V].links[0])
    with lit_sphere(material, 16, resolution=16) as scene:
        gone = found_in(scene)["swatch_frame"]
        assert gone.found == "nothing is linked to Along V"
        assert mend([gone]) and not found_in(scene)
    assert source_of(node.inputs[ALONG_U]).node == own
    assert source_of(source_of(node.inputs[ALONG_V]).node.inputs["UV"]).node == swatch_mapping(material)
