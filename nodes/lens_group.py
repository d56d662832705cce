"""Node groups: two low-discrepancy numbers from where the camera's ray crossed its lens (method.md, section 14).

With depth of field on, Cycles draws a point of the lens for every camera ray, from the same evenly spread sequence that
its own closures draw from. The line from the shading point along Incoming meets the camera's plane z = 0 there. A
perspective camera's point is found so; that of an orthographic one, whose rays are parallel but for the lens, from
Incoming alone. Where the numbers cannot be had or trusted, White Noise stays.

What the camera is like comes into the group by drivers, so that a .blend needs no extension to render. They are made of
properties and arithmetic only, which Blender evaluates whatever a user thinks of Python in files.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import bpy

from . import expr
from .group import call, node_group

NAME = "MM Lens"
# Custom property of the group that knows the camera.
LENS_KEY = "measured_materials_lens"
# Of a lens radius, as parts of its area: closer to the centre a ray may be one of a camera without depth of field.
CENTRE = 1e-3
# Rounding of where a line meets the lens, in parts of the distance, and of that from the world's origin (float32).
_ROUNDING, _OF_PLACE = 2e-7, 0.25
# Of a lens radius, the largest such error; and of the error, how far a point has to be from the centre.
_MOST_ROUNDING, _FROM_CENTRE = 0.03, 5.0
# Points that rounding has put beyond the rim are folded back, which leaves their density even; up to this share.
_BEYOND = 1.2
_PATHS = {
    "on": "camera.data.dof.use_dof",
    "stop": "camera.data.dof.aperture_fstop",
    "focus": "camera.data.dof.focus_distance",
    "target": "camera.data.dof.focus_object.hide_render",
    "blades": "camera.data.dof.aperture_blades",
    "turn": "camera.data.dof.aperture_rotation",
    "ratio": "camera.data.dof.aperture_ratio",
    "kind": "camera.data.type",
    "lens": "camera.data.lens",
    "sensor": "camera.data.sensor_width",
    "x": "render.resolution_x",
    "y": "render.resolution_y",
    "percent": "render.resolution_percentage",
    "blur": "render.use_motion_blur",
}
# What a variable is where its path leads nowhere: there is no camera, or no object to focus on.
_ELSE = {"target": -1.0, "stop": 1.0, "focus": 1.0, "ratio": 1.0, "sensor": 1.0}


@dataclass(frozen=True)
class _Driven:
    """A value of the group: what it is until Blender has evaluated it, and the driver's expression; none if empty."""

    usual: float
    expression: str


# The radius is a perspective camera's in the scene's units, an orthographic one's over the distance of focus; 0 where
# there are no numbers to be had. Blur is that of what is far away, in pixels.
RADIUS, BLUR, ORTHOGRAPHIC, RATIO = "Radius", "Blur", "Orthographic", "Ratio"
BLADES, TURN, BLURRED, MOVES = "Blades", "Turn", "Motion Blur", "Camera Moves"
_VALUES = {
    RADIUS: _Driven(
        0.0,
        "(lens / 1000 if kind < 1 else 1 / max(focus, 0.00001)) / (2 * max(stop, 0.00001))"
        " if on > 0 and target < 0 and kind < 2 else 0",
    ),
    BLUR: _Driven(
        0.0,
        "(lens * lens / (2000 * sensor) if kind < 1 else 0.5) * max(x, y) * percent"
        " / (100 * max(stop, 0.00001) * max(focus, 0.00001))",
    ),
    ORTHOGRAPHIC: _Driven(0.0, "kind == 1"),
    RATIO: _Driven(1.0, "ratio"),
    BLADES: _Driven(0.0, "blades if blades > 2 else 0"),
    TURN: _Driven(0.0, "turn"),
    BLURRED: _Driven(0.0, "blur"),
    MOVES: _Driven(1.0, ""),
}
# Where blur is wider, parts of the lens see other things than others, and it may not decide about anything else.
MOST_BLUR = 1.0


def lens_group() -> bpy.types.ShaderNodeTree:
    """(two random numbers) to two that place something: the camera's where they are to be had, else those given."""

    def build(first: Any, second: Any) -> tuple[Any, Any]:
        share, turn, known = call(_numbers_group())
        return expr.where(known, share, first), expr.where(known, turn, second)

    inputs = {"Random 1": "float", "Random 2": "float"}
    return node_group("MM Lens Or Noise", inputs, {"Place 1": "float", "Place 2": "float"}, build)


def lens_numbers() -> tuple[Any, Any, Any]:
    """Share of the lens' area within the ray's distance from its middle, turns around it, 1 where both are known."""
    return call(_numbers_group())


def lens_groups() -> list[bpy.types.ShaderNodeTree]:
    """Groups of the file that know the camera, those that came along from other files too."""
    return [tree for tree in bpy.data.node_groups if LENS_KEY in tree]


def value_node(group: bpy.types.NodeTree, name: str) -> bpy.types.Node | None:
    """The node that holds one of the group's values; None where an artist has given it another label."""
    return next((n for n in group.nodes if n.bl_idname == "ShaderNodeValue" and n.label == name), None)


