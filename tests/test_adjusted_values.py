"""Tint, brightness and saturation in Cycles: exactly nothing where neutral, and what numpy says of pictures.

Nothing is reflected twice here, so that a picture under light of one colour is the directional albedo, or the light
of a lamp, channel by channel times that colour: divided by it, adjusted and multiplied again, the picture of the plain
material is that of the adjusted one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.addon.studio import studio
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat, expr
from measured_materials.nodes.adjustments import Adjustments, saturation_group
from measured_materials.nodes.group import call
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import measured_nodes
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from measured_materials.nodes.shading_map_material import build_shading_map
from numpy.typing import NDArray
from support.cards import card
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse_bakes
from support.monte_carlo import assert_same
from support.osl import header_card, skip_without_osl
from support.scenes import TestScene, add_lamp, furnace
from support.swatches import map_bundle, rough_map

EFFECT = 0.01
LUMA = np.array([0.2126, 0.7152, 0.0722])
LIGHT = np.array([1.0, 0.6, 0.3])
CHANGED = {"Tint": (0.9, 0.6, 0.8, 1.0), "Brightness": 0.75, "Saturation": 0.25}
COLOURS = np.random.default_rng(7).uniform(-0.5, 2, (300, 3)).clip(0).astype(np.float32)


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Of several colours, gloss of two widths, and a residual."""
    source = analytic.MetallicPaint((0.05, 0.1, 0.3), (0.4, 0.2, 0.1), flake_alpha=0.4, coat_alpha=0.3)
    settings = BakeSettings(resolution=16, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))
    with coarse_bakes():
        return read_bundle(bake_source(source, tmp_path_factory.mktemp("paint") / "paint", settings).path)


