"""Lamps that a shader samples: their light against what Cycles' own card receives, and when it is not known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from measured_materials.addon.lights.aim_targets import sampling_of
from measured_materials.addon.lights.lamp_survey import LampReport, survey_scene
from measured_materials.addon.lights.light_tables import lamp_light_image, table_of, update_scene
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.lamp_light import (
    beam_factor,
    distance_along,
    facing_aim,
    lamp_light_table,
    opposite,
)
from measured_materials.bake.sampling.lamps import SUN, Aim, aim_numpy, density_towards, draw_towards
from measured_materials.bake.source import Array
from measured_materials.nodes import compat
from scipy import stats
from support.lamp_pictures import LUMINANCE, LampRoom
from support.osl import header_card, skip_without_osl

PLACE = Vector((0.6, -0.9, 1.4))
TURNED = Matrix.Translation(PLACE) @ (-PLACE).to_track_quat("-Z", "Y").to_matrix().to_4x4()
ASKEW = TURNED @ Matrix.Rotation(0.35, 4, "Y") @ Matrix.Rotation(0.4, 4, "Z")
# The card lies in the soft edge of a spot's cone.
ON_EDGE = TURNED @ Matrix.Rotation(0.4, 4, "Y")
LAMPS: dict[str, tuple[str, dict[str, Any]]] = {
    "point": ("POINT", {"energy": 40, "shadow_soft_size": 0.4}),
    "ball": ("POINT", {"energy": 40, "shadow_soft_size": 0.4, "use_soft_falloff": False}),
    "ball per size": ("POINT", {"energy": 40, "shadow_soft_size": 0.3, "use_soft_falloff": False, "normalize": False}),
    "spot": ("SPOT", {"energy": 40, "shadow_soft_size": 0.2, "spot_size": 1.1, "spot_blend": 0.8}),
    "hard spot": ("SPOT", {"energy": 40, "shadow_soft_size": 0.3, "spot_size": 1.3, "spot_blend": 0.0}),
    "sun": ("SUN", {"energy": 2, "angle": 0.5}),
    "square": ("AREA", {"energy": 40, "size": 0.8}),
    "ellipse": ("AREA", {"energy": 40, "shape": "ELLIPSE", "size": 1.1, "size_y": 0.5}),
    "square per size": ("AREA", {"energy": 40, "size": 0.8, "normalize": False}),
    "wide spread": ("AREA", {"energy": 40, "size": 0.5, "spread": 2.4}),
    "narrow spread": ("AREA", {"energy": 40, "shape": "DISK", "size": 0.9, "spread": 0.9}),
}
GRID = 256


@pytest.fixture
def room() -> Iterator[LampRoom]:
    with LampRoom() as room:
        yield room


def seen_by(report: LampReport, position: Array) -> tuple[Aim, Array, bool]:
    """The first lamp from positions (P, 3), what it emits as its row of the table, and whether it is a facing disk."""
    light = lamp_light_table(report.lights, 1)[0].astype(float)
    aim = aim_numpy(table_of(report)[0], position)
    return facing_aim(xp_numpy, aim, light[0, 3]), light, light[0, 3] > 0.5


def arriving(report: LampReport, normal: Array, numbers: Array, position: Array) -> Array:
    """Radiance times cosine over density (P, 3) of the points drawn by numbers (P, 2)."""
    aim, light, _ = seen_by(report, position)
    wi = draw_towards(xp_numpy, aim, numbers[:, 0], numbers[:, 1])
    density = density_towards(xp_numpy, aim, wi, np.ones(len(wi)))
    beam = np.broadcast_to(light[1, :3], wi.shape)
    factor = beam_factor(xp_numpy, aim.normal, beam, wi) * np.maximum(wi @ normal, 0)
    return light[0, :3] * np.where(density > 0, factor / np.maximum(density, 1e-30), 0)[:, None]


@pytest.mark.parametrize("form", ["as it is", "scaled"])
@pytest.mark.parametrize("kind", LAMPS)
def test_lamps_give_a_card_what_cycles_gives_it(room: LampRoom, kind: str, form: str) -> None:
    """Near, askew and in colour, so that extent, beam and falloff tell."""
    blender_kind, settings = LAMPS[kind]
    scale = Matrix.Diagonal((1.4, 1.4, 1.4, 1)) if form == "scaled" else Matrix.Identity(4)
    room.add(blender_kind, (ON_EDGE if "spot" in kind else ASKEW) @ scale, color=(1.0, 0.6, 0.2), **settings)
    report = survey_scene(room.scene, for_render=True)
    assert not report.inexact
    u = (np.arange(GRID) + 0.5) / GRID
    numbers = np.stack(np.meshgrid(u, u), -1).reshape(-1, 2)
    normal = np.array([0.2, 0.1, 1.0]) / math.sqrt(1.05)
    mean = arriving(report, normal, numbers, np.zeros((len(numbers), 3))).mean(0)
    seen = room.irradiance((0, 0, 0), normal, samples=1024)
    # Of Cycles' own noise up to 0.3 % was seen, at a spot's soft edge.
    assert mean @ LUMINANCE == pytest.approx(seen, rel=0.006)
    assert mean / mean[0] == pytest.approx([1.0, 0.6, 0.2], rel=1e-5)


@pytest.mark.parametrize("kind", LAMPS)
def test_points_lie_on_the_lamp(room: LampRoom, kind: str) -> None:
    """The distance along a drawn direction ends on the lamp's surface: at its plane, its ball, or its disk."""
    blender_kind, settings = LAMPS[kind]
    room.add(blender_kind, ASKEW, **settings)
    numbers = np.random.default_rng(1).uniform(size=(400, 2))
    position = np.random.default_rng(2).uniform(-0.2, 0.2, (400, 3))
    aim, _, facing = seen_by(survey_scene(room.scene, for_render=True), position)
    wi = draw_towards(xp_numpy, aim, numbers[:, 0], numbers[:, 1])
    distance = distance_along(xp_numpy, aim, np.full(400, float(facing)), wi)
    if aim.kind[0] == SUN:
        assert (distance > 1e20).all()
        return
    from_centre = distance[:, None] * wi - aim.to_centre
    if blender_kind == "AREA":
        assert np.abs((from_centre * aim.normal).sum(-1)).max() < 1e-6
    elif facing:
        assert np.abs((from_centre * aim.to_centre).sum(-1)).max() < 1e-6
        assert (np.linalg.norm(from_centre, axis=-1) < 1.001 * settings["shadow_soft_size"]).all()
    else:
        assert np.linalg.norm(from_centre, axis=-1) == pytest.approx(settings["shadow_soft_size"], rel=1e-4)


