#!/usr/bin/env bash
# Give a group node another group, and its values, links and keyframes go to inputs of other names.
#
# Seen with Blender 4.5.15 LTS (bpy 4.5.15 with numpy 1.26.4).
#
# Two shader node groups: the first has the inputs "Gloss" and "Tangent", the second "Tint" and "Gloss", both of the same
# type in their places. A node of the first has Gloss set to 0.7, Tangent linked, and Gloss keyframed. After
# node.node_tree = second, the 0.7 stands in "Tint", the link leads into "Gloss", and the keyframes drive "Tint": not one
# of them stayed with its name, although both groups have an input called Gloss. Nothing is said.
#
# Why: a node keeps values and links by the identifiers of the interface's items ("Socket_0" ...), which every new group
# counts from the beginning, and animation by the number of the input. Names are for people only. Where no input has the
# identifier, value and link are dropped.
#
# Surprised is whoever updates a group in files that use it by making a new one and exchanging it, as add-ons that
# ship node groups do: after one input was put in front, every material of the file is set to something else.
#
# To live with it: note values, links, drivers and keyframes by name before the exchange, take them off, and put them back
# by name after it.
#
# Exit status: 0 if Blender still behaves so, 2 if the packages could not be installed, 1 otherwise.
set -euo pipefail

folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv" || exit 2
"$folder/venv/bin/pip" install --quiet --no-deps bpy==4.5.15 numpy==1.26.4 || exit 2
export BLENDER_USER_RESOURCES="$folder/user"

# Blender talks on standard output; what this script says goes by descriptor 3.
"$folder/venv/bin/python" -P - 3>&1 >"$folder/log" <<'PY'
import os
import sys

import bpy

say = open(3, "w", buffering=1).write


def group(*names):
    """A shader group with these inputs, all floats."""
    tree = bpy.data.node_groups.new("group", "ShaderNodeTree")
    for name in names:
        tree.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat")
    return tree


material = bpy.data.materials.new("material")
material.use_nodes = True
tree = material.node_tree
node, value = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeValue")
node.node_tree = group("Gloss", "Tangent")
node.inputs["Gloss"].default_value = 0.7
node.inputs["Gloss"].keyframe_insert("default_value", frame=1)
tree.links.new(value.outputs[0], node.inputs["Tangent"])

node.node_tree = group("Tint", "Gloss")
path = tree.animation_data.action.fcurves[0].data_path
driven = tree.path_resolve(path.rpartition(".")[0]).name
say(f"Blender {bpy.app.version_string}\n")
for socket in node.inputs:
    held = f"value {socket.default_value:.1f}" + (", linked" if socket.is_linked else "")
    say(f"{socket.name:6s} ({socket.identifier}): {held}{', keyframed' if socket.name == driven else ''}\n")
same = (
    abs(node.inputs["Tint"].default_value - 0.7) < 1e-6
    and node.inputs["Gloss"].is_linked
    and not node.inputs["Tint"].is_linked
    and driven == "Tint"
)
say("as described\n" if same else "CHANGED: inputs keep to their names\n")
sys.stdout.flush()
os._exit(0 if same else 1)
PY
