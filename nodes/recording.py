"""A node group written down before it is made: what it will hold, so that one that is there already is found.

Nodes are made through Blender one by one, and each of their links has it look at every tree in the file. Writing them
down takes a hundredth of that time. A group is built from the same function whether it is recorded or made, so that a
recording leaves nothing out that the function decides by.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import bpy

# A constant triple, a socket that was recorded (node and output), a number, or a setting.
Key = Any
Settings = Sequence[tuple[str, Any]]
Inputs = Sequence[tuple[int | str, Key]]


class CannotRecord(Exception):
    """A function asks a node for something that only Blender knows, or sets what no recording holds."""


class RecordedSocket:
    """An output of a recorded node, known by the node's place and the output's name or place."""

    __slots__ = ("identifier", "node", "type")

    def __init__(self, node: RecordedNode, identifier: int | str, kind: str = "") -> None:
        self.node, self.identifier, self.type = node, identifier, kind

    @property
    def enabled(self) -> bool:
        """Group nodes, the only ones whose outputs are counted, show all of theirs."""
        return True


class RecordedNode:
    """A node to be: its kind, settings and inputs. Whoever wants more of it has to have it made."""

    __slots__ = ("inputs", "kind", "name", "properties")

    def __init__(self, name: str, kind: str, properties: Settings, inputs: Inputs) -> None:
        self.name, self.kind, self.properties, self.inputs = name, kind, properties, inputs

    @property
    def outputs(self) -> _Outputs:
        """Its outputs, which need not be there."""
        return _Outputs(self)


class _Outputs:
    """Outputs of a recorded node by name or place; of a node that holds a group, in the group's order too."""

    __slots__ = ("_node",)

    def __init__(self, node: RecordedNode) -> None:
        self._node = node

    def __getitem__(self, name: int | str) -> RecordedSocket:
        return RecordedSocket(self._node, name)

    def __iter__(self) -> Iterator[RecordedSocket]:
        group = dict(self._node.properties).get("node_tree")
        if group is None:
            raise CannotRecord
        for item in group.interface.items_tree:
            if item.item_type == "SOCKET" and item.in_out == "OUTPUT":
                yield RecordedSocket(self._node, item.identifier, _KINDS.get(item.socket_type, "VECTOR"))


_KINDS = {"NodeSocketFloat": "VALUE", "NodeSocketShader": "SHADER"}


class Recording:
    """Nodes of a group in the order in which they will be made.

    Attributes
    ----------
    nodes : as recorded
    source : stands for the group's inputs
    results : of the function, in the order of the group's outputs
    """

    def __init__(self) -> None:
        self.nodes: list[RecordedNode] = []
        self.source = RecordedNode("source", "NodeGroupInput", (), ())
        self.results: list[Key] = []

    def add(self, kind: str, properties: Settings, inputs: Inputs) -> RecordedNode:
        """Record a node of this bl_idname."""
        self.nodes.append(RecordedNode(str(len(self.nodes)), kind, properties, inputs))
        return self.nodes[-1]

    def digest(self, interface: Any, known_by: Callable[[bpy.types.NodeTree], str]) -> str:
        """Hash of all that is recorded, and of the interface.

        Parameters
        ----------
        interface : of the group, JSON-ready
        known_by : tells groups inside from each other
        """
        nodes = [[n.kind, [(k, _plain(v, known_by)) for k, v in n.properties], n.inputs] for n in self.nodes]
        return _hash([interface, nodes, self.results])

    def shape(self, interface: Any, known_by: Callable[[bpy.types.NodeTree], str]) -> str:
        """Hash of the same but for images and for inputs' numbers: groups of one shape differ in these alone."""
        nodes = [
            [
                n.kind,
                [(k, "" if isinstance(v, bpy.types.Image) else _plain(v, known_by)) for k, v in n.properties],
                [(k, _blank(v)) for k, v in n.inputs],
            ]
            for n in self.nodes
        ]
        return _hash([interface, nodes, [_blank(v) for v in self.results]])


def is_constant(key: Key) -> bool:
    """Whether an input is a number or a triple of them, and not a link."""
    return isinstance(key, (int, float)) or (isinstance(key, tuple) and key[0] == "constant")


def _blank(key: Key) -> Key:
    if isinstance(key, (int, float)):
        return 0.0
    return "constant" if is_constant(key) else key


def _plain(value: Any, known_by: Callable[[bpy.types.NodeTree], str]) -> Any:
    if isinstance(value, (str, bool)):
        return value
    if isinstance(value, bpy.types.NodeTree):
        return known_by(value)
    return value.name_full if isinstance(value, bpy.types.ID) else value


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, default=str).encode()).hexdigest()
