"""The highlight of a cosine lobe, path traced, against direct light by quadrature of the analytic BRDF."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.bake.directions import normalize
from measured_materials.bake.lobes.cosine_lobes import COSINE_LOBES
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sources.analytic import ModifiedPhong
from measured_materials.nodes import compat, expr
from measured_materials.nodes.cosine_lobe_group import highlight_group
from measured_materials.nodes.group import call
from numpy.typing import NDArray
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree
from test_unbiased import FINDS, stage

COLOUR = (0.8, 0.5, 0.2)


def highlight_material(name: str, exponent: float) -> bpy.types.Material:
    """As the operator leaves it."""
    material = compat.new_material("highlight")
    tree = material.node_tree
    with expr.building(tree):
        closure, _ = call(highlight_group(name, lamp_image()), expr.vec(*COLOUR), exponent, expr.vec(0.0, 0.0, 0.0))
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        expr.feed(tree, output.inputs["Surface"], closure)
    material.cycles.use_bump_map_correction = False
    return material


def assert_unbiased(name: str, exponent: float, light: str) -> None:
    """1 % would be found, and a planted error of 2 % is (`Stage.judged`)."""
    source = ModifiedPhong(0, COLOUR, exponent, name)

    def brdf(wi: NDArray[np.float64], wo: NDArray[np.float64]) -> NDArray[np.float64]:
        return source.evaluate(wi, wo)

    with stage(light) as lit:
        lit.scene.show(highlight_material(name, exponent))
        update_scene(lit.scene.scene)
        # A narrow lobe is noisy: 1.5 % could be told of 60 under three lamps.
        found = lit.judged(lit.truth(brdf), finer=2 if exponent > 30 else 1)
        print(found)
        assert_agree(found, FINDS)


@pytest.mark.parametrize("light", ["sky", "small lamp"])
def test_highlight_is_unbiased(light: str) -> None:
    """A wide one, for which few samples do; others below."""
    assert_unbiased("cubic", 6.0, light)


@pytest.mark.slow
@pytest.mark.parametrize("light", ["sky", "small lamp", "sun", "three lamps"])
@pytest.mark.parametrize("exponent", [0.5, 10.0, 60.0])
@pytest.mark.parametrize("name", COSINE_LOBES)
def test_highlights_are_unbiased(name: str, exponent: float, light: str) -> None:
    assert_unbiased(name, exponent, light)


@pytest.mark.parametrize("name", COSINE_LOBES)
def test_highlight_is_the_lobe_of_shading_maps(name: str) -> None:
    """One formula in two modules: f_r without its diffuse part, and the analytic source."""
    rng = np.random.default_rng(0)
    wi, wo = (normalize(np.abs(rng.normal(size=(500, 3)))) for _ in range(2))
    lobe = Lobe("phong" if name == "power" else f"phong_{name}", 40.0, 0.25)
    expected = ModifiedPhong(0.25, 0.75, 40.0, name).evaluate(wi, wo)[..., 0]
    assert np.allclose(lobe.value(wi, wo), expected, rtol=1e-9)