@pytest.fixture(scope="module")
def cloth(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    render = RenderSettings(Lobe("phong", 20.0), sigma=0.4, mode="exact")
    return map_bundle(tmp_path_factory.mktemp("cloth") / "cloth", rough_map(), render)


def adjusted(material: bpy.types.Material, values: dict[str, Any] = CHANGED) -> bpy.types.Material:
    """The same material with these values of its sockets."""
    for name, value in values.items():
        measured_nodes(material.node_tree)[0][1].inputs[name].default_value = value
    return material


def in_numpy(reflected: NDArray[Any], values: dict[str, Any] = CHANGED) -> NDArray[np.float64]:
    """What these values make of a reflectance (..., 3), in double precision."""
    saturation, colour = values["Saturation"], np.asarray(reflected, np.float64)
    grey = (colour @ LUMA)[..., None]
    return np.maximum(colour * saturation + grey * (1 - saturation), 0) * values["Tint"][:3] * values["Brightness"]


# --- the formula ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("saturation", [0.0, 0.25, 1.0, 1.7])
def test_saturation_on_a_card(saturation: float) -> None:
    """By a texture, which nothing folds away; to float32's last digits, and at 1 to the last bit."""
    given = np.full(len(COLOURS), saturation, np.float32)
    (found,) = card(lambda v, s: call(saturation_group(), v, s), COLOURS, given)
    plain = {"Tint": (1, 1, 1), "Brightness": 1, "Saturation": saturation}
    assert np.abs(found - in_numpy(COLOURS, plain)).max() < 5e-7
    if saturation == 1:
        assert np.array_equal(found, COLOURS)
    if saturation == 0:
        assert np.abs(found - found[:, :1]).max() == 0


def test_all_three_on_a_card() -> None:
    """What is negative counts as 0, wherever it comes from."""
    rng, count = np.random.default_rng(8), len(COLOURS)
    tint = rng.uniform(-0.2, 1.5, (count, 3)).astype(np.float32)
    brightness, saturation = (rng.uniform(-0.2, 2, count).astype(np.float32) for _ in range(2))

    def formula(colour: Any, t: Any, b: Any, s: Any) -> Any:
        return Adjustments(t, b, s).apply(colour, b)

    (found,) = card(formula, COLOURS, tint, brightness, saturation)
    held = np.maximum(saturation, 0)[:, None].astype(float)
    grey = (COLOURS.astype(float) @ LUMA)[:, None]
    gain = np.maximum(tint.astype(float) * brightness[:, None], 0) * brightness[:, None]
    truth = np.maximum(COLOURS * held + grey * (1 - held), 0) * gain
    assert np.abs(found - truth).max() < 5e-6


def test_the_osl_twin_on_a_card() -> None:
    skip_without_osl()
    given = np.linspace(-0.5, 2, len(COLOURS)).astype(np.float32)
    body = "Out = mm_saturated(color(Given), Saturation);"
    (found,) = header_card(body, {"Out": "color"}, Given=COLOURS, Saturation=given)
    (nodes,) = card(lambda v, s: call(saturation_group(), v, s), COLOURS, given)
    assert np.abs(found - nodes).max() < 5e-7
    (same,) = header_card(body, {"Out": "color"}, Given=COLOURS, Saturation=np.ones_like(given))
    assert np.array_equal(same, COLOURS)


# --- pictures ---------------------------------------------------------------------------------------------


def coloured_furnace(material: bpy.types.Material) -> TestScene:
    scene = furnace(material, resolution=24)
    background = next(n for n in scene.scene.world.node_tree.nodes if n.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (*LIGHT, 1)
    return scene


def agrees(scene: TestScene, make: Callable[[], bpy.types.Material], samples: int) -> None:
    """The adjusted material is what numpy makes of the plain one's picture, and a planted 2 % would be found.

    Of no samples: under equal seeds, where one closure is all that a sample has, and adjusting changes no draw.
    """
    scene.show(make())
    update_scene(scene.scene)
    if not samples:
        mask, plain = scene.mask(), scene.render(8, 1)[0]
        scene.show(adjusted(make()))
        expected, found = in_numpy(plain / LIGHT) * LIGHT, scene.render(8, 1)[0]
        assert plain[mask].mean() > 0.05 and np.abs(found - expected)[mask].max() < 1e-5
        return
    plain = scene.render(samples, 8)
    scene.show(adjusted(make()))
    found = scene.render(samples, range(100, 108))
    expected = in_numpy(plain / LIGHT) * LIGHT
    assert_same(expected.astype(np.float32), found, scene.mask(), 0.0, EFFECT)


@pytest.mark.parametrize("mode", ["preview", "exact", "reference"])
def test_a_measured_brdf(paint: Bundle, mode: str) -> None:
    with coloured_furnace(build_material(paint, mode=mode)) as scene:
        agrees(scene, lambda: build_material(paint, mode=mode), {"preview": 64, "exact": 128, "reference": 0}[mode])


@pytest.mark.parametrize("mode", ["preview", "exact", "reference", "lit_texture", "angular"])
def test_a_shading_map(cloth: Bundle, mode: str) -> None:
    technique = mode if mode in ("lit_texture", "angular") else "lookup"
    render = RenderSettings(Lobe("phong", 20.0), sigma=0.4, technique=technique)
    if technique == "lookup":
        render = RenderSettings(Lobe("phong", 20.0), sigma=0.4, mode=mode)
    with coloured_furnace(build_shading_map(cloth, settings=render)) as scene:
        agrees(scene, lambda: build_shading_map(cloth, settings=render), 96 if mode == "preview" else 0)


@pytest.mark.slow
@pytest.mark.parametrize("sampled", [False, True], ids=["aimed", "sampled"])
def test_osl_under_a_lamp(paint: Bundle, sampled: bool) -> None:
    """Where lamps are sampled three parts bring light, of which one is emitted."""
    skip_without_osl()
    lights = lamp_light_image() if sampled else None

    def make() -> bpy.types.Material:
        return build_osl_material(paint, mode="exact", lamps=lamp_image(), lights=lights)

    with coloured_furnace(make()) as scene:
        scene.scene.world = compat.new_world("night")[0]
        scene.scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
        add_lamp(scene, "AREA", (1.5, -2, 2.5), energy=100, size=1.0, color=tuple(LIGHT))
        use_osl(scene.scene)
        agrees(scene, make, 64)


@pytest.mark.parametrize("mode", ["preview", "exact", "reference"])
def test_what_is_neutral_is_the_same_picture(paint: Bundle, mode: str) -> None:
    """Bit by bit, by sockets that nothing is linked to and by textures, of which Cycles folds none away."""
    with coloured_furnace(build_material(paint, mode=mode, lamps=lamp_image(), features=True)) as scene:
        plain = scene.render(4, 1)
        material = scene.sphere.data.materials[0]
        (_, node) = measured_nodes(material.node_tree)[0]
        with expr.building(material.node_tree) as tree:
            position = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Position"])
            one = expr.dot(position, position) * 0.0 + 1.0
            for name in ("Brightness", "Saturation"):
                expr.feed(tree, node.inputs[name], one)
            expr.feed(tree, node.inputs["Tint"], expr.vec(one, one, one))
        assert np.array_equal(scene.render(4, 1), plain)


def test_a_textured_socket(paint: Bundle) -> None:
    """Grey on one side of the sphere and untouched on the other, sample by sample: of a mirror nothing else changes."""
    with coloured_furnace(build_material(paint, mode="reference")) as scene:
        plain, mask = scene.render(8, 1)[0], scene.mask()
        material = scene.sphere.data.materials[0]
        (_, node) = measured_nodes(material.node_tree)[0]
        with expr.building(material.node_tree) as tree:
            position = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Position"])
            expr.feed(tree, node.inputs["Saturation"], expr.components(position)[0] > 0)
        found = scene.render(8, 1)[0]
    left, right = mask.copy(), mask.copy()
    left[:, 11:], right[:, :13] = False, False
    assert left.sum() > 50 and np.array_equal(found[right], plain[right])
    grey = in_numpy(plain / LIGHT, {"Tint": (1, 1, 1), "Brightness": 1, "Saturation": 0}) * LIGHT
    assert np.abs(found - grey)[left].max() < 1e-5
    assert np.abs(found - plain)[left].max() > 0.01


def test_keyframes_reach_the_picture(paint: Bundle) -> None:
    material = build_material(paint, mode="reference")
    (_, node) = measured_nodes(material.node_tree)[0]
    for frame, value in ((1, 1.0), (2, 0.5)):
        node.inputs["Brightness"].default_value = value
        node.inputs["Brightness"].keyframe_insert("default_value", frame=frame)
    with coloured_furnace(material) as scene:
        pictures, mask = [], scene.mask()
        scene.scene.cycles.samples, scene.scene.cycles.seed = 4, 0
        for frame in (1, 2):
            bpy.context.scene.frame_set(frame)  # a picture of another scene is of this one's frame
            pictures.append(studio.render_linear(scene.scene)[mask])
        bpy.context.scene.frame_set(1)
    assert np.abs(pictures[1] - 0.5 * pictures[0]).max() < 1e-5 and pictures[0].mean() > 0.1
