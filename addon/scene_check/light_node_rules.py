"""Which outputs of Light Path nodes change what a node tree emits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import bpy

from ...nodes.group import HASH_KEY

Outputs = frozenset[str]
_NONE: Outputs = frozenset()
_Groups = tuple[bpy.types.Node, ...]
"""Group nodes that one has gone into, the outermost first."""

_EMITTERS = frozenset({"ShaderNodeEmission", "ShaderNodeBackground"})


def emission_outputs(tree: bpy.types.NodeTree) -> Outputs:
    """Names of Light Path outputs that reach the light of a world, a lamp or a surface by way of any node.

    Groups are gone into, muted nodes passed as Cycles passes them; Mix Shaders count where they choose between shaders
    of which one emits.
    """
    output = tree.get_output_node("CYCLES")
    return _Walk().light(output.inputs["Surface"], ())[1] if output is not None else _NONE


def volume_outputs(tree: bpy.types.NodeTree) -> Outputs:
    """Names of Light Path outputs that reach the volume of a world or a material by way of any node."""
    output = tree.get_output_node("CYCLES")
    found = "Volume" in output.inputs if output is not None else False
    return _Walk().values(output.inputs["Volume"]) if found else _NONE


class _Walk:
    """Upstream, each node once in each place where its group stands."""

    def __init__(self) -> None:
        self._values: dict[tuple[bpy.types.Node, _Groups], Outputs] = {}

    def values(self, socket: bpy.types.NodeSocket) -> Outputs:
        """The outputs on which anything that reaches a socket of the outermost tree depends."""
        return self._inputs((socket,), ())

    def light(self, socket: bpy.types.NodeSocket, groups: _Groups) -> tuple[bool, Outputs]:
        """Whether a shader socket's input emits, and the outputs that this depends on."""
        source = _source(socket, groups)
        if source is None:
            return False, _NONE
        socket, groups = source
        node = socket.node
        if socket.type != "SHADER":  # a plain value is taken for an emission
            return True, self._output(socket, groups)
        if node.bl_idname in _EMITTERS:
            colour, strength = node.inputs["Color"], node.inputs["Strength"]
            return _is_lit(colour, strength), self._inputs((colour, strength), groups)
        if node.bl_idname == "ShaderNodeBsdfPrincipled":
            lit = _is_lit(node.inputs["Emission Color"], node.inputs["Emission Strength"])
            names = ("Emission Color", "Emission Strength", "Alpha", "Coat Weight", "Sheen Weight")
            return lit, self._inputs([node.inputs[n] for n in names if n in node.inputs], groups) if lit else _NONE
        if node.bl_idname == "ShaderNodeMixShader":
            return self._mixed(node, groups)
        if node.bl_idname == "ShaderNodeAddShader":
            return _together(self.light(socket, groups) for socket in node.inputs)
        return False, _NONE

    def _mixed(self, node: bpy.types.Node, groups: _Groups) -> tuple[bool, Outputs]:
        factor, *shaders = node.inputs
        if not factor.is_linked and factor.default_value in (0.0, 1.0):
            shaders = [shaders[int(factor.default_value)]]
        lit, outputs = _together(self.light(socket, groups) for socket in shaders)
        return lit, outputs | self._inputs((factor,), groups) if lit else _NONE

    def _inputs(self, sockets: Iterable[bpy.types.NodeSocket], groups: _Groups) -> Outputs:
        return frozenset().union(*(self._value(socket, groups) for socket in sockets))

    def _value(self, socket: bpy.types.NodeSocket, groups: _Groups) -> Outputs:
        source = _source(socket, groups)
        return self._output(*source) if source is not None else _NONE

    def _output(self, socket: bpy.types.NodeSocket, groups: _Groups) -> Outputs:
        node = socket.node
        if node.bl_idname == "ShaderNodeLightPath":
            # What a measured group emits of the light that it samples is what its rays are then spared.
            measured = any(HASH_KEY in group.node_tree for group in groups)
            return _NONE if measured else frozenset({socket.name})
        # The node's outputs are taken for one.
        key = (node, groups)
        if key not in self._values:
            self._values[key] = _NONE  # a circle, which Blender marks as wrong, adds nothing
            self._values[key] = self._inputs(node.inputs, groups)
        return self._values[key]


def _source(socket: bpy.types.NodeSocket, groups: _Groups) -> tuple[bpy.types.NodeSocket, _Groups] | None:
    """The output that feeds an input, in groups, through reroutes and muted nodes; None where nothing does."""
    passed = 0
    while passed < 10_000:
        passed += 1
        links = [link for link in socket.links if not link.is_muted and link.is_valid]
        if not links:
            return None
        socket = links[0].from_socket
        node = socket.node
        if node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.mute:
            inner = next((link.from_socket for link in node.internal_links if link.to_socket == socket), None)
            if inner is None:
                return None
            socket = inner
        elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            sink = next(iter(_active_outputs(node.node_tree)), None)
            inside = next((s for s in sink.inputs if s.identifier == socket.identifier), None) if sink else None
            if inside is None:
                return None
            socket, groups = inside, (*groups, node)
        elif node.bl_idname == "NodeGroupInput" and groups:
            *outer, group = groups
            name = socket.identifier
            outside = next((s for s in group.inputs if s.identifier == name), None)
            if outside is None:
                return None
            socket, groups = outside, tuple(outer)
        else:
            return socket, groups
    return None


def _active_outputs(tree: bpy.types.NodeTree) -> Iterator[bpy.types.Node]:
    """The sink that counts, first."""
    sinks = [node for node in tree.nodes if node.bl_idname == "NodeGroupOutput"]
    yield from sorted(sinks, key=lambda node: not node.is_active_output)


def _is_lit(colour: bpy.types.NodeSocket, strength: bpy.types.NodeSocket) -> bool:
    """Whether an emission gives any light."""
    return (strength.is_linked or strength.default_value != 0) and (colour.is_linked or any(colour.default_value[:3]))


def _together(found: Iterator[tuple[bool, Outputs]]) -> tuple[bool, Outputs]:
    parts = [(lit, outputs) for lit, outputs in found if lit]
    return bool(parts), frozenset().union(*(outputs for _, outputs in parts))