DRAWS, BINS, FINER = 1_000_000, (80, 160), 8
# From here each is seen askew; from the last the ball is all around.
SEEN_FROM = {
    "square": (0.2, 0.1, 0.0),
    "ellipse": (0.0, 0.0, 0.0),
    "narrow spread": (0.3, -0.2, 0.1),
    "point": (0.1, 0.0, 0.0),
    "ball": (0.0, 0.1, 0.0),
    "sun": (0.0, 0.0, 0.0),
    "ball from within": (0.55, -0.8, 1.3),
}


@pytest.mark.parametrize("place", SEEN_FROM)
def test_points_are_drawn_by_their_density(room: LampRoom, place: str) -> None:
    """Chi-square over a cone around the lamp, the density by quadrature; Sidak over the cases, 1 % in all."""
    kind, settings = LAMPS[place.removesuffix(" from within")]
    room.add(kind, ASKEW, **settings)
    aim, _, _ = seen_by(survey_scene(room.scene, for_render=True), np.array([SEEN_FROM[place]]))
    wi = draw_towards(xp_numpy, aim, *np.random.default_rng(5).uniform(size=(2, DRAWS)))
    turn = np.array(Vector(wi.mean(0)).to_track_quat("Z", "Y").to_matrix())
    local = wi @ turn
    leaning = np.maximum(1 - local[:, 2], 0)
    widest = min(1.001 * float(leaning.max()), 2.0)
    cells = leaning / widest, np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) % 1
    seen = np.histogram2d(*cells, bins=BINS, range=((0, 1), (0, 1)))[0]
    assert seen.sum() == DRAWS
    lean, around = np.meshgrid(*((np.arange(n * FINER) + 0.5) / (n * FINER) for n in BINS), indexing="ij")
    nodes = spherical(np.arccos(1 - widest * lean), 2 * np.pi * around).reshape(-1, 3) @ turn.T
    density = density_towards(xp_numpy, aim, nodes, 0.0).reshape(BINS[0], FINER, BINS[1], FINER)
    expected = density.mean((1, 3)) * (2 * np.pi * widest / (BINS[0] * BINS[1])) * DRAWS
    # Bins across the edge of a lamp are known to a few parts in a thousand of a full one.
    assert expected.sum() == pytest.approx(DRAWS, rel=1e-3)
    often = expected > 20
    assert often.sum() > 1000
    counts, chances = (np.append(n[often], n[~often].sum()) for n in (seen, expected))
    statistic = float(((counts - chances) ** 2 / np.maximum(chances, 20)).sum())
    assert stats.chi2.sf(statistic, len(counts) - 1) > 1 - 0.99 ** (1 / len(SEEN_FROM))


