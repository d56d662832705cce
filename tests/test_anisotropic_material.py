"""Anisotropic materials in Cycles: against its own anisotropic closure, on transformed meshes too."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.ui.panels.tangent_rows import tangent_nodes
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat, expr
from measured_materials.nodes.material import build_material
from measured_materials.nodes.native_closure import add_closures
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, assert_same, compare
from support.planes import SHAPES, plane_scene

EFFECT = 0.01
ALPHA_X, ALPHA_Y = 0.2, 0.5


@pytest.fixture(scope="module")
def brushed(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """White GGX: what Cycles' closure is."""
    source = analytic.Ggx(alpha=ALPHA_X, alpha_y=ALPHA_Y, f0=1)
    settings = BakeSettings(56, envelope=False)
    return read_bundle(bake_source(source, tmp_path_factory.mktemp("brushed") / "brushed", settings).path)


@dataclass(frozen=True)
class CrossBrushed:
    """Brushed along the tangent, and more weakly at 45 degrees to it: no mirror image of itself."""

    name: str = "crossed"
    isotropic: bool = False
    bilateral: bool = False
    facts: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """BRDF (..., 3) in 1/sr."""
        turn = np.array([[1, -1, 0], [1, 1, 0], [0, 0, 2**0.5]]) / 2**0.5  # rows of directions, by -45 degrees
        straight = analytic.Ggx(alpha=ALPHA_X, alpha_y=ALPHA_Y, f0=1).evaluate(wi, wo)
        return 0.5 * straight + 0.4 * analytic.Ggx(alpha=0.15, alpha_y=0.5, f0=1).evaluate(wi @ turn, wo @ turn)


@pytest.fixture(scope="module")
def crossed(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """With an envelope that cannot carry the second lobe."""
    settings = BakeSettings(48, sampler=SamplerLayout(48, 48, 24), basis="half", viewers=(12, 6))
    out = tmp_path_factory.mktemp("crossed") / "crossed"
    bundle = read_bundle(bake_source(CrossBrushed(), out, settings).path)
    # The residual is real: a third of the light or so.
    assert 0.4 < bundle.material["envelope"]["share"] < 0.9
    return bundle


def crossed_truth() -> bpy.types.Material:
    """Two closures of Cycles, the second turned by its own Rotation."""
    material = compat.new_material("crossed")
    with expr.building(material.node_tree) as tree:
        tangent = expr.Vector(expr.node("ShaderNodeTangent", {"direction_type": "UV_MAP"}, {}).outputs[0])
        parts = []
        for colour, x, y, turn in ((0.5, ALPHA_X, ALPHA_Y, 0.0), (0.4, 0.15, 0.5, 1 / 8)):
            inputs = {"Roughness": (x * y) ** 0.25, "Anisotropy": 1 - (x / y) ** 0.5, "Rotation": turn}
            grey = {"Color": expr.vec(colour, colour, colour), "Tangent": tangent}
            made = expr.node("ShaderNodeBsdfAnisotropic", {"distribution": "GGX"}, inputs | grey)
            parts.append(expr.Scalar(made.outputs[0]))
        expr.feed(tree, tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"], add_closures(parts))
    return material


def truth_material(rotation: float = 0.0) -> bpy.types.Material:
    """Cycles' own closure of the same lobe, along the Tangent node."""
    material = compat.new_material("truth")
    tree = material.node_tree
    closure, tangent = tree.nodes.new("ShaderNodeBsdfAnisotropic"), tree.nodes.new("ShaderNodeTangent")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tangent.direction_type = "UV_MAP"
    closure.distribution = "GGX"
    closure.inputs["Color"].default_value = (1, 1, 1, 1)
    closure.inputs["Roughness"].default_value = (ALPHA_X * ALPHA_Y) ** 0.25
    # alpha_x = alpha (1 - a), alpha_y = alpha / (1 - a).
    closure.inputs["Anisotropy"].default_value = 1 - (ALPHA_X / ALPHA_Y) ** 0.5
    closure.inputs["Rotation"].default_value = rotation
    tree.links.new(tangent.outputs[0], closure.inputs["Tangent"])
    tree.links.new(closure.outputs[0], output.inputs["Surface"])
    return material


def slow(value: str) -> Any:
    """A parameter of the long run only."""
    return pytest.param(value, marks=pytest.mark.slow)


@pytest.mark.parametrize("name", ["sheared out of its plane", *map(slow, ("mirrored", "still", "turned", "sheared"))])
def test_reference_equals_cycles_own_closure(brushed: Bundle, name: str) -> None:
    """The object transformed, against the same vertices in a mesh that is not: no tangent can go wrong there."""
    with plane_scene(truth_material(), SHAPES[name], applied=True) as truth:
        mask = truth.mask()
        expected = truth.render(256, range(100, 108))
    material = build_material(brushed, mode="reference", lamps=lamp_image())
    with plane_scene(material, SHAPES[name], applied=False) as scene:
        found = scene.render(512, 16)
    # The table's own interpolation error, measured in `errors`, in the worst tile.
    assert_same(expected, found, mask, 0.004, EFFECT)


@pytest.mark.slow
def test_rotation_is_that_of_cycles_own_closure(brushed: Bundle) -> None:
    """On a mirrored object too, where a turn of the wrong sign would show."""
    with plane_scene(truth_material(0.1), SHAPES["mirrored"], applied=False) as truth:
        mask = truth.mask()
        expected = truth.render(256, range(100, 108))
    material = build_material(brushed, mode="reference", lamps=lamp_image())
    tangent_nodes(material)[1].inputs["Rotation"].default_value = 0.1
    with plane_scene(material, SHAPES["mirrored"], applied=False) as scene:
        found = scene.render(512, 16)
        tangent_nodes(material)[1].inputs["Rotation"].default_value = -0.1
        wrong = scene.render(512, 4)
    assert_agree(compare(expected, found, mask, tolerance=0.004), EFFECT)
    assert not compare(expected, wrong, mask, tolerance=0.004).passed


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["exact", "reference"])
@pytest.mark.parametrize("name", ["mirrored", "still"])
def test_a_material_without_mirror_symmetry(crossed: Bundle, name: str, mode: str) -> None:
    """Native closures and the residual's mirror, or the mirror alone; the second lobe tells left from right."""
    with plane_scene(crossed_truth(), SHAPES[name], applied=True) as truth:
        mask = truth.mask()
        expected = truth.render(256, range(100, 108))
    material = build_material(crossed, mode=mode, lamps=lamp_image())
    with plane_scene(material, SHAPES[name], applied=False) as scene:
        found = scene.render(512, 10)
    assert_same(expected, found, mask, 0.005, EFFECT)


@pytest.mark.parametrize("mode", ["exact", slow("reference")])
def test_aimed_at_a_lamp(crossed: Bundle, mode: str) -> None:
    """A small lamp besides, most of the light: the density of the material's own draws counts in every weight."""
    with plane_scene(crossed_truth(), SHAPES["turned"], applied=True, lamp=True) as truth:
        mask = truth.mask()
        expected = truth.render(256, range(100, 108))
    material = build_material(crossed, mode=mode, lamps=lamp_image())
    with plane_scene(material, SHAPES["turned"], applied=False, lamp=True) as scene:
        assert update_scene(scene.scene).lamps
        found = scene.render(512, 10)
    assert_same(expected, found, mask, 0.005, EFFECT)
