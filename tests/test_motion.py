"""For any animation of scene, camera, objects and what they hang on, the texel footprint is unknown or the largest.

Truth is the footprint's own arithmetic, asked frame by frame of the scene as Blender evaluates it there with nothing
counted as changing: the geometry of a still is proven in `test_footprint.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import pytest
from measured_materials.addon.lights.lamp_survey import survey_scene
from measured_materials.addon.lights.motion import changes
from measured_materials.addon.material import texel_footprint
from measured_materials.nodes.compat import curves_of
from support.animations import (
    ANIMATIONS,
    UNFOLLOWED,
    View,
    by_a_still_percentage,
    by_geometry_nodes,
    in_the_nla,
    instanced,
    keyed,
    nearer,
)

FRAMES = range(1, 22, 4)
KINDS = ("objects", "meshes", "cameras", "materials", "collections", "actions", "lights", "node_groups", "lattices",
         "armatures", "curves", "textures", "metaballs")  # fmt: skip


@pytest.fixture
def view() -> Iterator[View]:
    made = View()
    yield made
    bpy.data.scenes.remove(made.scene)
    for kind in KINDS:
        for block in list(getattr(bpy.data, kind)):
            getattr(bpy.data, kind).remove(block)


def names(function: Callable[..., Any]) -> str:
    return function.__name__.removeprefix("by_")


@pytest.mark.parametrize("animate", ANIMATIONS, ids=names)
def test_unknown_or_the_largest_of_all_frames(view: View, animate: Callable[[View], Any], monkeypatch: Any) -> None:
    still = view.footprint().pixels
    animate(view)
    view.scene.frame_set(1)
    told = view.footprint()
    with monkeypatch.context() as blind:
        blind.setattr(texel_footprint, "changes", lambda *_: False)
        found = []
        for frame in FRAMES:
            view.scene.frame_set(frame)
            found.append(view.footprint().pixels)
    if animate.__name__ not in UNFOLLOWED:
        assert max(found) > 1.2 * found[0], found
    assert told.why_unknown or told.pixels >= max(*found, still) * 0.999
    assert told.pixels == math.inf or animate is by_a_still_percentage


# --- what stands still is known -----------------------------------------------------------------------------


def still_parent(view: View) -> None:
    view.plate.parent = view.add("parent")


def still_ancestors(view: View) -> None:
    """A rope, each link the child of the one before."""
    above = view.add("link")
    for _ in range(600):
        link = view.add("link")
        link.parent, above = above, link
    view.plate.parent = above


def still_instancer(view: View) -> None:
    instanced(view)


def still_shape_keys(view: View) -> None:
    view.plate.shape_key_add(name="Basis")


def still_modifiers(view: View) -> None:
    view.plate.modifiers.new("subdivision", "SUBSURF").levels = 0
    view.plate.modifiers.new("lattice", "LATTICE").object = view.add("lattice", bpy.data.lattices.new("lattice"))


def still_geometry_nodes(view: View) -> None:
    by_geometry_nodes(view, animate=False)


def still_marker(view: View) -> None:
    view.scene.timeline_markers.new("first", frame=1).camera = view.camera


def still_neighbour(view: View) -> None:
    """Something else moves, and the scene animates what has no bearing on its pixels."""
    nearer(view.add("neighbour"))
    keyed(view.scene, "eevee.taa_render_samples", 1, 9)


def still_slot(view: View) -> None:
    """Of an action that moves another object by another slot."""
    neighbour = view.add("neighbour")
    nearer(neighbour)
    action = neighbour.animation_data.action
    if hasattr(action, "slots"):
        data = view.plate.animation_data_create()
        data.action, data.action_slot = action, action.slots.new("OBJECT", "still")


@pytest.mark.parametrize(
    "arrange", [value for name, value in list(globals().items()) if name.startswith("still_")], ids=lambda f: f.__name__
)
def test_what_stands_still_is_known(view: View, arrange: Callable[[View], None]) -> None:
    before = view.footprint().pixels
    arrange(view)
    assert view.footprint().pixels == pytest.approx(before, rel=1e-4)


def test_blender_animates_no_resolution() -> None:
    """Which is why the scene's own curves are not asked."""
    told = bpy.types.RenderSettings.bl_rna.properties
    sizes = ("resolution_x", "resolution_y", "resolution_percentage", "pixel_aspect_x", "pixel_aspect_y")
    assert not any(told[name].is_animatable for name in sizes)
    assert not bpy.types.Scene.bl_rna.properties["camera"].is_animatable


# --- lamps that shine later ------------------------------------------------------------------------------------


def lamp(view: View) -> Any:
    data = bpy.data.lights.new("lamp", "POINT")
    data.energy, data.shadow_soft_size = 0.0, 0.1
    return view.add("lamp", data)


@pytest.mark.parametrize("nla", [False, True])
def test_a_lamp_that_is_lit_later_is_counted(view: View, nla: bool) -> None:
    dark = lamp(view)
    assert survey_scene(view.scene).to_come == 0
    nearer(dark)  # moving gives no light
    assert survey_scene(view.scene).to_come == 0
    keyed(dark.data, "energy", 0.0, 10.0)
    if nla:
        in_the_nla(dark.data)
    view.scene.frame_set(1)
    dark.data.energy = 0.0
    assert survey_scene(view.scene).to_come == 1


def test_an_animated_value_within_a_lamps_group_is_counted(view: View) -> None:
    dark = lamp(view)
    group = bpy.data.node_groups.new("flicker", "ShaderNodeTree")
    group.nodes.new("ShaderNodeValue").name = "flicker"
    dark.data.use_nodes = True
    dark.data.node_tree.nodes.new("ShaderNodeGroup").node_tree = group
    assert not changes(dark.data)
    keyed(group, 'nodes["flicker"].outputs[0].default_value', 0.0, 1.0)
    assert changes(dark.data) and survey_scene(view.scene).to_come == 1


def test_properties_narrow_the_question(view: View) -> None:
    nearer(view.plate)
    assert changes(view.plate) and changes(view.plate, {"location"}) and not changes(view.plate, {"hide_render"})
    assert not changes(None) and not changes(view.camera)
    view.plate.driver_add("hide_render").driver.expression = "frame > 3"
    assert changes(view.plate, {"hide_render"})
    assert len(curves_of(view.plate.animation_data.action)) == 1