@pytest.mark.parametrize("kind", ["square", "ellipse", "sun", "ball"])
@pytest.mark.parametrize("j", [1, 2, 3])
def test_opposite_points_are_as_even(room: LampRoom, kind: str, j: int) -> None:
    """The mean over all numbers stays, and what grows across the lamp cancels between the first two points."""
    room.add(LAMPS[kind][0], ASKEW, **LAMPS[kind][1])
    report = survey_scene(room.scene, for_render=True)
    u = (np.arange(64) + 0.5) / 64
    first = np.stack(np.meshgrid(u, u), -1).reshape(-1, 2)
    shape = np.full(len(first), float(report.lamps[0].kind))
    other = np.stack(opposite(xp_numpy, shape, j, first[:, 0], first[:, 1]), -1)
    normal, position = np.array([0.0, 0.0, 1.0]), np.zeros((len(first), 3))
    one, two = (arriving(report, normal, numbers, position)[:, 0] for numbers in (first, other))
    assert two.mean() == pytest.approx(one.mean(), rel=1e-3)
    if j == 1:
        assert np.std(0.5 * (one + two)) < 0.45 * np.std(one)


@pytest.mark.parametrize("kind", LAMPS)
def test_osl_is_numpy(room: LampRoom, kind: str) -> None:
    """Directions, densities, beams and distances of the shader's headers."""
    skip_without_osl()
    room.add(LAMPS[kind][0], ASKEW, color=(0.3, 0.9, 0.5), **LAMPS[kind][1])
    report = survey_scene(room.scene, for_render=True)
    rng = np.random.default_rng(3)
    position, numbers = rng.uniform(-0.3, 0.3, (900, 3)), rng.uniform(0.01, 0.99, (900, 2))
    lamp, (radiance, beam) = table_of(report)[0].astype(float), lamp_light_table(report.lights, 1)[0].astype(float)
    texels = [f"vector({', '.join(f'{x:.9g}' for x in lamp[k, :3])})" for k in range(4)]
    facts = f"vector({lamp[0, 3]:.9g}, {lamp[1, 3]:.9g}, {lamp[3, 3]:.9g})"
    more = [f"vector({', '.join(f'{x:.9g}' for x in v[:3])})" for v in (radiance, beam)]
    body = f"""
    MMLamp lamp = {{{", ".join([*texels, facts, *more])}, {radiance[3]:g}}};
    MMAim aim = mm_lamp_seen(lamp, point(at));
    float s, t;
    mm_opposite(aim.kind, 1, n[0], n[1], s, t);
    wi = mm_draw_towards(aim, s, t);
    told = vector(mm_density_towards(aim, wi, 1), mm_beam(lamp, wi), mm_distance_along(aim, wi, lamp.facing));
    """
    wi, told = header_card(
        body,
        {"wi": "vector", "told": "vector"},
        "measured_direct.h",
        at=position.astype(np.float32),
        n=np.pad(numbers, ((0, 0), (0, 1))).astype(np.float32),
    )
    position = position.astype(np.float32).astype(float)
    numbers = numbers.astype(np.float32).astype(float)
    aim, light, facing = seen_by(report, position)
    pair = opposite(xp_numpy, aim.kind, 1, numbers[:, 0], numbers[:, 1])
    expected = draw_towards(xp_numpy, aim, *pair)
    assert np.abs(wi - expected).max() < 2e-6
    distance = np.minimum(distance_along(xp_numpy, aim, np.full(900, float(facing)), expected), 1e30)
    factor = beam_factor(xp_numpy, aim.normal, np.broadcast_to(light[1, :3], expected.shape), expected)
    density = density_towards(xp_numpy, aim, expected, np.ones(900))
    # At the rim of a ball the root of a difference ends on the surface: 1e-5 of the distance was seen.
    # The steepness of a hard spot's edge magnifies the rounding of its cosine.
    clear = (factor == 0) | (factor > 0.01) if kind != "hard spot" else (factor == 0) | (factor == 1)
    assert clear.mean() > 0.95
    for k, (values, tolerance) in enumerate(((density, 1e-4), (factor, 2e-4), (distance, 3e-5))):
        scale = np.abs(values).max() if k == 1 else np.abs(values)
        off = np.abs(told[:, k] - values) / np.maximum(scale, 1e-6)
        assert off[clear].max() < tolerance, (k, off[clear].max())


