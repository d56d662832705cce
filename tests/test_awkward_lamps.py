"""The survey of lamps against Cycles' own picture of them: every kind scaled, sheared, parented, hidden, instanced."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector
from measured_materials.addon.lights.lamp_survey import CAPACITY, survey_scene
from measured_materials.addon.lights.light_tables import table_of
from measured_materials.bake import xp_numpy
from measured_materials.bake.sampling.lamps import (
    ELLIPSE,
    RECTANGLE,
    SPHERE,
    SUN,
    Lamp,
    aim_numpy,
    density_towards,
    expected_light,
    lamp_table,
)
from support.lamp_pictures import LampRoom

PLACE = Vector((1.0, -1.5, 3.0))
EYE = (0.0, 0.0, 0.0)
TO_LAMP = PLACE.normalized()
KINDS: dict[str, tuple[str, int, dict[str, Any]]] = {
    "point": ("POINT", SPHERE, {"energy": 100, "shadow_soft_size": 0.15}),
    "point, a ball": ("POINT", SPHERE, {"energy": 100, "shadow_soft_size": 0.15, "use_soft_falloff": False}),
    "point, per size": ("POINT", SPHERE, {"energy": 100, "shadow_soft_size": 0.15, "normalize": False}),
    "spot": ("SPOT", SPHERE, {"energy": 100, "shadow_soft_size": 0.15, "spot_size": 1.6}),
    "sun": ("SUN", SUN, {"energy": 2, "angle": 0.2}),
    "plain sun": ("SUN", SUN, {"energy": 2, "angle": math.radians(0.526)}),
    "square": ("AREA", RECTANGLE, {"energy": 100, "size": 0.3}),
    "rectangle": ("AREA", RECTANGLE, {"energy": 100, "shape": "RECTANGLE", "size": 0.3, "size_y": 0.12}),
    "disk": ("AREA", ELLIPSE, {"energy": 100, "shape": "DISK", "size": 0.3}),
    "ellipse": ("AREA", ELLIPSE, {"energy": 100, "shape": "ELLIPSE", "size": 0.3, "size_y": 0.12}),
    "rectangle, per size": (
        "AREA",
        RECTANGLE,
        {"energy": 100, "shape": "RECTANGLE", "size": 0.3, "size_y": 0.12, "normalize": False},
    ),
    "ellipse, per size": (
        "AREA",
        ELLIPSE,
        {"energy": 100, "shape": "ELLIPSE", "size": 0.3, "size_y": 0.12, "normalize": False},
    ),
}
SHEAR = Matrix(((1, 0.3, 0.1, 0), (0, 1, 0.2, 0), (0, 0, 1, 0), (0, 0, 0, 1)))


def scaled(x: float, y: float, z: float) -> Matrix:
    return Matrix.Diagonal((x, y, z, 1))


FORMS = {
    "as it is": scaled(1, 1, 1),
    "scaled": scaled(1.7, 1.7, 1.7),
    "unevenly scaled": scaled(2, 0.6, 1.4),
    "mirrored": scaled(-1.3, 1, 0.8),
    "turned inside out": Matrix.Rotation(math.pi, 4, "X") @ scaled(-1, -1.5, -2),
    "sheared": SHEAR,
}
# A little askew, so that no edge runs along the pixels.
ASKEW = (
    Matrix.Translation(PLACE)
    @ (-PLACE).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    @ Euler((0.06, -0.05, 0.4)).to_matrix().to_4x4()
)


@pytest.fixture
def room() -> Iterator[LampRoom]:
    with LampRoom() as room:
        yield room


def light_of(lamp: Lamp, place: Any = EYE) -> float:
    """Irradiance, face to face, that the table's row gives a place."""
    (aim,) = [aim_numpy(table_row(lamp), np.array([place]))]
    towards = aim.axis if lamp.kind == SUN else aim.to_centre / np.linalg.norm(aim.to_centre)
    return float(expected_light(xp_numpy, aim, towards, lamp.power)[0])


def table_row(lamp: Lamp) -> np.ndarray:
    return lamp_table([lamp], 1)[0]


