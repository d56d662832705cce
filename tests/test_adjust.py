"""The Adjust panel's sockets, nodes and words: what stays in a rebuild, what comes of older files, what is told."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.material.adjust.energy import energy_of, saturated
from measured_materials.addon.material.adjust.relief import add_bump, add_normal_map, relief_nodes
from measured_materials.addon.material.adjust.swatch import (
    WIDTH_KEY,
    lay_out,
    metres_per_uv,
    random_tiling_node,
    set_random_tiling,
    swatch_mapping,
)
from measured_materials.addon.material.build_shading_map import texels_per_uv
from measured_materials.addon.material.facts import facts_of, keep_facts, record_of
from measured_materials.addon.material.rebuild import rebuild_brdf, relight
from measured_materials.addon.scene_check.check import check_scene, mend
from measured_materials.addon.ui.panels.adjust_rows import AdjustPanel
from measured_materials.bake.errors import BakeError
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.nodes import compat, expr
from measured_materials.nodes.adjustments import LIMITS, NEUTRAL, SOCKETS, WORDS
from measured_materials.nodes.exchanged_group import exchange_group
from measured_materials.nodes.group import node_group
from measured_materials.nodes.material_tree import measured_nodes
from support.coarse_bakes import coarse  # noqa: F401
from test_addon import Stage, known_bakes, lacquer, registered  # noqa: F401
from test_addon_arc import felt, stack  # noqa: F401


def node_of(material: Any) -> Any:
    """The node that holds the measured group."""
    return measured_nodes(material.node_tree)[0][1]


def square(obj: Any, side: float = 2.0) -> None:
    """Give an object one face of this side whose UVs are the unit square."""
    obj.data.clear_geometry()
    corners = [(0, 0, 0), (side, 0, 0), (side, side, 0), (0, side, 0)]
    obj.data.from_pydata(corners, [], [(0, 1, 2, 3)])
    obj.data.uv_layers.new().uv.foreach_set("vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))


# --- sockets ----------------------------------------------------------------------------------------------


def test_sockets_start_neutral_and_have_limits(lacquer: Any, felt: Any) -> None:
    for material in (lacquer, felt):
        node = node_of(material)
        for name, kind in SOCKETS.items():
            value = node.inputs[name].default_value
            assert (tuple(value) if kind == "color" else value) == NEUTRAL[name]
        items = {item.name: item for item in node.node_tree.interface.items_tree if item.in_out == "INPUT"}
        assert items["Tint"].socket_type == "NodeSocketColor"
        assert all(item.description == WORDS[name] for name, item in items.items())
        for name, (least, most) in LIMITS.items():
            if name not in items:  # Gloss, of BRDFs alone
                continue
            assert (items[name].min_value, items[name].max_value) == pytest.approx((least, most))


def older_group(material: Any) -> Any:
    """A group like that of the version before: Tint was a vector, and there was nothing else to adjust."""
    new = node_of(material).node_tree
    inputs = {"Normal": "vector", "Tint": "vector"}
    if "UV" in node_of(material).inputs:
        inputs |= {"UV": "vector", "Light Level": "float"}
    outputs = {item.name: "shader" for item in new.interface.items_tree if item.in_out == "OUTPUT"}

    def nothing(*_: Any) -> Any:
        made = expr.Scalar(expr.node("ShaderNodeBsdfDiffuse", {}, {}).outputs[0])
        return tuple(made for _ in outputs) if len(outputs) > 1 else made

    return node_group("Older", inputs, outputs, nothing)


def test_the_vector_of_an_older_file_becomes_the_colour(lacquer: Any) -> None:
    """Its value, its link, its keyframes and drivers."""
    tree, node = lacquer.node_tree, node_of(lacquer)
    exchange_group(tree, node, older_group(lacquer))
    assert node.inputs["Tint"].type == "VECTOR" and list(node.inputs.keys()) == ["Normal", "Tint"]
    node.inputs["Tint"].default_value = (0.9, 0.5, 0.25)
    for frame, value in ((1, 0.25), (20, 0.75)):
        node.inputs["Tint"].default_value[2] = value
        node.inputs["Tint"].keyframe_insert("default_value", index=2, frame=frame)
    node.inputs["Tint"].driver_add("default_value", 0).driver.expression = "0.25 + 0.125"
    rebuild_brdf(lacquer)
    node = node_of(lacquer)
    assert node.inputs["Tint"].type == "RGBA"
    assert tuple(node.inputs["Tint"].default_value)[1::2] == (0.5, 1.0)  # the others are driven and keyed
    for frame, value in ((1, 0.25), (20, 0.75)):
        bpy.context.scene.frame_set(frame)
        found = _evaluated(lacquer).inputs["Tint"]
        assert found.default_value[2] == pytest.approx(value) and found.default_value[0] == pytest.approx(0.375)
    bpy.context.scene.frame_set(1)


def _evaluated(material: Any) -> Any:
    """The measured node as a render at this frame sees it."""
    graph = bpy.context.evaluated_depsgraph_get()
    return node_of(material.evaluated_get(graph))


def test_a_linked_vector_stays_linked(lacquer: Any) -> None:
    tree, node = lacquer.node_tree, node_of(lacquer)
    exchange_group(tree, node, older_group(lacquer))
    texture = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(texture.outputs["Color"], node.inputs["Tint"])
    rebuild_brdf(lacquer)
    assert node_of(lacquer).inputs["Tint"].links[0].from_node == texture


def test_a_rebuild_keeps_values_links_and_keyframes(lacquer: Any) -> None:
    """Whichever mode it is rebuilt in."""
    tree, node = lacquer.node_tree, node_of(lacquer)
    node.inputs["Tint"].default_value, node.inputs["Brightness"].default_value = (0.5, 0.25, 0.75, 1), 0.7
    texture = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(texture.outputs[0], node.inputs["Saturation"])
    node.inputs["Brightness"].keyframe_insert("default_value", frame=1)
    before = node.node_tree.name
    choices = lacquer.measured_quality
    choices.filter = "nearest"
    node = node_of(lacquer)
    assert not choices.problem and node.node_tree.name != before
    assert tuple(node.inputs["Tint"].default_value) == (0.5, 0.25, 0.75, 1)
    assert node.inputs["Brightness"].default_value == pytest.approx(0.7)
    assert node.inputs["Saturation"].links[0].from_node == texture
    (curve,) = compat.curves_of(tree.animation_data.action, getattr(tree.animation_data, "action_slot", None))
    assert tree.path_resolve(curve.data_path.removesuffix(".default_value")) == node.inputs["Brightness"]


def test_keyframes_follow_an_input_that_moves(felt: Any) -> None:
    """They know it by its number alone; those of other nodes, of which one has a like name, stay."""
    tree, node = felt.node_tree, node_of(felt)
    node.inputs["Light Level"].keyframe_insert("default_value", frame=1)
    node.inputs["Saturation"].driver_add("default_value").driver.expression = "0.5"
    other = tree.nodes.new("ShaderNodeGroup")
    other.name, other.node_tree = f"{node.name} 2", node.node_tree
    other.inputs["Light Level"].keyframe_insert("default_value", frame=1)
    order = ["Saturation", "Normal", "UV", "Tint", "Light Level"]
    kinds = {item.name: item for item in node.node_tree.interface.items_tree if item.in_out == "INPUT"}
    words = {"NodeSocketVector": "vector", "NodeSocketColor": "color", "NodeSocketFloat": "float"}
    moved = node_group("Moved", {name: words[kinds[name].socket_type] for name in order}, {}, lambda *_: ())
    exchange_group(tree, node, moved)
    slot = getattr(tree.animation_data, "action_slot", None)
    found = {curve.data_path for curve in compat.curves_of(tree.animation_data.action, slot)}
    assert found == {f'nodes["{node.name}"].inputs[4].default_value', f'nodes["{other.name}"].inputs[3].default_value'}
    (driver,) = tree.animation_data.drivers
    assert driver.data_path == f'nodes["{node.name}"].inputs[0].default_value'


def test_nothing_comes_to_stand_where_another_input_stood(lacquer: Any) -> None:
    """Blender goes by the place: a tangent's link would reach the brightness, and a level the saturation."""
    tree, node, new = lacquer.node_tree, node_of(lacquer), node_of(lacquer).node_tree
    inputs = {"Normal": "vector", "Tint": "vector", "Tangent": "vector", "Level": "float"}

    def nothing(*_: Any) -> Any:
        return expr.Scalar(expr.node("ShaderNodeBsdfDiffuse", {}, {}).outputs[0])

    exchange_group(tree, node, node_group("Older", inputs, {"BSDF": "shader"}, nothing))
    tangent = tree.nodes.new("ShaderNodeTangent")
    tree.links.new(tangent.outputs[0], node.inputs["Tangent"])
    node.inputs["Level"].default_value = 5
    normal, target = node.inputs["Normal"].links[0].from_socket, node.outputs["BSDF"].links[0].to_socket
    assert new.interface.items_tree["Brightness"].identifier == node.inputs["Tangent"].identifier
    exchange_group(tree, node, new)
    assert [socket.name for socket in node.inputs if socket.is_linked] == ["Normal"]
    assert node.inputs["Normal"].links[0].from_socket == normal and target.links[0].from_node == node
    assert {node.inputs[name].default_value for name in ("Brightness", "Saturation")} == {1.0}