def no_shadows(lamp: bpy.types.Object) -> None:
    lamp.data.use_shadow = False


def one_receiver(lamp: bpy.types.Object) -> None:
    lamp.light_linking.receiver_collection = bpy.data.collections.new("only these")


def some_blockers(lamp: bpy.types.Object) -> None:
    lamp.light_linking.blocker_collection = bpy.data.collections.new("only these")


def few_bounces(lamp: bpy.types.Object) -> None:
    lamp.data.cycles.max_bounces = 2


def parallel(lamp: bpy.types.Object) -> None:
    lamp.data.spread = 0.001


def textured(lamp: bpy.types.Object) -> None:
    lamp.data.use_nodes = True
    tree = lamp.data.node_tree
    emission = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeEmission")
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], emission.inputs["Strength"])


@pytest.mark.parametrize("change", [no_shadows, one_receiver, some_blockers, few_bounces, parallel, textured])
def test_what_is_not_known_is_left_to_the_mirror(room: LampRoom, change: Any) -> None:
    """And what was changed back is sampled again."""
    lamp = room.add("AREA", ASKEW, energy=10, size=0.5)
    before = survey_scene(room.scene, for_render=True)
    assert not before.inexact and not sampling_of(before, osl=True).impossible
    change(lamp)
    report = survey_scene(room.scene, for_render=True)
    assert report.lamps and report.inexact.startswith(f"{lamp.name}: ")
    assert sampling_of(report, osl=True).impossible == report.inexact
    lamp.hide_render = True
    assert not survey_scene(room.scene, for_render=True).inexact


def test_filter_glossy_and_light_groups_are_told(room: LampRoom) -> None:
    """Cycles blurs a mirror by the one, and would add emission to another group than the lamp's."""
    lamp = room.add("POINT", ASKEW, energy=10, shadow_soft_size=0.1)
    room.scene.cycles.blur_glossy = 1.0
    assert "Filter Glossy" in survey_scene(room.scene, for_render=True).inexact
    room.scene.cycles.blur_glossy = 0.0
    lamp.lightgroup = "key"
    assert "light group key" in survey_scene(room.scene, for_render=True).inexact