PLACINGS = ("by itself", "by a parent's inverse", "by a scaled parent")
# An object alone cannot be sheared.
FORMS_PLACED = [(f, p) for f in FORMS for p in PLACINGS if (f, p) != ("sheared", "by itself")]


@pytest.mark.parametrize("form, placed", FORMS_PLACED)
@pytest.mark.parametrize("kind", KINDS)
def test_the_table_is_the_lamp_that_cycles_shows(room: LampRoom, kind: str, form: str, placed: str) -> None:
    """Its silhouette, pixel by pixel, and its irradiance on a card; or the reason why it is not aimed at."""
    blender_kind, table_kind, settings = KINDS[kind]
    lamp = room.add(blender_kind, **settings)
    whole = ASKEW @ FORMS[form]
    if placed == "by itself":
        lamp.matrix_world = whole
    else:
        parent = Matrix.Rotation(0.5, 4, "X") @ scaled(3, 0.5, 1) if placed == "by a scaled parent" else ASKEW
        lamp.parent = room.empty(parent)
        lamp.matrix_parent_inverse = parent.inverted() @ whole
    report = survey_scene(room.scene, for_render=True)
    if form == "sheared" and blender_kind == "AREA":
        assert not report.lamps and "sheared" in report.left_out[0]
        return
    (found,) = report.lamps
    assert found.kind == table_kind
    half_angle = 0.75 * settings["angle"] if table_kind == SUN else 0.14
    towards = found.axis if table_kind == SUN else PLACE
    picture = room.picture(EYE, towards, half_angle)
    table = table_of(report)
    aim = aim_numpy(table[0], np.zeros((*picture.lit.shape, 3)))
    hit = density_towards(xp_numpy, aim, picture.directions, np.zeros(picture.lit.shape)) > 0
    assert 50 < picture.lit.sum() < 0.8 * picture.lit.size
    # Pixels on the edge may fall to either side: float32, and a disc that faces the eye where the table has a ball.
    assert (hit != picture.lit).sum() <= 0.01 * picture.lit.sum() + 1
    seen = room.irradiance(EYE, towards)
    # Of a lamp's extent, which the power at a distance leaves out, up to 0.8 % is seen.
    assert light_of(found) == pytest.approx(seen, rel=0.015)


@pytest.mark.parametrize("blend", [0.1, 1.0])
@pytest.mark.parametrize("form", FORMS)
def test_a_spots_cone_is_deformed_with_it(room: LampRoom, form: str, blend: float) -> None:
    """Towards places in and beside the cone, along its edge, which scale and shear make an ellipse."""
    lamp = room.add("SPOT", energy=100, shadow_soft_size=0.01, spot_size=1.2, spot_blend=blend)
    whole = ASKEW @ FORMS[form]
    lamp.parent = room.empty(Matrix.Identity(4))
    lamp.matrix_parent_inverse = whole
    full = 100 / (4 * math.pi) / 4
    inside = 0
    for turn in range(8):
        for reach in (0.3, 0.6, 0.66, 0.8):
            ray = whole.to_3x3() @ Vector((reach * math.cos(turn), reach * math.sin(turn), -1))
            place = PLACE + 2 * ray.normalized()
            seen = room.irradiance(place, PLACE - place, 16)
            if seen == 0 and form == "sheared":
                continue  # Cycles cuts the tips of a sheared cone off, by a bound that knows no shear
            (found,) = survey_scene(room.scene, for_render=True).lamps
            # Never quite dark in the table: the lit place stands for all that is lit.
            assert found.power / 4 == pytest.approx(max(seen, 0.05 * full), rel=0.01, abs=0.002 * full)
            inside += seen > 0.05 * full
    assert 8 <= inside < 32


