"""A measured material blended with another by a mask: each alone at the ends, their mean between, kept by rebuilds."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import update_scene
from measured_materials.addon.material.adjust.blend import blend_with, partners_of, remove_blend, second_of
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.rebuild import rebuild_brdf
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.addon.ui.panels.adjust_rows import AdjustPanel
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sources.analytic import Ward
from measured_materials.nodes import compat
from measured_materials.nodes.aimed_light_group import SLOTS_KEY, can_switch
from measured_materials.nodes.feature_passes import store_feature_passes
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import lit_by_emission, measured_nodes
from measured_materials.nodes.osl_script import use_osl
from measured_materials.nodes.second_group import MIX_KEY, MOST_LAMPS, mask_node, mix_nodes, second_node
from support import bundles
from support.clean_blend import clean_blend  # noqa: F401
from support.gloss import link_socket
from support.monte_carlo import assert_agree
from support.osl import skip_without_osl
from support.scenes import TestScene, add_lamp, lit_sphere
from test_addon import Stage, known_bakes, lacquer, registered  # noqa: F401
from test_addon_arc import felt, stack  # noqa: F401
from test_unbiased import FINDS, stage


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Bundle, Bundle]:
    """Metallic paint, and a red felt."""
    folder = tmp_path_factory.mktemp("pair")
    names = ("metallic paint", "felt")
    return tuple(
        read_bundle(bake_source(bundles.ANALYTIC[name], folder / name, bundles.SETTINGS).path) for name in names
    )


def materials_of(pair: tuple[Bundle, Bundle], **choices: Any) -> list[bpy.types.Material]:
    """Built as imports build them, prepared for lamps."""
    made = [material_from(BakeResult(bundle.path, bundle.material, 0.0), pack=True) for bundle in pair]
    for material in made:
        rebuild_brdf(material, Choices(**choices))
    return made


def mask_of(material: bpy.types.Material) -> Any:
    return mask_node(material.node_tree).inputs["Mask"]


def picture(scene: TestScene, material: bpy.types.Material) -> np.ndarray:
    scene.show(material)
    update_scene(scene.scene)
    return scene.render(4, 1)[0]


@pytest.mark.parametrize("mode", ["exact", "preview"])
def test_the_ends_are_the_materials_alone(pair: tuple[Bundle, Bundle], mode: str) -> None:
    """Bit for bit, with lamps aimed at; by a texture each on its side; and without the blend again."""
    first, second = materials_of(pair, mode=mode, aim="always")
    with lit_sphere(first, lamp_size=0.6, ground=False, resolution=32) as scene:
        scene.scene.cycles.pixel_filter_type = "BOX"
        alone = [picture(scene, material) for material in (first, second)]
        before = len(first.node_tree.nodes)
        blend_with(first, second)
        for mask, expected in enumerate(alone):
            mask_of(first).default_value = mask
            assert (picture(scene, first) == expected).all()
        link_socket(first, mask_of(first), 0.0, 1.0)
        found, inside = picture(scene, first), scene.mask()
        columns = np.arange(32)[None] + np.zeros((32, 1))
        for side, expected in zip((columns < 14, columns > 17), alone):
            assert (found[inside & side] == expected[inside & side]).all()
        for node in [n for n in first.node_tree.nodes if n.label == "mask of the test"]:
            first.node_tree.nodes.remove(node)
        remove_blend(first)
        assert len(first.node_tree.nodes) == before
        assert (picture(scene, first) == alone[0]).all() and (alone[0] != alone[1]).any()


def test_half_is_their_mean(pair: tuple[Bundle, Bundle]) -> None:
    """A quarter of the second, rather, by quadrature, under a small lamp that both aim at; a planted 2 % is found."""
    first, second = materials_of(pair, aim="always")
    blend_with(first, second)
    mask_of(first).default_value = 0.25
    f, g = (bundles.brdf_of(bundle, "exact") for bundle in pair)
    with stage("small lamp") as lit:
        lit.scene.show(first)
        assert_agree(lit.judged(lit.truth(lambda wi, wo: 0.75 * f(wi, wo) + 0.25 * g(wi, wo))), FINDS)
        assert not [finding for finding in check_scene(lit.scene.scene) if finding.rule == "mixed_mirror"]


def test_rebuilds_of_both_are_followed(pair: tuple[Bundle, Bundle]) -> None:
    """Mode and adjustments of the one; the group of the other, without a denoiser's passes of its own."""
    first, second = materials_of(pair)
    own = measured_nodes(second.node_tree)[0][1]
    own.inputs["Brightness"].default_value = 0.5
    blend_with(first, second)
    node = second_node(first.node_tree)
    assert second_of(first) == second and node.node_tree == own.node_tree
    assert node.inputs["Brightness"].default_value == 0.5 and partners_of(first) == [second]
    for mode in ("reference", "preview"):
        rebuild_brdf(second, Choices(mode=mode))
        assert node.node_tree == own.node_tree
        rebuild_brdf(first, Choices(mode=mode))
        for mix in mix_nodes(first.node_tree):
            shown = [socket.links[0].from_node for socket in mix.inputs[1:]]
            assert shown == [measured_nodes(first.node_tree)[0][1], node]
    assert {mix[MIX_KEY] for mix in mix_nodes(first.node_tree)} == {"BSDF", "EEVEE"}
    store_feature_passes(bpy.context.view_layer)
    rebuild_brdf(second, Choices(mode="exact"))
    assert any(n.bl_idname == "ShaderNodeOutputAOV" for n in own.node_tree.nodes)
    assert not any(n.bl_idname == "ShaderNodeOutputAOV" for n in node.node_tree.nodes)
    assert node.node_tree in [n.node_tree for n in own.node_tree.nodes if n.bl_idname == "ShaderNodeGroup"]
    bpy.data.materials.remove(second)
    assert second_of(first) is None and node.node_tree is not None