def test_a_moving_lamp_and_a_shutter_that_is_not_centred(room: LampRoom) -> None:
    """Cycles shows it where it is when half of the shutter's time is over, and the table holds where it is now."""
    lamp, render = room.add("POINT", ASKEW, energy=10, shadow_soft_size=0.1), room.scene.render
    render.use_motion_blur, render.motion_blur_position = True, "START"
    assert not survey_scene(room.scene, for_render=True).inexact
    lamp.keyframe_insert("location", frame=1)
    assert f"{lamp.name} may move" in survey_scene(room.scene, for_render=True).inexact
    render.motion_blur_position = "CENTER"
    assert not survey_scene(room.scene, for_render=True).inexact
    render.use_motion_blur, render.motion_blur_position = False, "END"
    assert not survey_scene(room.scene, for_render=True).inexact
    lamp.animation_data_clear()
    render.use_motion_blur = True
    room.scene.collection.objects.unlink(lamp)
    held = bpy.data.collections.new("held")
    held.objects.link(lamp)
    empty = room.empty(Matrix.Identity(4))
    empty.instance_type, empty.instance_collection = "COLLECTION", held
    assert not survey_scene(room.scene, for_render=True).inexact
    empty.keyframe_insert("location", frame=1)
    assert f"{empty.name} may move" in survey_scene(room.scene, for_render=True).inexact


def test_the_table_of_light_follows_the_lamps(room: LampRoom) -> None:
    """Colour, energy, beam; dark at once where something is not known, whatever the nodes are switched to."""
    lamp = room.add("SPOT", ASKEW, energy=10, shadow_soft_size=0.1, spot_size=1.0)
    table = lamp_light_image()

    def row() -> Array:
        values = np.empty(len(table.pixels), np.float32)
        table.pixels.foreach_get(values)
        return values.reshape(table.size[1], -1)[-1]

    seen = []
    for name, value in (("energy", 20.0), ("color", (1.0, 0.2, 0.1)), ("spot_size", 0.5), ("use_soft_falloff", False)):
        setattr(lamp.data, name, value)
        report = update_scene(room.scene, for_render=True)
        assert row() == pytest.approx(lamp_light_table(report.lights, 1)[0].ravel(), rel=1e-6)
        seen.append(row().tobytes())
    assert len(set(seen)) == 4
    lamp.data.use_shadow = False
    assert update_scene(room.scene, for_render=True).inexact and not row()[:3].any()
    bpy.data.images.remove(table)


def test_from_inside_a_ball_its_far_side_is_met(room: LampRoom) -> None:
    room.add("POINT", Matrix.Translation((0, 0, 0.2)), energy=10, shadow_soft_size=0.5, use_soft_falloff=False)
    aim, _, _ = seen_by(survey_scene(room.scene, for_render=True), np.zeros((2, 3)))
    wi = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert distance_along(xp_numpy, aim, np.zeros(2), wi) == pytest.approx([0.7, 0.3], rel=1e-6)


def test_an_unevenly_scaled_spot_is_not_known(room: LampRoom) -> None:
    """Scale deforms its cone, not its ball."""
    spot = room.add("SPOT", ASKEW @ Matrix.Diagonal((1, 1.3, 1, 1)), energy=10, spot_size=1.0, shadow_soft_size=0.1)
    assert "unevenly" in survey_scene(room.scene, for_render=True).inexact
    spot.matrix_world = ASKEW @ Matrix.Diagonal((1.3, 1.3, 1.3, 1))
    assert not survey_scene(room.scene, for_render=True).inexact


def test_a_volume_is_passed_by_rays_that_ask(room: LampRoom) -> None:
    """In the world or in a material, as long as something uses it."""
    room.add("POINT", ASKEW, energy=10, shadow_soft_size=0.1)
    world, _ = compat.new_world("fog")
    tree = world.node_tree
    output = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(tree.nodes.new("ShaderNodeVolumeScatter").outputs[0], output.inputs["Volume"])
    assert not survey_scene(room.scene, for_render=True).inexact
    room.scene.world = world
    assert "volume in world fog" in survey_scene(room.scene, for_render=True).inexact
    room.scene.world = None
    bpy.data.worlds.remove(world)
