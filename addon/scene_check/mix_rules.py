"""Scene check: other shaders beside a mirror, among whose closures it is picked too seldom."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ...nodes import compat
from ...nodes.aimed_light_group import SLOTS_KEY
from ...nodes.material_tree import measured_nodes
from ...nodes.mix_factor_group import insert_mix_factor, is_mix_factor
from .findings import NOTE, SLOW, WRONG, Finding, Subject, editable, measured_trees

_WHY = "Cycles picks a mirror too seldom beside another shader; half of each under a sun had over ten times the noise"
_LOST = f"{_WHY}, and below half of the mirror some of a small lamp's light is lost"


def mixed_mirror(subject: Subject) -> Iterator[Finding]:
    """A Mix Shader chooses by a random number instead; an Add Shader cannot."""
    for material in subject.mirrors:
        where = f"material {material.name}"
        aims = any(tree.get(SLOTS_KEY) for tree in measured_trees(material))
        for mix in _behind(material, "ShaderNodeMixShader"):
            if _leaves_one(mix.inputs[0]):
                continue
            found = f"Mix Shader {mix.name} mixes it with another shader"
            wanted = "chosen between by MM Mix Factor"
            mend = editable(mix.id_data, lambda mix=mix: insert_mix_factor(mix))
            yield Finding("mixed_mirror", WRONG if aims else SLOW, where, found, wanted, _LOST if aims else _WHY, mend)
        for added in _behind(material, "ShaderNodeAddShader"):
            if all(socket.is_linked for socket in added.inputs):
                found = f"Add Shader {added.name} adds another shader to it"
                yield Finding("added_mirror", NOTE, where, found, "", _WHY)


def _leaves_one(factor: bpy.types.NodeSocket) -> bool:
    """Whether only one of the two shaders is ever there."""
    if factor.is_linked:
        return is_mix_factor(factor.links[0].from_node)
    return factor.default_value in (0.0, 1.0)


def _behind(material: bpy.types.Material, kind: str) -> list[bpy.types.Node]:
    """Nodes of a kind that the material's measured groups reach through Mix and Add Shaders of their tree."""
    found: dict[bpy.types.Node, None] = {}
    pending = [
        socket
        for _, node in measured_nodes(compat.node_tree(material))
        for socket in node.outputs
        if socket.name == "BSDF"
    ]
    seen: set[bpy.types.NodeSocket] = set()
    while pending:
        socket = pending.pop()
        if socket in seen:
            continue
        seen.add(socket)
        for node in (link.to_node for link in socket.links if not link.to_node.mute):
            if node.bl_idname in ("ShaderNodeMixShader", "ShaderNodeAddShader", "NodeReroute"):
                pending.append(node.outputs[0])
                if node.bl_idname == kind:
                    found[node] = None
    return list(found)