def _numbers_group() -> bpy.types.ShaderNodeTree:
    outputs = {"Share": "float", "Turns": "float", "Known": "float"}
    group = node_group(NAME, {}, outputs, _numbers)
    fresh = LENS_KEY not in group
    if fresh:
        group[LENS_KEY] = True
    for name, value in _VALUES.items():
        node = value_node(group, name)
        # Whatever is written has Blender evaluate every material that holds the group once more.
        if node is None or not (fresh or value.expression):
            continue
        if group.animation_data is None or not group.animation_data.drivers.find(_path(node)):
            node.outputs[0].default_value = value.usual
            if value.expression:
                _drive(node.outputs[0], value.expression)
    return group


def _numbers() -> tuple[Any, Any, Any]:
    values = {name: expr.Scalar(expr.node("ShaderNodeValue", {"label": name}, {}).outputs[0]) for name in _VALUES}
    x, y, rounding = _on_the_lens(values[RADIUS], values[ORTHOGRAPHIC])
    x = x * values[RATIO]
    angle = expr.arctan2(y, x)
    square = x * x + y * y
    turns = expr.math_node("FRACT", angle * (1 / (2 * math.pi)))
    blades = values[BLADES]
    bladed = blades > 0
    of_blades, turns_of_blades = _within_blades(square, angle - values[TURN], blades)
    share, turns = expr.where(bladed, of_blades, square), expr.where(bladed, turns_of_blades, turns)
    sharp = (rounding < _MOST_ROUNDING) * (share < _BEYOND)
    # The hole moves with the error alone, so that what lies around it stays even.
    hole = rounding * rounding * _FROM_CENTRE**2 + CENTRE
    share = expr.divide(1 - expr.math_node("ABSOLUTE", 1 - share) - hole, 1 - hole)
    path = expr.node("ShaderNodeLightPath", {}, {}).outputs
    still = 1 - values[BLURRED] * values[MOVES]
    can_be = (values[RADIUS] > 0) * (values[BLUR] < MOST_BLUR) * still
    known = expr.Scalar(path["Is Camera Ray"]) * ((share > 0) * sharp) * can_be
    # Times what is 0 as a constant where there is no lens: Cycles then leaves all of it out.
    return expr.minimum(expr.maximum(share, 0.0), 1.0) * can_be, turns * can_be, known


def _on_the_lens(radius: Any, orthographic: Any) -> tuple[Any, Any, Any]:
    """Where the camera's ray crossed the lens, in radii, and about the error of that."""
    geometry = expr.node("ShaderNodeNewGeometry", {}, {})
    incoming, position = (expr.Vector(geometry.outputs[name]) for name in ("Incoming", "Position"))
    seen = expr.Vector(expr.node("ShaderNodeTexCoord", {}, {}).outputs["Camera"])
    settings = {"vector_type": "VECTOR", "convert_from": "WORLD", "convert_to": "CAMERA"}
    ray = expr.Vector(expr.node("ShaderNodeVectorTransform", settings, {0: incoming}).outputs[0])
    (_, _, depth), (slope_x, slope_y, towards) = expr.components(seen), expr.components(ray)
    at_x, at_y, _ = expr.components(seen - expr.scale(ray, expr.divide(depth, towards)))
    away = -towards
    x = expr.where(orthographic, expr.divide(slope_x, away), at_x)
    y = expr.where(orthographic, expr.divide(slope_y, away), at_y)
    far = expr.where(orthographic, 1.0, expr.length(seen) + expr.length(position) * _OF_PLACE)
    return expr.divide(x, radius), expr.divide(y, radius), expr.divide(far * _ROUNDING, radius)


def _within_blades(square: Any, angle: Any, blades: Any) -> tuple[Any, Any]:
    """Of a regular polygon: share of its area that is as near its middle, and turns.

    The triangle of a blade is divided by lines along its outer edge, and these evenly.
    """
    half = expr.divide(math.pi, blades)
    # Corners lie half a blade off; the first blade is about the axis.
    blade = expr.math_node("FRACT", angle * (1 / (2 * math.pi)) + expr.divide(0.5, blades)) * blades
    within = expr.math_node("FRACT", blade)
    off = (within * 2 - 1) * half
    along = expr.divide(expr.cos(off), expr.cos(half))
    across = expr.divide(expr.math_node("TANGENT", off), expr.math_node("TANGENT", half)) * 0.5 + 0.5
    return square * along * along, expr.divide(expr.floor(blade) + across, blades)


def _path(node: bpy.types.Node) -> str:
    return f'nodes["{node.name}"].outputs[0].default_value'


def _drive(socket: bpy.types.NodeSocket, expression: str) -> None:
    """Let a value follow the camera of whichever scene is rendered."""
    driver = socket.driver_add("default_value").driver
    driver.type = "SCRIPTED"
    for name, path in _PATHS.items():
        if re.search(rf"\b{name}\b", expression):
            variable = driver.variables.new()
            variable.name, variable.type = name, "CONTEXT_PROP"
            target = variable.targets[0]
            target.context_property, target.data_path = "ACTIVE_SCENE", path
            target.use_fallback_value, target.fallback_value = True, _ELSE.get(name, 0.0)
    driver.expression = expression
