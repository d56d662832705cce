"""What a ray that a shader sends towards a light meets: told by Cycles' Raycast node, or by a script of OSL.

The node is there from Blender 5.1 on. OSL's `trace()` tells the same on the CPU in every version, and all other nodes
stay as they are. Where Open Shading Language is off, Cycles leaves scripts out and their outputs are 0: then no light
seems to be seen, none is sampled, and a mirror brings all of it, noisier and as bright.
"""

from __future__ import annotations

import hashlib
from typing import Any

import bpy

from . import expr
from .group import FAMILY_KEY, HASH_KEY, call, content_hash, node_group
from .osl_script import output, script_node, shader_source

SHADER = "measured_ray.osl"
_FAMILY = "MM Light Ray"
_INPUTS = {"Position": "vector", "Direction": "vector", "Length": "float"}
_OUTPUTS = {"Clear": "float", "Distance": "float"}


def can_raycast() -> bool:
    """Whether this Blender's nodes can ask what a ray meets."""
    return hasattr(bpy.types, "ShaderNodeRaycast")


def light_ray(position: Any, wi: Any, length: Any, scripted: bool = False) -> tuple[Any, Any]:
    """1 where nothing is met that near, and the distance of what is met otherwise.

    Parameters
    ----------
    position : Geometry's own, to the last bit: the surface itself is met else
    wi : unit vector, world
    length : how far to look; nothing is met within 0
    scripted : ask a script of OSL
    """
    if scripted:
        clear, distance = call(_scripted_ray_group(), position, wi, length)
        return clear, distance
    made = expr.node("ShaderNodeRaycast", {}, {"Position": position, "Direction": wi, "Length": length})
    return 1 - expr.Scalar(made.outputs["Is Hit"]), expr.Scalar(made.outputs["Hit Distance"])


def is_ray_script(tree: bpy.types.NodeTree) -> bool:
    """Whether its script only asks what rays meet: left out it costs noise and no light."""
    return str(tree.get(FAMILY_KEY, "")).startswith(_FAMILY)


def _scripted_ray_group() -> bpy.types.ShaderNodeTree:
    """The file's own, or a new one: a script is compiled once."""
    source = shader_source(SHADER)
    family = f"{_FAMILY} {hashlib.sha256(source.encode()).hexdigest()[:16]}"
    own = (t for t in bpy.data.node_groups if t.library is None and t.get(FAMILY_KEY) == family)
    found = next((t for t in own if content_hash(t) == t[HASH_KEY]), None)
    if found is not None:
        return found

    def build(*values: Any) -> tuple[Any, Any]:
        node = script_node(SHADER, source, dict(zip(_INPUTS, values, strict=True)))
        return output(node, "Clear"), output(node, "Distance")

    group = node_group(_FAMILY, _INPUTS, _OUTPUTS, build)
    group[FAMILY_KEY] = family
    return group