# --- relief -----------------------------------------------------------------------------------------------


def test_a_bump_bends_what_was_there(lacquer: Any) -> None:
    before = node_of(lacquer).inputs["Normal"].links[0].from_node
    assert bpy.ops.measured_materials.add_bump() == {"FINISHED"}
    bump, normal_map = relief_nodes(lacquer)
    assert bump.inputs["Normal"].links[0].from_node == before and normal_map is None
    with pytest.raises(BakeError, match="Bump node already"):
        add_bump(lacquer)
    assert bpy.ops.measured_materials.add_normal_map() == {"FINISHED"}
    bump, normal_map = relief_nodes(lacquer)
    assert bump.inputs["Normal"].links[0].from_node == normal_map
    assert node_of(lacquer).inputs["Normal"].links[0].from_node == bump
    with pytest.raises(BakeError, match="Normal Map node already"):
        add_normal_map(lacquer)
    rebuild_brdf(lacquer)
    assert relief_nodes(lacquer) == (bump, normal_map)


def test_a_normal_map_does_not_replace_an_artists_normal(lacquer: Any) -> None:
    tree, node = lacquer.node_tree, node_of(lacquer)
    bevel = tree.nodes.new("ShaderNodeBevel")
    tree.links.new(bevel.outputs[0], node.inputs["Normal"])
    with pytest.raises(BakeError, match="Bevel"):
        add_normal_map(lacquer)
    assert node.inputs["Normal"].links[0].from_node == bevel and len(tree.nodes) == len(lacquer.node_tree.nodes)
    assert add_bump(lacquer).inputs["Normal"].links[0].from_node == bevel


