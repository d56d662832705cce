"""The four techniques in numpy: their relations, the gantry's frames, and agreement with Cycles and EEVEE."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.gantry import photograph_arc, techniques
from measured_materials.addon.gantry.techniques import IN_ORDER, Case, Light, MappedSwatch, shade
from measured_materials.bake.errors import BakeError
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.shading_maps.shading_map import ShadingMap
from measured_materials.nodes import compat
from measured_materials.nodes.shading_map_material import build_shading_map
from support.eevee import eevee_pictures
from support.swatches import identity_map, map_bundle, rough_map

NORMAL = (0.0, 0.0, 1.0)
KNOTS = np.linspace(0, 1, 9).tolist()
UV = techniques.frame_uv(8)
LOW, HIGH = techniques.direction(25, 0), techniques.direction(70, 40)


def swatch(shading_map: ShadingMap, lobe: Lobe | None = None) -> MappedSwatch:
    return MappedSwatch(shading_map, lobe or Lobe("lambert"), sigma=0.6, a_max=0.7 / math.pi, level_by_cosine=KNOTS)


# --- relations ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("technique", IN_ORDER)
def test_identity_map_is_the_flat_material(technique: str) -> None:
    # S(x) = x colour, and x stays below 1: nothing is left to tell the techniques apart.
    lobe, colour = Lobe("phong", 8.0, 0.5), np.array((1.3, 1.0, 0.7))
    flat = replace(swatch(identity_map(), lobe), a_max=2.0)
    lights = [Light(LOW, (1.0, 0.5, 0.2)), Light(HIGH, 2.0), Light((0.0, 0.6, -0.8), 9.0)]
    f_cos = [lobe.value(np.array(w), np.array(NORMAL)) * max(w[2], 0) for w in (LOW, HIGH)]
    expected = 0.6 * colour * (f_cos[0] * np.array((1.0, 0.5, 0.2)) + f_cos[1] * 2)
    np.testing.assert_allclose(shade(technique, flat, lights, NORMAL, UV), np.broadcast_to(expected, (8, 8, 3)), 1e-6)


def test_all_but_the_final_radiance_add_up_light_by_light() -> None:
    rough = swatch(rough_map())
    lights = [Light(LOW, 3.0), Light(HIGH)]
    for technique in IN_ORDER:
        both = shade(technique, rough, lights, NORMAL, UV)
        alone = sum(shade(technique, rough, [light], NORMAL, UV) for light in lights)
        agree = np.allclose(both, alone, rtol=1e-9)
        assert agree == (technique != "final_radiance"), technique


def test_final_radiance_is_the_lookup_under_the_light_of_the_photographs() -> None:
    rough = swatch(rough_map())
    one = [Light(LOW, 4.0)]
    lookup = shade("lookup", rough, one, NORMAL, UV)
    np.testing.assert_allclose(shade("final_radiance", rough, one, NORMAL, UV, light_level=4.0), lookup, rtol=1e-9)
    assert not np.allclose(shade("final_radiance", rough, one, NORMAL, UV), lookup, rtol=0.05)


def test_angular_is_the_lookup_where_the_levels_follow_f_r() -> None:
    # A Lambertian whose photographs follow the cosine up to a_max.
    rough = replace(swatch(rough_map()), a_max=0.6 / math.pi)
    for light in (LOW, HIGH):
        found = [shade(technique, rough, [Light(light)], NORMAL, UV) for technique in ("angular", "lookup")]
        np.testing.assert_allclose(*found, rtol=1e-9)


def test_bundle_gives_what_its_material_shows(tmp_path: Path) -> None:
    render = RenderSettings(Lobe("phong", 20.0, 0.3), sigma=0.5, above="scale")
    bundle = map_bundle(tmp_path / "map", rough_map(), render, a_max=0.25)
    found = techniques.mapped_swatch(bundle)
    assert (found.lobe, found.sigma, found.a_max, found.above) == (render.lobe, 0.5, 0.25, "scale")
    np.testing.assert_allclose(found.map.slices, rough_map().slices, atol=1e-6)
    with pytest.raises(BakeError, match="choose a lobe"):
        techniques.mapped_swatch(bundle, RenderSettings(None))
    with pytest.raises(ValueError, match="no technique"):
        shade("angle", found, [], NORMAL, UV)


def test_errors_of_known_pictures() -> None:
    target = np.random.default_rng(0).uniform(0.5, 1.5, (6, 6, 3))
    assert all(value == 0 for value in techniques.errors(target, target).values())
    mirrored = techniques.errors(target[:, ::-1], target)
    assert mirrored["rms"] > 0.2 and mirrored["tones"] == 0 and abs(mirrored["mean"]) < 1e-12
    brighter = techniques.errors(1.1 * target, target)
    np.testing.assert_allclose([brighter[k] for k in ("rms", "tones", "mean")], 0.1, rtol=1e-9)
    # Middle grey times 1.1 in sRGB.
    assert 0.01 < brighter["display"] < 0.03
    both = techniques.mean_errors([{"mean": 0.3}, {"mean": -0.4}])
    np.testing.assert_allclose(both["mean"], math.sqrt(0.125))


# --- frames ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", [(0.0, 0.0), (60.0, -90.0), (40.0, 130.0)])
def test_frame_uv_is_where_the_gantry_looks(view: tuple[float, float]) -> None:
    material = compat.new_material("uv")
    tree = material.node_tree
    uv, emission, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "Emission", "OutputMaterial"))
    tree.links.new(uv.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    radians = (math.radians(view[0]), math.radians(view[1]))
    size = 12
    picture = photograph_arc.photograph_view(material, view=radians, size=size, samples=64)[..., :2]
    expected = techniques.frame_uv(size, radians) % 1
    inside = (np.abs(expected - 0.5) < 0.5 - 1.5 / size / math.cos(radians[0])).all(-1)
    assert inside.sum() > 10
    # 64 points of a pixel average to its middle within a few per cent of its width.
    np.testing.assert_allclose(picture[inside], expected[inside], atol=0.2 / size)


def test_frames_add_up_to_the_truth() -> None:
    class Recorder:
        """In place of a gantry: a frame says where light and camera stood."""

        def set_view(self, theta: float, phi: float) -> None:
            self.view = theta, phi

        def set_light(self, theta: float, phi: float) -> None:
            self.light = theta, phi

        def render(self, seed: int = 0) -> np.ndarray:
            return np.full((2, 2, 3), math.degrees(self.light[0]) + 1000 * math.degrees(self.view[0]), np.float32)

    cases = [Case("a", ((30.0, 0.0, 1.0), (70.0, 0.0, 2.0))), Case("b", ((30.0, 0.0, 1.0),), (20.0, 90.0))]
    frames = techniques.photograph(Recorder(), cases)
    assert len(frames) == 3
    np.testing.assert_allclose(techniques.truth(cases[0], frames), 60 + 2 * 20, rtol=1e-6)
    np.testing.assert_allclose(techniques.truth(cases[1], frames), 20060, rtol=1e-6)


def test_own_level_needs_no_f_r() -> None:
    rough = swatch(rough_map())
    case = Case("a", ((40.0, 0.0, 2.0),))
    # A truth that is the map itself at some level.
    frame = rough.a_max * rough.map.evaluate(techniques.frame_uv(16), np.full((16, 16), 0.37))
    frames = {(case.view, (40.0, 0.0)): frame.astype(np.float32)}
    found = techniques.errors(techniques.at_own_level(rough, case, frames, 16), techniques.truth(case, frames))
    assert found["rms"] < 1e-6


# --- Blender --------------------------------------------------------------------------------------------

SUN = math.radians(40)  # wide, for a mirror finds it by chance only
VIEW, LIGHT = (math.radians(35), math.radians(200)), (math.radians(40), math.radians(20))


def wide_sun(count: int) -> list[Light]:
    """Directions that stand for the disk of `SUN`, whose irradiance on a plane facing it is 1."""
    half = SUN / 2
    cosine = 1 - (np.arange(count) + 0.5) / count * (1 - math.cos(half))
    turn = np.arange(count) * (math.pi * (3 - math.sqrt(5)))
    sine = np.sqrt(1 - cosine**2)
    local = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], -1)
    theta, phi = LIGHT
    z = np.array((math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)))
    x = np.array((math.cos(theta) * math.cos(phi), math.cos(theta) * math.sin(phi), -math.sin(theta)))
    # Radiance 1 / (pi sin^2) over 2 pi (1 - cos) of solid angle.
    weight = 2 / (1 + math.cos(half)) / count
    return [Light(tuple(w), weight) for w in local @ np.stack([x, np.cross(z, x), z])]


def numpy_picture(technique: str, mapped: MappedSwatch, size: int, lights: list[Light]) -> np.ndarray:
    theta, phi = VIEW
    wo = techniques.direction(90 - math.degrees(theta), math.degrees(phi))
    return techniques.pixels(shade(technique, mapped, lights, wo, techniques.frame_uv(size, VIEW, 4)), 4)


@pytest.mark.parametrize("technique", ["lit_texture", "angular", "lookup"])
@pytest.mark.parametrize("lobe", [Lobe("oren_nayar", 0.6), Lobe("phong", 15.0, 0.4)], ids=lambda lobe: lobe.name)
def test_cycles_shows_what_numpy_finds(tmp_path: Path, technique: str, lobe: Lobe) -> None:
    """Mean, and texel by texel, within the noise of eight seeds; another technique must be found out."""
    render = RenderSettings(lobe, sigma=0.8, technique=technique, a_max=0.3)
    bundle = map_bundle(tmp_path / "rough", rough_map(size=6), render)
    mapped = techniques.mapped_swatch(bundle)
    assert ShadingMapRecord.read(bundle).map.level_by_cosine == tuple(KNOTS)
    size = 12
    with photograph_arc.gantry_scene(build_shading_map(bundle), size=size, samples=256, sun_angle=SUN) as scene:
        scene.set_view(*VIEW)
        scene.set_light(*LIGHT)
        seeds = np.stack([scene.render(seed) for seed in range(8)])
    expected = {name: numpy_picture(name, mapped, size, wide_sun(400)) for name in ("lit_texture", "angular", "lookup")}
    assert _distance(seeds, expected[technique]) < 4
    for other in set(expected) - {technique}:
        assert _distance(seeds, expected[other]) > 6, other
    # A light or an f_r that is 5 % off would be found as well.
    assert _distance(seeds, 1.05 * expected[technique]) > 4


def _distance(seeds: np.ndarray, expected: np.ndarray) -> float:
    """How many standard errors the pictures (K, H, W, 3) are off, in their mean or in the sum of all squares."""
    mean = seeds.mean((1, 2, 3))
    spread = max(mean.std(ddof=1) / math.sqrt(len(mean)), 1e-3 * expected.mean())
    whole = abs(mean.mean() - expected.mean()) / spread
    error = seeds.std(0, ddof=1) / math.sqrt(len(seeds))
    # Student's t of 7 degrees of freedom squares to 7 / 5 on the average, with a deviation of 2.4; the channels of
    # a pixel rise and fall together.
    # "lit_texture" has next to no noise: there the 16 points of numpy's pixel count, which are good to 0.2 % (rms).
    square = (((seeds.mean(0) - expected) / np.maximum(error, 5e-3 * expected)) ** 2).mean(-1)
    return max(whole, (float(square.mean()) - 1.4) / (2.4 / math.sqrt(square.size)))


@pytest.mark.slow
def test_eevee_shows_what_numpy_finds(tmp_path: Path) -> None:
    """Under two suns of different strength and colour. In a process of its own: without OpenGL it ends there."""
    render = RenderSettings(Lobe("lambert"), sigma=0.8, a_max=0.3)
    bundle = map_bundle(tmp_path / "rough", rough_map(size=6), render)
    size, shown = 12, ("final_radiance", "lit_texture")
    pictures = eevee_pictures(bundle, tmp_path, shown, VIEW, LIGHT, size)
    key = techniques.direction(90 - math.degrees(LIGHT[0]), math.degrees(LIGHT[1]))
    lights = [Light(key), Light(NORMAL, (3.0, 2.1, 1.2))]
    wo = techniques.direction(90 - math.degrees(VIEW[0]), math.degrees(VIEW[1]))
    mapped = techniques.mapped_swatch(bundle)
    for technique in shown:
        expected = shade(technique, mapped, lights, wo, techniques.frame_uv(size, VIEW))
        # EEVEE keeps radiance as half floats; measured 0.1 %.
        assert techniques.errors(pictures[technique], expected)["rms"] < 4e-3, technique
    lookup = shade("lookup", mapped, lights, wo, techniques.frame_uv(size, VIEW))
    assert techniques.errors(pictures["final_radiance"], lookup)["rms"] > 0.05