def test_a_second_that_becomes_brushed_is_given_a_tangent(pair: tuple[Bundle, Bundle], tmp_path: Path) -> None:
    """That of the first, which is round; it goes with the blend."""
    first, second = materials_of(pair)
    before = len(first.node_tree.nodes)
    blend_with(first, second)
    assert "Tangent" not in second_node(first.node_tree).inputs
    settings = BakeSettings(8, basis="normal", parameterization="uniform", envelope=False)
    build_material(read_bundle(bake_source(Ward(alpha=0.2, alpha_y=0.4), tmp_path / "brushed", settings).path), second)
    assert second_node(first.node_tree).inputs["Tangent"].is_linked
    remove_blend(first)
    assert len(first.node_tree.nodes) == before


def test_eevee_mixes_by_the_mask_itself(pair: tuple[Bundle, Bundle]) -> None:
    first, second = materials_of(pair)
    blend_with(first, second)
    outputs = [n for n in first.node_tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial" and n.target != "ALL"]
    for output in outputs:
        mix = output.inputs["Surface"].links[0].from_node
        name = "EEVEE" if output.target == "EEVEE" else "BSDF"
        assert mix[MIX_KEY] == name
        assert mix.inputs[0].links[0].from_socket.name == ("EEVEE" if name == "EEVEE" else "Factor")


def test_a_swatch_is_blended_in_its_own_place(lacquer: Any, felt: Any) -> None:
    """Of photographs the size of the swatch comes along, and goes with it."""
    mapping = next(n for n in felt.node_tree.nodes if n.bl_idname == "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value, mapping.vector_type = (3, 4, 1), "TEXTURE"
    before = len(lacquer.node_tree.nodes)
    blend_with(lacquer, felt)
    node = second_node(lacquer.node_tree)
    laid_out = node.inputs["UV"].links[0].from_node
    assert tuple(laid_out.inputs["Scale"].default_value) == (3, 4, 1) and laid_out.vector_type == "TEXTURE"
    blend_with(lacquer, felt)  # again is in place of
    assert len(mix_nodes(lacquer.node_tree)) == 2
    remove_blend(lacquer)
    assert len(lacquer.node_tree.nodes) == before and second_node(lacquer.node_tree) is None


def test_what_cannot_be_blended_is_refused(pair: tuple[Bundle, Bundle]) -> None:
    first, _ = materials_of(pair)
    with pytest.raises(BakeError, match="not another measured material"):
        blend_with(first, first)
    with pytest.raises(BakeError, match="not another measured material"):
        blend_with(first, compat.new_material("plain"))
    assert second_node(first.node_tree) is None


def test_osl_is_blended_with_osl(pair: tuple[Bundle, Bundle]) -> None:
    """Bit for bit the first and the second; with nodes it is refused; neither is taken for a lamp."""
    skip_without_osl()
    first, second = materials_of(pair, aim="always")
    rebuild_brdf(second, Choices(aim="always", shader="osl"))
    with pytest.raises(BakeError, match="shade both alike"):
        blend_with(first, second)
    rebuild_brdf(first, Choices(aim="always", shader="osl"))
    with lit_sphere(first, lamp_size=0.6, resolution=32) as scene:
        use_osl(scene.scene)
        alone = [picture(scene, material) for material in (first, second)]
        blend_with(first, second)
        for mask, expected in enumerate(alone):
            mask_of(first).default_value = mask
            assert (picture(scene, first) == expected).all()


def test_the_blend_is_no_lamp(pair: tuple[Bundle, Bundle]) -> None:
    """Where the second samples lamps, before and after."""
    first, second = materials_of(pair)
    lit_by_emission(second, True)
    blend_with(first, second)
    assert first.cycles.emission_sampling == "NONE"
    lit_by_emission(second, False)
    rebuild_brdf(first)
    assert first.cycles.emission_sampling != "NONE"
    lit_by_emission(second, True)
    assert first.cycles.emission_sampling == "NONE"


def test_panel_and_operators(lacquer: Any, pair: tuple[Bundle, Bundle]) -> None:
    """A button, then the mask and a button back; a name that is none is refused in one line."""
    second, _ = materials_of(pair)
    assert "measured_materials.blend" in Stage(lacquer).drawn(AdjustPanel)
    with pytest.raises((RuntimeError, TypeError)):
        bpy.ops.measured_materials.blend(second="nobody")
    assert bpy.ops.measured_materials.blend(second=second.name) == {"FINISHED"}
    assert second_of(lacquer) == second
    texts = Stage(lacquer).drawn(AdjustPanel)
    assert f"Blended with {second.name}" in texts and "measured_materials.remove_blend" in texts
    assert bpy.ops.measured_materials.remove_blend() == {"FINISHED"}
    assert second_of(lacquer) is None


def test_fewer_lamps_are_aimed_at_beside_a_blend(pair: tuple[Bundle, Bundle]) -> None:
    """At once, and again as many as there are when the blend is gone."""
    first, second = materials_of(pair, aim="always")
    with lit_sphere(first, lamp_size=0.6, resolution=32) as scene:
        for place in ((-2, -1, 2), (0, 2, 2)):
            add_lamp(scene, "AREA", place, energy=50)
        update_scene(scene.scene)
        aims = [tree for tree in bpy.data.node_groups if can_switch(tree) and tree[SLOTS_KEY]]
        assert aims and {tree[SLOTS_KEY] for tree in aims} == {3}
        blend_with(first, second)
        assert {tree[SLOTS_KEY] for tree in aims} == {MOST_LAMPS}
        remove_blend(first)
        assert {tree[SLOTS_KEY] for tree in aims} == {3}
