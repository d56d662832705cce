"""The direction of brushing: where it comes from, how it is turned, and what the panel offers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.ui.panels.tangent_rows import draw_tangent, tangent_nodes
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes import expr
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import measured_nodes
from support.clean_blend import clean_blend  # noqa: F401
from support.planes import SHAPES, plane_scene
from test_addon import Stage

SATIN = analytic.Ward(alpha=0.2, alpha_y=0.5, diffuse=(0.3, 0.2, 0.1), specular=0.4)
SETTINGS = BakeSettings(8, sampler=SamplerLayout(16, 16, 16), envelope=False)
RENDERED_NORMAL = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def satin(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    out = tmp_path_factory.mktemp("satin") / "satin"
    return read_bundle(bake_source(SATIN, out, replace(SETTINGS, basis="half")).path)


def tangents(material: bpy.types.Material, shape: str) -> tuple[np.ndarray, np.ndarray]:
    """World positions and tangents (P, 3) that the material's group is given on a plane, as rendered colours."""
    _, group = tangent_nodes(material)
    tree = material.node_tree
    seen = []
    for value in (tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], group.outputs["Tangent"]):
        with expr.building(tree):
            emission = expr.node(
                "ShaderNodeEmission", {}, {"Color": expr.scale(expr.Vector(value), 0.25) + expr.vec(0.5, 0.5, 0.5)}
            )
            for output in [n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial"]:
                tree.links.new(emission.outputs[0], output.inputs["Surface"])
        with plane_scene(material, SHAPES[shape], applied=False) as scene:
            mask = scene.mask()
            scene.scene.render.filter_size = 0.01
            seen.append((scene.render(1, 1)[0][mask] - 0.5) / 0.25)
    return seen[0], seen[1]


@pytest.mark.parametrize("shape", ["turned", "mirrored", "sheared"])
def test_radial_runs_around_the_axis_and_rotation_turns_it(satin: Bundle, shape: str) -> None:
    """Around the object's axis in its own space, then taken along by its transform; a quarter turn is n x t."""
    material = build_material(satin)
    made, group = tangent_nodes(material)
    made.direction_type, made.axis = "RADIAL", "Z"
    position, tangent = tangents(material, shape)
    matrix = np.array(SHAPES[shape])[:3, :3]
    own = position @ np.linalg.inv(matrix).T
    along = np.stack([own[:, 1], -own[:, 0], 0 * own[:, 0]], -1) @ matrix.T
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    cosine = (along * tangent).sum(-1)
    # Either sense of the circle is a tangent; the middle of a pixel is known to a thousandth.
    assert np.abs(cosine).min() > 0.999 and np.ptp(np.sign(cosine)) == 0
    group.inputs["Rotation"].default_value = 0.25
    _, turned = tangents(material, shape)
    assert np.abs(turned - np.cross(RENDERED_NORMAL, tangent)).max() < 2e-3


def offered(material: bpy.types.Material) -> list[str]:
    """Properties that the panel draws."""
    stage = Stage(material)
    draw_tangent(stage.layout, material, stage)
    return stage.layout.texts


def test_panel_offers_what_has_an_effect(satin: Bundle) -> None:
    material = build_material(satin)
    made, group = tangent_nodes(material)
    assert offered(material) == ["direction_type", "default_value"]
    made.direction_type = "RADIAL"
    assert offered(material) == ["direction_type", "axis", "default_value"]
    # An artist's own vector instead: nothing of ours is left to offer.
    material.node_tree.nodes.remove(made)
    assert offered(material) == ["default_value"]
    material.node_tree.nodes.remove(group)
    assert offered(material) == []


def test_a_material_that_becomes_anisotropic_gets_its_tangent(satin: Bundle, tmp_path: Path) -> None:
    """By *Bake Again* from another file. What an artist has set outlives an isotropic file in between."""
    paper = bake_source(analytic.OrenNayar(), tmp_path / "paper", replace(SETTINGS, basis="normal"))
    isotropic = read_bundle(paper.path)
    material = build_material(satin, build_material(isotropic))
    made, group = tangent_nodes(material)
    assert group is not None and group.inputs["Normal"].is_linked
    made.direction_type, group.inputs["Rotation"].default_value = "RADIAL", 0.125
    build_material(satin, build_material(isotropic, material))
    made, group = tangent_nodes(material)
    assert made.direction_type == "RADIAL" and group.inputs["Rotation"].default_value == 0.125
    # A link that was taken away stays away.
    (_, node), *_ = measured_nodes(material.node_tree)
    material.node_tree.links.remove(node.inputs["Tangent"].links[0])
    build_material(satin, material, filter="nearest")
    assert tangent_nodes(material) == (None, None)
