"""Where random numbers go: a walk over a material's nodes, through its groups, from White Noise to what decides by it.

A number is identified by what it is computed from, not by its node: two nodes of equal inputs give equal numbers,
however many groups hold them. A use is the first node that computes with the number, named by the group that holds it
and the socket of that group through which it came, or the node's operation where it never left the group it was drawn
in.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from measured_materials.nodes.group import active_output, nodes_before, trees_below

_SUFFIX = re.compile(r"\.\d{3}$")
# Nodes that hand a number on as it is.
# The group that tells numbers of the camera's lens, and the one that puts them in the place of others.
_LENS, _BY_LENS = "MM Lens", "MM Lens Or Noise"
_PASSING = frozenset(
    {"ShaderNodeSeparateXYZ", "ShaderNodeSeparateColor", "NodeReroute", "NodeGroupInput", "NodeGroupOutput"}
)


@dataclass(frozen=True)
class Place:
    """A socket of a tree that lies inside these group nodes, the outermost first."""

    path: tuple[Any, ...]
    socket: Any


@dataclass
class Walk:
    """Uses of each random number of a tree, by the number's description.

    `uses` holds for each number its uses, "group: socket" or "group: operation", and `nodes` how many nodes each use
    is made of.
    """

    uses: dict[str, dict[str, int]] = field(default_factory=dict)
    _described: dict[Any, str] = field(default_factory=dict)

    @classmethod
    def of(cls, tree: Any) -> Walk:
        """From every White Noise that reaches something, and from the camera's lens."""
        walk, live = cls(), _live(tree)
        for path, node in _nodes(tree, ()):
            if node.bl_idname == "ShaderNodeTexWhiteNoise":
                number = walk.describe_noise(path, node)
                for name in ("Color", "Value"):
                    for channel, place in _channels(Place(path, node.outputs[name])):
                        uses = walk.uses.setdefault(f"{number}[{channel}]", {})
                        for use in _uses(place, "", live):
                            uses[use] = uses.get(use, 0) + 1
            elif node.bl_idname == "ShaderNodeGroup" and _family(node.node_tree.name) == _LENS:
                for name in ("Share", "Turns"):
                    place = Place(path, node.outputs[name])
                    uses = walk.uses.setdefault(f"lens[{name}]", {})
                    for use in _uses(place, "", live):
                        uses[use] = uses.get(use, 0) + 1
        return walk

    def describe_noise(self, path: tuple[Any, ...], node: Any) -> str:
        """A White Noise node by its inputs."""
        return f"noise({', '.join(self.describe(Place(path, socket)) for socket in node.inputs if socket.enabled)})"

    def describe(self, place: Place) -> str:
        """What an input's value is computed from, in words that are equal where the computations are."""
        path, socket = place.path, place.socket
        if not socket.is_linked:
            value = getattr(socket, "default_value", None)
            return str(list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value)
        source = socket.links[0].from_socket
        key = (tuple(n.name for n in path), source.node.id_data.name, source.node.name, source.identifier)
        if key not in self._described:
            self._described[key] = self._describe_output(path, source)
        return self._described[key]

    def _describe_output(self, path: tuple[Any, ...], source: Any) -> str:
        node = source.node
        if node.bl_idname == "NodeReroute":
            return self.describe(Place(path, node.inputs[0]))
        if node.bl_idname == "NodeGroupInput":
            return self.describe(Place(path[:-1], _socket(path[-1].inputs, source))) if path else source.name
        if node.bl_idname == "ShaderNodeGroup":
            sink = active_output(node.node_tree)
            return self.describe(Place((*path, node), _socket(sink.inputs, source)))
        inputs = [self.describe(Place(path, s)) for s in node.inputs if s.enabled]
        operation = getattr(node, "operation", "")
        return f"{node.bl_idname}{operation}({', '.join(inputs)}).{source.name}"


def _nodes(tree: Any, path: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
    for node in tree.nodes:
        yield path, node
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
            yield from _nodes(node.node_tree, (*path, node))


def _live(tree: Any) -> set[Any]:
    """Nodes that count: a group that aims has an output for each number of lamps, and one of them is active."""
    found: set[Any] = set()
    for part in trees_below(tree):
        sink = next((n for n in part.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output), None)
        found.update(nodes_before(sink) if sink else part.nodes)
    return found


def _socket(sockets: Any, like: Any) -> Any:
    return next(s for s in sockets if s.identifier == like.identifier)


def _channels(place: Place) -> Iterator[tuple[int, Place]]:
    """The three numbers of a noise's colour, each where it is taken apart; its value is the first of them again."""
    if place.socket.name == "Value":
        if place.socket.is_linked:
            yield 0, place
        return
    for link in place.socket.links:
        node = link.to_node
        if node.bl_idname in ("ShaderNodeSeparateXYZ", "ShaderNodeSeparateColor"):
            yield from ((k, Place(place.path, s)) for k, s in enumerate(node.outputs) if s.is_linked)
        else:
            raise AssertionError(f"a random colour goes into {node.bl_idname} whole")


def _uses(place: Place, came_by: str, live: set[Any]) -> Iterator[str]:
    """Names of the uses of a value, one for each node that computes with it."""
    for link in place.socket.links:
        node, entered = link.to_node, link.to_socket
        if node not in live:
            continue
        if node.bl_idname == "ShaderNodeGroup":
            source = next(n for n in node.node_tree.nodes if n.bl_idname == "NodeGroupInput")
            yield from _uses(Place((*place.path, node), _socket(source.outputs, entered)), entered.name, live)
        elif node.bl_idname == "NodeGroupOutput":
            if place.path:
                yield from _uses(Place(place.path[:-1], _socket(place.path[-1].outputs, entered)), "", live)
        elif node.bl_idname in _PASSING or _family(node.id_data.name) == _BY_LENS:
            yield from _uses(Place(place.path, node.outputs[0]), came_by, live)
        else:
            operation = getattr(node, "operation", node.bl_idname)
            yield f"{_family(node.id_data.name)}: {came_by or operation}"


def _family(name: str) -> str:
    """A group's kind: its name without that of the material and without Blender's number."""
    return _SUFFIX.sub("", name)
