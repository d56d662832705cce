"""The stock material of the swatches."""

from __future__ import annotations

import math

import bpy

from ....nodes import compat


def coloured(name: str, gloss: float = 0.0, exponent: float = 10.0, through: float = 0.0) -> bpy.types.Material:
    """Diffuse in the colours of the mesh attribute "Col", a share `through` of it as light that is let through, and a
    share `gloss` of white GGX.

    The sheen of fibres is left to their shape. GGX is as wide as a Phong lobe of this exponent: about the
    mirror direction cos^n falls as cos^4n does about the half vector, and a Blinn lobe of exponent m has the
    width of GGX with alpha = sqrt(2 / (m + 2)) (Walter et al. 2007).
    """
    material = compat.new_material(name)
    tree = material.node_tree
    colour, closure, output = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "BsdfDiffuse", "OutputMaterial")
    )
    colour.attribute_name = "Col"
    tree.links.new(colour.outputs["Color"], closure.inputs["Color"])
    if through > 0:
        diffuse, translucent = closure, tree.nodes.new("ShaderNodeBsdfTranslucent")
        closure = tree.nodes.new("ShaderNodeMixShader")
        tree.links.new(colour.outputs["Color"], translucent.inputs["Color"])
        closure.inputs[0].default_value = through
        tree.links.new(diffuse.outputs[0], closure.inputs[1])
        tree.links.new(translucent.outputs[0], closure.inputs[2])
    if gloss > 0:
        diffuse, glossy = closure, tree.nodes.new("ShaderNodeBsdfAnisotropic")
        closure = tree.nodes.new("ShaderNodeMixShader")
        glossy.distribution = "GGX"
        glossy.inputs["Color"].default_value = (1, 1, 1, 1)
        _set_roughness(tree, glossy.inputs["Roughness"], math.sqrt(math.sqrt(2 / (4 * exponent + 2))))
        closure.inputs[0].default_value = gloss
        tree.links.new(diffuse.outputs[0], closure.inputs[1])
        tree.links.new(glossy.outputs[0], closure.inputs[2])
    tree.links.new(closure.outputs[0], output.inputs["Surface"])
    return material


def _set_roughness(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, roughness: float) -> None:
    """Blunt for all but what the camera sees: a sharp gloss met after a bounce throws rare, very bright samples."""
    blunt = max(0.9, roughness)
    path, chosen = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMath")
    chosen.operation = "MULTIPLY_ADD"
    chosen.inputs[1].default_value, chosen.inputs[2].default_value = roughness - blunt, blunt
    tree.links.new(path.outputs["Is Camera Ray"], chosen.inputs[0])
    tree.links.new(chosen.outputs[0], socket)
