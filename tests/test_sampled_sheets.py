"""Sheets whose shader samples lamps on both sides, and the world's picture: against quadrature.

Here nodes ask scripts of OSL what their rays meet, as before Blender 5.1; `real_blender/sheets.py` has them use the
Raycast node.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from measured_materials.addon.lights.exact_lamps import rays_of_world, why_not_exact
from measured_materials.addon.lights.kept_surveys import surveyed
from measured_materials.addon.lights.lamp_survey import survey_scene
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.sampling.lamp_light import lamp_light_table
from measured_materials.bake.sampling.lamps import (
    RECTANGLE,
    SUN,
    Lamp,
    aim_at,
    aim_numpy,
    expected_light,
    expected_light_on_sheet,
    lamp_table,
)
from measured_materials.bake.source import Array
from measured_materials.nodes import compat
from measured_materials.nodes.aimed_light_group import aim_by
from measured_materials.nodes.group import call
from measured_materials.nodes.lamp_light_groups import LightTables, light_side_group
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_script import use_osl
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.direct_light import environment
from support.osl import skip_without_osl
from support.scenes import TestScene, add_lamp, diffuse_material
from support.sheet_scenes import (
    BEADED,
    BEFORE,
    BEHIND,
    GLAZED,
    LINED,
    PRISMATIC,
    RESOLUTION,
    SETTINGS,
    SHADE,
    assert_mean,
    lit_by,
    record_of,
    set_sky,
    sheet_scene,
    under_sky,
    viewer,
)
from test_sheet_material import Woven


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


@pytest.fixture(scope="module")
def glazed(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    """Of both sides alike, which takes half the time to compile."""
    return record_of(bake_source(GLAZED, tmp_path_factory.mktemp("glazed") / "glazed", SETTINGS))


@pytest.fixture(scope="module")
def beaded(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    return record_of(bake_source(BEADED, tmp_path_factory.mktemp("beaded") / "beaded", SETTINGS))


@pytest.fixture(scope="module")
def lined(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    """Front and back differ; what they reflect, native closures carry."""
    return record_of(bake_source(LINED, tmp_path_factory.mktemp("lined") / "lined", SETTINGS))


@contextmanager
def shown(theta: float) -> Iterator[TestScene]:
    """The scene, before anything lights it, with another material."""
    with sheet_scene(diffuse_material(), theta) as scene:
        use_osl(scene.scene)
        yield scene


def dress(scene: TestScene, record: BrdfRecord, sampled: bool = True) -> None:
    """The material of nodes, fitted to the scene as it is now."""
    update_scene(scene.scene)
    around = surroundings_of(surveyed(scene.scene)) if sampled else None
    lights = lamp_light_image() if sampled else None
    scene.show(
        build_material(
            record, mode="exact", lamps=lamp_image(), lights=lights, surroundings=around, scripted=sampled, pack=True
        )
    )
    update_scene(scene.scene)


def lit_by_sun(record: BrdfRecord, theta: float, towards: Vector, irradiance: float) -> Array:
    """Radiance (3,) under a sun so small that it is one direction."""
    energy, size, distance = irradiance * math.pi, 0.02, 200.0
    lamp = bpy.data.objects.new("far", bpy.data.lights.new("far", "AREA"))
    lamp.data.size = size
    lamp.data.energy = energy * distance**2
    eye = towards.normalized() * distance
    lamp.matrix_world = Matrix.Translation(eye) @ (-eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    found = lit_by(record, "exact", theta, lamp)
    bpy.data.objects.remove(lamp)
    return found


def add_sun(scene: TestScene, towards: tuple[float, float, float], energy: float) -> bpy.types.Object:
    return add_lamp(scene, "SUN", towards, energy=energy, angle=math.radians(0.5))


@pytest.mark.parametrize(
    ("theta", "place"),
    [
        pytest.param(80.0, BEHIND, marks=pytest.mark.slow),
        pytest.param(15.0, BEHIND, marks=pytest.mark.slow),
        pytest.param(60.0, BEFORE, marks=pytest.mark.slow),
        pytest.param(130.0, BEFORE, marks=pytest.mark.slow),
        pytest.param(150.0, BEHIND, marks=pytest.mark.slow),
    ],
)
def test_a_lamp_hidden_from_the_camera_loses_nothing(
    glazed: BrdfRecord, theta: float, place: tuple[float, float, float]
) -> None:
    """As Blender makes them: no Ray Portal of a camera's ray meets it, and its light is all sampled."""
    with shown(theta) as scene:
        lamp = add_lamp(scene, "AREA", place, energy=300, size=3.0)
        assert not lamp.visible_camera
        dress(scene, glazed)
        assert_mean(scene, lit_by(glazed, "exact", theta, lamp), samples=64)


