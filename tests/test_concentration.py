"""How concentrated a sampler's draws are, and how often lamps are aimed at for it."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import TABLE_OF
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes.lobe_sampling import sample
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.concentration import concentration
from measured_materials.bake.sampling.lamps import ELLIPSE, SPHERE, SUN, Lamp, aim_numpy, aimed_part, lamp_table
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import trees_below
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.shading_map_material import build_shading_map
from numpy.typing import NDArray
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse_bakes
from support.osl import skip_without_osl
from support.swatches import identity_map, map_bundle
from test_light_sampling import LAMPS

Array = NDArray[np.float64]


def cosine(wo: Array, u: Array) -> tuple[Array, Array]:
    """Draws by the cosine, whatever the viewer."""
    wi = spherical(np.arcsin(np.sqrt(u[..., 0])), 2 * np.pi * u[..., 1])
    return wi, wi[..., 2] / np.pi


@pytest.mark.parametrize("anisotropic", [False, True])
def test_of_a_cosine(anisotropic: bool) -> None:
    """The integral of (cos / pi)^2 is 2 / (3 pi)."""
    assert concentration(cosine, anisotropic) == pytest.approx(2 / (3 * math.pi), rel=0.02)


@pytest.mark.parametrize("exponent", [20.0, 200.0, 2000.0])
def test_of_a_lobe(exponent: float) -> None:
    """Of cos^n (n + 1)^2 / (2 pi (2 n + 1)), by the four fifths of draws that follow it."""
    lobe = Lobe("phong", exponent, 0.0)
    of_lobe = 0.8**2 * (exponent + 1) ** 2 / (2 * math.pi * (2 * exponent + 1))
    found = concentration(lambda wo, u: sample(lobe, wo, u[..., :3]))
    assert found == pytest.approx(of_lobe, rel=0.1, abs=0.1)


def solid_angle(lamp: Lamp, position: tuple[float, float, float]) -> float:
    """That `aimed_part` has found: it is 1/2 + (1/2) / (1 + c omega / 10)."""
    row = lamp_table([lamp], 4)[0]
    part = float(aimed_part(xp_numpy, aim_numpy(row, np.array(position)), 5.0))
    return (0.5 / (part - 0.5) - 1) * 10 / 5


def test_of_lamps() -> None:
    """Against the solid angles of a far rectangle and ellipse, a sphere and a sun; at most 4 however near."""
    for name in ("rectangle", "ellipse"):
        lamp = LAMPS[name]
        axis, centre = np.array(lamp.axis), np.array(lamp.centre)
        place = centre + 20 * axis + np.array([3.0, 1.0, 2.0])
        gap = centre - place
        area = np.linalg.norm(lamp.u) * np.linalg.norm(lamp.v) * (math.pi / 4 if lamp.kind == ELLIPSE else 1)
        assert solid_angle(lamp, tuple(place)) == pytest.approx(-(gap @ axis) * area / (gap @ gap) ** 1.5, rel=1e-3)
        assert solid_angle(lamp, tuple(centre + 1e-4 * axis)) == pytest.approx(4, rel=1e-3)
        assert solid_angle(lamp, tuple(centre - axis)) == pytest.approx(0, abs=1e-5)
    ball = Lamp(SPHERE, 1.0, (0, 0, 2), extent=1.0)
    assert solid_angle(ball, (0, 0, 0)) == pytest.approx(2 * math.pi * (1 - math.sqrt(3) / 2), rel=1e-5)
    assert solid_angle(ball, (0, 0, 2.1)) == pytest.approx(4 * math.pi, rel=1e-5)
    assert solid_angle(Lamp(SUN, 1.0, extent=0.2), (0, 0, 0)) == pytest.approx(
        2 * math.pi * (1 - math.cos(0.1)), rel=1e-4
    )


def test_viewers_along_and_across_the_brushing_are_asked() -> None:
    asked: list[Array] = []

    def draw(wo: Array, u: Array) -> tuple[Array, Array]:
        asked.append(wo)
        return cosine(wo, u)

    concentration(draw, anisotropic=True)
    (wo,) = asked
    assert all((np.abs(wo[..., axis]) < 1e-9).any() for axis in (0, 1)) and len(np.unique(wo[:, 0], axis=0)) == 32


def test_an_even_sampler_aims_as_often_as_may_be() -> None:
    assert aimed_part(xp_numpy, aim_numpy(lamp_table([LAMPS["rectangle"]], 4)[0], np.zeros(3)), 0.0) == 1


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Glossy, of a table and a residual that are drawn by samplers of their own."""
    with coarse_bakes():
        source = analytic.Ward(diffuse=(0.2, 0.1, 0.1), specular=(0.2, 0.2, 0.2), alpha=0.1)
        return read_bundle(bake_source(source, tmp_path_factory.mktemp("glossy") / "glossy", BakeSettings()).path)


def told_to_aims(material: bpy.types.Material) -> list[float]:
    """By the nodes that aim."""
    nodes = (node for tree in trees_below(material.node_tree) for node in tree.nodes)
    groups = [node for node in nodes if node.bl_idname == "ShaderNodeGroup" and SLOTS_KEY in (node.node_tree or {})]
    return [node.inputs["Concentration"].default_value for node in groups if "Concentration" in node.inputs]


@pytest.mark.parametrize("mode", ["exact", "reference"])
def test_materials_tell_it_to_what_aims(bundle: Bundle, mode: str) -> None:
    """Aimed, sampled with what is aimed at instead, and as OSL; each of its own table."""
    table = BrdfRecord.of(bundle).baked(TABLE_OF[mode])
    expected = pytest.approx(concentration(table.load_sampler().sample))
    assert concentration(table.load_sampler().sample) > 1
    assert told_to_aims(build_material(bundle, mode=mode, lamps=lamp_image())) == [expected]
    skip_without_osl()
    if mode == "exact":
        sampling = build_material(bundle, mode=mode, lamps=lamp_image(), lights=lamp_light_image(), scripted=True)
        assert told_to_aims(sampling) == [expected]
    made = build_osl_material(bundle, mode=mode, lamps=lamp_image())
    scripts = [node for tree in trees_below(made.node_tree) for node in tree.nodes if "Direction" in node.outputs]
    assert [node.inputs["Concentration"].default_value for node in scripts] == [expected]


def test_swatches_tell_it(tmp_path: Path) -> None:
    """Of their lobe."""
    lobe = Lobe("phong", 100.0, 0.1)
    expected = pytest.approx(concentration(lambda wo, u: sample(lobe, wo, u[..., :3])))
    swatch = map_bundle(tmp_path / "swatch", identity_map(), RenderSettings(lobe, sigma=0.5))
    assert told_to_aims(build_shading_map(swatch, lamps=lamp_image())) == [expected]
    skip_without_osl()
    sampling = build_shading_map(swatch, lamps=lamp_image(), lights=lamp_light_image(), scripted=True)
    assert told_to_aims(sampling) == [expected]