# --- swatch -----------------------------------------------------------------------------------------------


def test_a_swatch_is_as_wide_as_stated(felt: Any, plate: Any) -> None:
    """On a plate of 2 x 3 units, scaled, of 50 cm each; the swatch's texels are square."""
    square(plate, 2.0)
    plate.scale = (1, 1.5, 1)
    bpy.context.view_layer.update()
    assert metres_per_uv(plate) == pytest.approx(math.sqrt(2 * 3))
    layout = record_of(felt).map.layout
    assert layout.width != layout.height
    repeats = lay_out(felt, plate, 0.1, 0.5)
    assert repeats == pytest.approx(math.sqrt(6) * 0.5 / 0.1) and felt[WIDTH_KEY] == 0.1
    mapping = swatch_mapping(felt)
    texels = texels_per_uv(felt, layout.width, layout.height)
    assert texels == pytest.approx((repeats * layout.width,) * 2)
    assert mapping.inputs["Scale"].default_value[1] == pytest.approx(layout.height / layout.width / repeats)
    assert lay_out(felt, plate, 0.2, 0.5) == pytest.approx(repeats / 2)


def test_sizing_a_swatch_leaves_its_turn_and_place(felt: Any, plate: Any) -> None:
    """The node turns before it scales from then on, where it scaled first; a place that was moved to the origin is."""
    square(plate, 1.0)
    mapping = swatch_mapping(felt)
    mapping.inputs["Rotation"].default_value, mapping.inputs["Location"].default_value = (0, 0, 0.5), (0.3, 0.2, 0)
    lay_out(felt, plate, 0.25)
    turn, scale = mapping.inputs["Rotation"].default_value[2], np.array(mapping.inputs["Scale"].default_value[:2])
    place = np.array(mapping.inputs["Location"].default_value[:2])
    turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    assert mapping.vector_type == "TEXTURE" and turn == pytest.approx(-0.5)
    assert turned.T @ (np.zeros(2) - place) / scale == pytest.approx((0.3, 0.2))
    lay_out(felt, plate, 0.25)
    assert mapping.inputs["Rotation"].default_value[2] == pytest.approx(-0.5)