def test_a_lamp_that_no_portal_meets_loses_nothing(tmp_path: Path) -> None:
    """Its mirrors lead to the lamp, by rays that stay the camera's."""
    prismatic = record_of(bake_source(PRISMATIC, tmp_path / "prismatic", SETTINGS))
    with shown(60.0) as scene:
        lamp = add_lamp(scene, "AREA", (2.0, 1.7, -1.5), energy=300, size=1.5)
        dress(scene, prismatic)
        assert_mean(scene, lit_by(prismatic, "exact", 60.0, lamp), samples=48)


@pytest.mark.slow
@pytest.mark.parametrize("theta", [40.0, 80.0])
def test_a_lamp_hidden_from_transmission_loses_nothing(glazed: BrdfRecord, theta: float) -> None:
    """Cycles' Translucent BSDF sees it all the same, but of a large one what its rays have to meet."""
    with shown(theta) as scene:
        lamp = add_lamp(scene, "AREA", BEHIND, energy=300, size=1.0)
        lamp.visible_camera, lamp.visible_transmission = True, False
        dress(scene, glazed)
        assert_mean(scene, lit_by(glazed, "exact", theta, lamp), samples=48)


@pytest.mark.slow
def test_a_lamp_that_the_camera_sees_is_not_counted_twice(glazed: BrdfRecord) -> None:
    """It is so large that mirrors meet it often."""
    with shown(80.0) as scene:
        lamp = add_lamp(scene, "AREA", (1, 1, -1.5), energy=300, size=6.0)
        lamp.visible_camera = True
        dress(scene, glazed)
        assert_mean(scene, lit_by(glazed, "exact", 80.0, lamp), samples=24)


@pytest.mark.parametrize(
    ("theta", "place"),
    [
        (40.0, (1.5, 1.3, 2.4)),
        pytest.param(40.0, (-1.5, -1.3, -2.4), marks=pytest.mark.slow),
        pytest.param(70.0, (2.2, 1.9, 1.1), marks=pytest.mark.slow),
        pytest.param(130.0, (1.9, 1.6, -2.1), marks=pytest.mark.slow),
    ],
)
def test_a_mirror_drawn_beyond_its_share_is_weighed_as_it_is_drawn(
    beaded: BrdfRecord, theta: float, place: tuple[float, float, float]
) -> None:
    """The lamp is so large that its points and the faint mirror's directions are about as dense."""
    with shown(theta) as scene:
        lamp = add_lamp(scene, "AREA", place, energy=300, size=3.0)
        dress(scene, beaded)
        assert_mean(scene, lit_by(beaded, "exact", theta, lamp), samples=64)


@pytest.mark.slow
@pytest.mark.parametrize("height", [2.3, -2.3])
def test_what_lies_behind_a_lamp_is_seen_as_often_as_it_should_be(glazed: BrdfRecord, height: float) -> None:
    """Sky, where the highlight is and straight on; the lamp is no brighter."""
    with shown(40.0) as scene:
        lamp = add_lamp(scene, "AREA", (-1.5, -1.2, height), energy=30, size=4.0)
        set_sky(scene.scene)
        dress(scene, glazed)
        assert_mean(scene, lit_by(glazed, "exact", 40.0, lamp) + under_sky(glazed, "exact", 40.0), samples=48)


@pytest.mark.slow
@pytest.mark.parametrize(("theta", "place"), [(40.0, BEHIND), (130.0, BEFORE), (150.0, BEHIND)])
def test_either_side_shows_what_is_its_own(lined: BrdfRecord, theta: float, place: tuple[float, float, float]) -> None:
    with shown(theta) as scene:
        lamp = add_lamp(scene, "AREA", place, energy=300, size=1.0)
        dress(scene, lined)
        assert_mean(scene, lit_by(lined, "exact", theta, lamp), samples=24)


@pytest.mark.parametrize("theta", [80.0, pytest.param(120.0, marks=pytest.mark.slow)])
def test_a_sheet_between_two_sources(glazed: BrdfRecord, theta: float) -> None:
    """A lamp on one side, a sun on the other, neither of them bright beyond the other."""
    with shown(theta) as scene:
        lamp = add_lamp(scene, "AREA", BEHIND, energy=300, size=1.0)
        sun = add_sun(scene, (-1, 0.5, 2), 4.0)
        dress(scene, glazed)
        truth = lit_by(glazed, "exact", theta, lamp)
        truth = truth + lit_by_sun(glazed, theta, Vector((-1, 0.5, 2)), sun.data.energy)
        assert_mean(scene, truth, samples=16)


