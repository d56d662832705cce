"""How many nodes a material's graph has for Cycles."""

from __future__ import annotations

import bpy
from measured_materials.nodes.group import active_output, nodes_before


def count_nodes(tree: bpy.types.NodeTree) -> int:
    """Nodes that Cycles compiles: those of groups each time they are used, and only those behind the active output."""
    outputs = [node for node in tree.nodes if node.bl_idname == "NodeGroupOutput"]
    return sum(
        count_nodes(node.node_tree) if node.bl_idname == "ShaderNodeGroup" and node.node_tree else 1
        for node in (nodes_before(active_output(tree)) if outputs else tree.nodes)
        if node.bl_idname not in ("NodeGroupInput", "NodeGroupOutput")
    )