def test_what_has_no_size_is_told(felt: Any, plate: Any) -> None:
    with pytest.raises(BakeError, match="UV map"):
        lay_out(felt, plate, 0.1)
    square(plate)
    plate.data.uv_layers[0].uv.foreach_set("vector", np.zeros(8, np.float32))
    with pytest.raises(BakeError, match="no area"):
        lay_out(felt, plate, 0.1)
    swatch_mapping(felt).label = "mine"
    with pytest.raises(BakeError, match="Mapping"):
        lay_out(felt, plate, 0.1)
    with pytest.raises(RuntimeError, match="Mapping"):
        bpy.ops.measured_materials.lay_out(width=0.1)


def test_random_tiling_is_a_node_that_comes_and_goes(felt: Any) -> None:
    """What was linked before is linked after, and a rebuild leaves it."""
    node = node_of(felt)
    source, nodes = node.inputs["UV"].links[0].from_socket, len(felt.node_tree.nodes)
    assert random_tiling_node(felt) is None
    assert bpy.ops.measured_materials.random_tiling() == {"FINISHED"}
    tiling = random_tiling_node(felt)
    assert tiling.inputs["UV"].links[0].from_socket == source and tiling.inputs["Patch Size"].default_value > 0
    set_random_tiling(felt, True)
    assert len(felt.node_tree.nodes) == nodes + 1
    relight(felt, RenderSettings(sigma=0.9))
    assert random_tiling_node(felt) == tiling
    assert bpy.ops.measured_materials.random_tiling() == {"FINISHED"}
    assert random_tiling_node(felt) is None and len(felt.node_tree.nodes) == nodes
    assert node_of(felt).inputs["UV"].links[0].from_socket == source


# --- energy -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changed", [{"Brightness": 3.0}, {"Tint": (1.0, 4.0, 1.0, 1.0)}, {"Brightness": 2.5, "Saturation": 0.25}]
)
def test_too_much_light_is_told_with_what_is_safe(lacquer: Any, changed: dict[str, Any]) -> None:
    """And neither at neutral values nor at what is said to be safe; an independent sum says the same."""
    facts = facts_of(lacquer)
    seen = [[0.9 * r, 0.7 * g, 0.3 * b] for r, g, b in facts["albedo"]["directional"]]
    keep_facts(lacquer, {**facts, "albedo": {**facts["albedo"], "directional": seen}})
    node = node_of(lacquer)
    assert energy_of(lacquer) is None
    for name, value in changed.items():
        node.inputs[name].default_value = value
    rows = np.array(record_of(lacquer).albedo.directional)
    tint = np.array(changed.get("Tint", (1, 1, 1, 1)))[:3]
    saturation, brightness = changed.get("Saturation", 1.0), changed.get("Brightness", 1.0)
    grey = (rows @ [0.2126, 0.7152, 0.0722])[:, None]
    largest = ((rows * saturation + grey * (1 - saturation)) * tint * brightness).max()
    energy = energy_of(lacquer)
    assert energy.gains and energy.largest == pytest.approx(largest, rel=1e-6)
    assert energy.safe_brightness == pytest.approx(brightness / largest, abs=1e-4)
    assert energy.safe_brightness <= brightness / largest
    assert f"{largest:.4g}" in energy.words and f"{energy.safe_brightness:.4g}" in energy.words
    assert bpy.ops.measured_materials.safe_brightness() == {"FINISHED"}
    assert not energy_of(lacquer).gains and not energy_of(lacquer).words
    assert node.inputs["Brightness"].default_value == pytest.approx(energy.safe_brightness)