@pytest.mark.parametrize("scale", [(0, 1, 1), (1, 0, 1), (1, 1, 0), (0, 0, 0), (1e-3, 1, 1)])
@pytest.mark.parametrize("kind", ["point", "spot", "sun", "square", "ellipse"])
def test_lamps_scaled_to_nothing(room: LampRoom, kind: str, scale: tuple[float, float, float]) -> None:
    """A finite table, of the lamp that Cycles shows or without one; of a spot hardly a cone is left, or none."""
    blender_kind, _, settings = KINDS[kind]
    room.add(blender_kind, ASKEW @ scaled(*scale), **settings)
    report = survey_scene(room.scene, for_render=True)
    assert np.isfinite(table_of(report)).all()
    seen = room.irradiance(EYE, TO_LAMP, 16)
    if report.lamps:
        assert seen > 0 or kind == "spot"
    else:
        assert (seen == 0 or kind == "spot") and "scaled to nothing" in report.left_out[0]


# --- what a render shows ----------------------------------------------------------------------------------

Way = Callable[[LampRoom, Any], None]


def in_collection(room: LampRoom, lamp: Any) -> bpy.types.Collection:
    collection = bpy.data.collections.new("lamps")
    room.scene.collection.objects.unlink(lamp)
    collection.objects.link(lamp)
    return collection


def of_object(name: str) -> Way:
    return lambda room, lamp: setattr(lamp, name, True)


def of_collection(name: str) -> Way:
    def way(room: LampRoom, lamp: Any) -> None:
        collection = in_collection(room, lamp)
        room.scene.collection.children.link(collection)
        layer = room.scene.view_layers[0].layer_collection.children[0]
        setattr(layer if name in ("exclude", "indirect_only") else collection, name, True)

    return way


def instanced(name: str = "", of: str = "collection", nested: bool = False) -> Way:
    """Instanced by an unevenly scaled empty, with something hidden."""

    def way(room: LampRoom, lamp: Any) -> None:
        collection = in_collection(room, lamp)
        collection.instance_offset = (0.1, 0, 0.4)
        instancer = room.empty(Matrix.Translation((0, 0, 1)) @ scaled(0.5, 1, 1.2))
        instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
        if nested:
            outer = in_collection(room, instancer)
            again = room.empty(Matrix.Translation((0, 0.3, 0)))
            again.instance_type, again.instance_collection = "COLLECTION", outer
        if name:
            setattr({"collection": collection, "instancer": instancer, "lamp": lamp}[of], name, True)

    return way


def with_parent_inverse(room: LampRoom, lamp: Any) -> None:
    lamp.parent = room.empty(Matrix.Translation((0, 0, 1)))
    lamp.matrix_parent_inverse = Matrix.Translation((0.3, 0, 0)) @ scaled(1, 1, 1.1)
    lamp.hide_viewport = True


def eye_closed(room: LampRoom, lamp: Any) -> None:
    lamp.hide_set(True, view_layer=room.scene.view_layers[0])


def on_vertices(room: LampRoom, lamp: Any) -> None:
    mesh = bpy.data.meshes.new("points")
    mesh.from_pydata([(0, 0, 1), (1, 0, 1)], [], [])
    lamp.parent = room._link("points", mesh)
    lamp.parent.instance_type = "VERTS"


def hidden_with_parents(room: LampRoom, lamp: Any) -> None:
    above = room.empty(Matrix.Identity(4))
    lamp.parent = room.empty(Matrix.Identity(4))
    lamp.parent.parent = above
    lamp.matrix_parent_inverse = Matrix.Translation((0.3, 0, 0)) @ scaled(1, 1, 1.1)
    lamp.hide_viewport = lamp.parent.hide_viewport = above.hide_viewport = True
    room.scene.view_layers[0].update()
    above.location, lamp.parent.scale = (0, 0, 1), (1, 1, 1.5)