def add_room(scene: TestScene) -> Array:
    """A smooth sky with a bright window above and another below; its pixels, row 0 at the zenith."""
    rows, columns = np.mgrid[:32, :64]
    height = np.cos((rows + 0.5) / 32 * np.pi)
    pixels = (0.3 + 0.2 * height + 0.05 * np.cos(columns * np.pi / 16))[..., None] * np.array([0.8, 0.9, 1.0])
    pixels[6:10, 40:44] = np.array([1.0, 0.9, 0.8]) * 30
    pixels[22:26, 8:12] = np.array([0.8, 0.9, 1.0]) * 40
    image = bpy.data.images.new("room", 64, 32, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.concatenate([pixels[::-1], np.ones((32, 64, 1))], -1).astype(np.float32).ravel())
    image.pack()
    scene.scene.world, background = compat.new_world("room")
    tree = scene.scene.world.node_tree
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = image
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    scene.scene.world.cycles.sampling_method, scene.scene.world.cycles.sample_map_resolution = "MANUAL", 256
    return pixels


@pytest.mark.parametrize("theta", [70.0, *(pytest.param(theta, marks=pytest.mark.slow) for theta in (20.0, 130.0))])
def test_the_world_s_picture_is_sampled_on_both_sides(glazed: BrdfRecord, theta: float) -> None:
    with shown(theta) as scene:
        pixels = add_room(scene)
        dress(scene, glazed)
        truth = under_sky(glazed, "exact", theta, environment(pixels))
        assert_mean(scene, truth, samples=48)


@pytest.mark.slow
def test_an_anisotropic_sheet_samples_along_the_tangent(tmp_path: Path) -> None:
    settings = BakeSettings(8, basis="normal", parameterization="uniform", sampler=SETTINGS.sampler, viewers=(6, 3))
    record = record_of(bake_source(Woven(), tmp_path / "woven", settings))
    for theta, height in ((40.0, -3), (140.0, 3)):
        with shown(theta) as scene:
            lamp = add_lamp(scene, "AREA", (2, -0.5, height), energy=300, size=2.0)
            dress(scene, record)
            assert_mean(scene, lit_by(record, "exact", theta, lamp), samples=24)


@pytest.mark.slow
def test_noise_under_a_lamp_behind_is_a_fraction(glazed: BrdfRecord) -> None:
    """Of the variance a fiftieth is left at most."""
    with shown(40.0) as scene:
        add_lamp(scene, "AREA", BEHIND, energy=300, size=0.5).visible_camera = True
        variances = []
        for sampled in (False, True):
            dress(scene, glazed, sampled)
            variances.append(float(scene.render(16, 4).var((1, 2)).mean()))
        assert variances[1] < 0.02 * variances[0]


@pytest.mark.slow
def test_a_large_lamp_seen_through_a_shade_is_found_by_what_lets_it_through(tmp_path: Path) -> None:
    """A quarter of the variance is left at most; 0.75 of it where mirrors are drawn by white light."""
    shade = record_of(bake_source(SHADE, tmp_path / "shade", SETTINGS))
    with shown(40.0) as scene:
        scene.scene.render.resolution_x = 4 * RESOLUTION
        lamp = add_lamp(scene, "AREA", tuple(-3 * viewer(40.0)), energy=300, size=2.0)
        lamp.visible_camera = True
        variances = []
        for sampled in (False, True):
            dress(scene, shade, sampled)
            variances.append(float(scene.render(16, 2).var((1, 2)).mean()))
        assert variances[1] < 0.25 * variances[0]


def test_which_rays_meet_a_light_is_known() -> None:
    """Under a film that shows nothing behind glass, the world is not sampled at all."""
    with sheet_scene(diffuse_material(), 40.0) as scene:
        set_unbiased(scene.scene, samples=1, seed=0)
        lamp = add_lamp(scene, "AREA", BEHIND, energy=300, size=1.0)
        for camera, diffuse, rays in ((False, True, 6), (True, True, 7), (True, False, 5), (False, False, 4)):
            lamp.visible_camera, lamp.visible_diffuse = camera, diffuse
            assert [light.rays for light in survey_scene(scene.scene).lights] == [rays]
        assert not why_not_exact(lamp, lamp.matrix_world)
        lamp.visible_transmission = False
        assert not why_not_exact(lamp, lamp.matrix_world) and survey_scene(scene.scene).lights[0].rays == 0
        add_room(scene)
        assert rays_of_world(scene.scene) == 7 and not survey_scene(scene.scene).world_inexact
        scene.scene.render.film_transparent = True
        assert rays_of_world(scene.scene) == 6 and survey_scene(scene.scene).world_rays == 6
        scene.scene.cycles.film_transparent_glass = True
        assert "Transparent Glass" in survey_scene(scene.scene).world_inexact