def test_what_is_linked_cannot_be_known(lacquer: Any) -> None:
    tree, node = lacquer.node_tree, node_of(lacquer)
    texture = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(texture.outputs["Color"], node.inputs["Tint"])
    energy = energy_of(lacquer)
    assert energy.words == "Tint is linked, so whether the material reflects too much light cannot be known"
    assert not energy.gains and energy.mend is None
    tree.links.new(texture.outputs[0], node.inputs["Brightness"])
    assert energy_of(lacquer).words.startswith("Tint and Brightness are linked")
    tree.links.new(texture.outputs[0], node.inputs["Saturation"])
    assert energy_of(lacquer).words.startswith("Tint, Brightness and Saturation are linked")


def test_saturation_in_numpy() -> None:
    colours = np.array([[0.8, 0.2, 0.1], [0.0, 0.0, 0.0], [0.3, 0.3, 0.3]])
    assert np.array_equal(saturated(colours, 1.0), colours)
    grey = saturated(colours, 0.0)
    assert np.allclose(grey, (colours @ [0.2126, 0.7152, 0.0722])[:, None])
    assert saturated(colours, 2.0)[0] == pytest.approx((1.6 - grey[0, 0], 0.4 - grey[0, 0], 0.0))
    assert np.allclose(saturated(colours, -1.0), grey)


def test_the_scene_check_notes_it_and_fixes_it(lacquer: Any, plate: Any) -> None:
    square(plate)
    scene, node = bpy.context.scene, node_of(lacquer)

    def told() -> list[Any]:
        return [finding for finding in check_scene(scene) if finding.rule == "too_bright"]

    largest = np.max(record_of(lacquer).albedo.directional)
    node.inputs["Brightness"].default_value = 0.999 / largest
    assert not told()
    node.inputs["Brightness"].default_value = 1.01 / largest
    (finding,) = told()
    assert "1.01 times" in finding.why and finding.found.startswith("Brightness is ")
    mend([finding])
    assert not told() and node.inputs["Brightness"].default_value == pytest.approx(1 / largest, abs=1e-4)


# --- panel ------------------------------------------------------------------------------------------------


def test_the_panel_shows_the_nodes_own_sockets(lacquer: Any) -> None:
    texts = Stage(lacquer).drawn(AdjustPanel)
    assert list(SOCKETS) == [text for text in texts if text in SOCKETS]
    assert {"measured_materials.add_bump", "measured_materials.add_normal_map"} <= set(texts)
    assert "measured_materials.lay_out" not in texts and "measured_materials.fit_to_scene" not in texts
    node_of(lacquer).inputs["Brightness"].default_value = 9
    add_bump(lacquer)
    texts = Stage(lacquer).drawn(AdjustPanel)
    assert "measured_materials.safe_brightness" in texts and "measured_materials.add_bump" not in texts
    assert "times the light that it receives" in " ".join(texts) and "Height" in texts


def test_the_panel_of_photographs_and_of_an_older_file(felt: Any) -> None:
    texts = Stage(felt).drawn(AdjustPanel)
    assert {"measured_materials.lay_out", "default_value", "measured_materials.random_tiling"} <= set(texts)
    assert "Patch Size" not in texts
    felt.measured_lighting.tiling = "extend"
    assert "measured_materials.random_tiling" not in Stage(felt).drawn(AdjustPanel)
    felt.measured_lighting.tiling = "repeat"
    set_random_tiling(felt, True)
    exchange_group(felt.node_tree, node_of(felt), older_group(felt))
    texts = Stage(felt).drawn(AdjustPanel)
    assert "Patch Size" in texts and "measured_materials.fit_to_scene" in texts
    assert "Tint" in texts and "Brightness" not in texts


def test_a_material_without_its_group_says_so(lacquer: Any) -> None:
    lacquer.node_tree.nodes.remove(node_of(lacquer))
    assert "no longer among its nodes" in " ".join(Stage(lacquer).drawn(AdjustPanel))
    with pytest.raises(RuntimeError, match="no longer among its nodes"):
        bpy.ops.measured_materials.add_bump()


def test_sockets_are_drawn_by_a_template_that_blender_has() -> None:
    """What stands in for a layout here would take any."""
    parameters = bpy.types.UILayout.bl_rna.functions["template_node_view"].parameters
    assert [parameter.identifier for parameter in parameters] == ["ntree", "node", "socket"]