# How it is hidden or shown, and the lamps in viewport and render.
WAYS: dict[str, tuple[Way, int, int]] = {
    "viewport": (of_object("hide_viewport"), 0, 1),
    "render": (of_object("hide_render"), 1, 0),
    "closed eye": (eye_closed, 0, 1),
    "collection's viewport": (of_collection("hide_viewport"), 0, 1),
    "collection's render": (of_collection("hide_render"), 1, 0),
    "excluded": (of_collection("exclude"), 0, 0),
    "indirect only": (of_collection("indirect_only"), 1, 1),
    "instanced": (instanced(), 1, 1),
    "instanced twice over": (instanced(nested=True), 1, 1),
    "instanced, its viewport": (instanced("hide_viewport", "lamp"), 0, 1),
    "instanced, its render": (instanced("hide_render", "lamp"), 1, 0),
    "instanced, collection's viewport": (instanced("hide_viewport"), 0, 1),
    "instanced, collection's render": (instanced("hide_render"), 1, 0),
    "instanced, instancer's viewport": (instanced("hide_viewport", "instancer"), 0, 1),
    "instanced, instancer's render": (instanced("hide_render", "instancer"), 1, 0),
    "instanced twice over, its viewport": (instanced("hide_viewport", "lamp", nested=True), 0, 1),
    "instanced twice over, its render": (instanced("hide_render", "lamp", nested=True), 1, 0),
    "on vertices": (on_vertices, 3, 2),
    "parented": (with_parent_inverse, 0, 1),
    "with its parents": (hidden_with_parents, 0, 1),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_render_is_told_of_the_lamps_that_it_shows(room: LampRoom, way: str) -> None:
    """By what a card receives: as many lamps as there are, where they are."""
    hide, in_viewport, in_render = WAYS[way]
    hide(room, room.add("POINT", Matrix.Translation((0, 0, 3)), energy=100, shadow_soft_size=0.1))
    # What came after the last evaluation is what a render meets; the viewport's own lamps are asked for later.
    found = survey_scene(room.scene, for_render=True).lamps
    assert len(found) == in_render
    up = (0.0, 0.0, 1.0)
    expected = sum(light_of(lamp) * Vector(lamp.centre).normalized().z for lamp in found)
    assert room.irradiance(EYE, up) == pytest.approx(expected, rel=0.01, abs=1e-4)
    assert len(survey_scene(room.scene).lamps) == in_viewport


# --- more lamps than the table holds ----------------------------------------------------------------------

MANY: list[tuple[str, tuple[float, float, float], dict[str, Any]]] = [
    ("POINT", (0, 0, 3), {"energy": 60, "shadow_soft_size": 0.05}),
    ("SUN", (1, 0, 2), {"energy": 0.3, "angle": 0.1}),
    ("AREA", (-2, 1, 3), {"energy": 40, "size": 0.2}),
    ("SPOT", (2, 2, 3), {"energy": 300, "shadow_soft_size": 0.05, "spot_size": 1.0}),
    ("AREA", (0, -3, 2), {"energy": 25, "shape": "DISK", "size": 0.05, "spread": 1.0}),
    ("POINT", (4, 0, 5), {"energy": 150, "shadow_soft_size": 0.05}),
]


@pytest.mark.parametrize("count", [CAPACITY, 5, 6])
def test_the_strongest_are_aimed_at_and_the_others_count_as_sky(room: LampRoom, count: int) -> None:
    """By what each alone gives a card that faces it."""
    lamps = []
    for kind, place, settings in MANY[:count]:
        turn = Matrix.Translation(place) @ (-Vector(place)).to_track_quat("-Z", "Y").to_matrix().to_4x4()
        lamps.append(room.add(kind, turn, **settings))
    report = survey_scene(room.scene, for_render=True)
    seen = []
    for lamp in lamps:
        for other in lamps:
            other.hide_render = other != lamp
        seen.append(room.irradiance(EYE, lamp.matrix_world.translation))
    order = sorted(range(count), key=lambda k: -seen[k])
    given = [light_of(lamp) for lamp in report.lamps]
    assert given == pytest.approx([seen[k] for k in order[:CAPACITY]], rel=0.02)
    assert report.sky == pytest.approx(sum(seen[k] for k in order[CAPACITY:]), rel=0.02)
    beyond = [f"{lamps[k].name}: only the {CAPACITY} strongest are aimed at" for k in order[CAPACITY:]]
    assert report.left_out == beyond
    table = table_of(report)
    assert (table[:, 1, 3] > 0).sum() == min(count, CAPACITY)
    assert table[0, 4, 0] == pytest.approx(report.sky)