def test_what_an_instancer_hides_its_lamps_hide_too() -> None:
    """As Cycles has it: of both flags the lesser holds."""
    with sheet_scene(diffuse_material(), 40.0) as scene:
        lamp = add_lamp(scene, "AREA", BEHIND, energy=300, size=1.0)
        lamp.visible_camera = True
        collection, owner = bpy.data.collections.new("lamps"), bpy.data.objects.new("owner", None)
        scene.scene.collection.objects.unlink(lamp)
        collection.objects.link(lamp)
        owner.instance_type, owner.instance_collection = "COLLECTION", collection
        scene.scene.collection.objects.link(owner)

        def surveyed(for_render: bool) -> list[int]:
            return [light.rays for light in survey_scene(scene.scene, for_render=for_render).lights]

        for for_render in (False, True):
            assert surveyed(for_render) == [7]
            owner.visible_camera = owner.visible_transmission = False
            assert surveyed(for_render) == [2]
            owner.visible_glossy = False
            assert surveyed(for_render) == []
            owner.visible_camera = owner.visible_transmission = owner.visible_glossy = True


@pytest.mark.parametrize("kind", [RECTANGLE, SUN])
def test_light_of_either_side_is_expected_by_what_the_side_sends_on(kind: int) -> None:
    """Above the sheet as much as a surface gets, times the part that is reflected; below, times the rest."""
    xp, normal = xp_numpy, np.array([0.0, 0.0, 1.0])
    for height, part in ((2.0, 0.3), (-2.0, 0.7)):
        up = normal * np.sign(height)
        lamp = Lamp(
            kind,
            3.0,
            (0.0, 0.0, height),
            (0.5, 0.0, 0.0),
            (0.0, 0.5, 0.0),
            tuple(up * (1 if kind == SUN else -1)),
            0.02,
        )
        aim = aim_at(
            xp,
            np.zeros(3),
            np.array(lamp.place()),
            float(lamp.kind),
            np.array(lamp.u),
            np.array(lamp.v),
            np.array(lamp.axis),
            lamp.fourth(),
        )
        alone = expected_light(xp, aim, up, lamp.power)
        assert expected_light_on_sheet(xp, aim, normal, lamp.power, 0.3) == pytest.approx(part * alone)
        assert expected_light(xp, aim, -up, lamp.power) == 0
        assert expected_light_on_sheet(xp, aim, normal, lamp.power, 0.0) > 0


@pytest.mark.parametrize("sky", [0.0, 0.7])
def test_the_mirror_is_drawn_by_the_light_of_its_side(sky: float) -> None:
    """Two lamps and what comes from everywhere; where no light is known, by the parts of white light."""
    rng, count, least, xp = np.random.default_rng(3), 2000, 0.1, xp_numpy
    lamps = [
        Lamp(RECTANGLE, 3.0, (0.2, 0.1, z), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, -math.copysign(1, z)))
        for z in (2.0, -1.5)
    ]
    table = lamp_table(lamps, 4, sky)
    tables = LightTables(data_image("lamps", table), data_image("lights", lamp_light_table([], 4)), sheet=True)
    position = rng.uniform(-0.5, 0.5, (count, 3)).astype(np.float32)
    normal = np.asarray(xp.normalize(rng.normal(size=(count, 3))), np.float32)
    front = rng.uniform(0.1, 0.9, count).astype(np.float32)
    group = light_side_group(tables, least)
    assert card(lambda *a: call(group, *a), position, normal, front)[0] == pytest.approx(front, abs=1e-6)
    aim_by(group, 2, False)
    (found,) = card(lambda *a: call(group, *a), position, normal, front)
    p, n, part = (values.astype(float) for values in (position, normal, front))
    aims = [aim_numpy(row, p) for row in table[:2]]
    light = np.stack([expected_light_on_sheet(xp, aim, n, 3.0, part) for aim in aims])
    above = np.stack([xp.dot(aim.axis, n) > 0 for aim in aims])
    truth = ((light * above).sum(0) + sky * part) / (light.sum(0) + sky)
    assert found == pytest.approx(np.clip(truth, least, 1 - least), abs=1e-4)
