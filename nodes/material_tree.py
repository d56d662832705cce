"""A material's own tree around its measured group: made, exchanged in place, and found again; and names that fit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..bake.brdf.common import Colour
from ..bake.brdf.record import BrdfRecord
from ..bake.errors import BakeError
from ..bake.shading_maps.record import ShadingMapRecord
from . import compat, portions
from .adjustments import describe_sockets
from .exchanged_group import exchange_group
from .exported_look import look_of, show_to_exporters
from .group import HASH_KEY, content_hash, hashing_once, trees_below
from .second_group import connect_second, follow, samples_by_second, showing
from .surface_inputs import connect_inputs, exchange_linked

# Custom properties of a built material: where it came from, so that the panel can bake it again. The measurement's path
# is kept here only, not in the bundle that people share.
BUNDLE_KEY = "measured_materials_bundle"
SOURCE_KEY = "measured_materials_source"
# Bytes of the longest such words, "MM Sampler Density " and " residual sampler", and of Blender's number.
_ROOM = 24
_NODE_KEY, _OUTPUT_KEY = "measured_materials_node", "measured_materials_output"
# What a material's Emission Sampling was before it was switched off.
_EMISSION_KEY = "measured_materials_emission_sampling"
_VIEWPORT_KEY, _STAND_IN_KEY = "measured_materials_viewport", "measured_materials_stand_in"


def build_from(
    record: BrdfRecord | ShadingMapRecord,
    material: bpy.types.Material | None,
    make_group: Callable[[str], bpy.types.ShaderNodeTree],
) -> bpy.types.Material:
    """A material of the group that `make_group` builds under a name; what a failure has made is removed."""
    compat.ensure_cycles()
    name, albedo, look = safe_name(record.name), record.albedo.under_sky, look_of(record)
    before = {*bpy.data.images, *bpy.data.node_groups}
    if material is not None and material.get(BUNDLE_KEY) and not measured_nodes(compat.node_tree(material)):
        cause = "its measured group is no longer among its nodes, and these are not to be lost"
        raise BakeError(material.name, cause, "undo its removal, or import the measurement as a new material")
    try:
        with hashing_once():
            group = make_group(part_name(name))
            portions.rest()  # a portion of its own for what follows, which changes the material
            portions.no_return()
            material = bpy.data.materials.new(name) if material is None else material
            assemble(material, group, albedo)
            show_to_exporters(compat.node_tree(material), look)
    except Exception:
        for block in {*bpy.data.images, *bpy.data.node_groups} - before:
            (bpy.data.images if isinstance(block, bpy.types.Image) else bpy.data.node_groups).remove(block)
        raise
    material[BUNDLE_KEY] = str(record.files().path)
    return material


def lit_by_emission(material: bpy.types.Material, sampled: bool) -> None:
    """Keep Cycles from taking a material that samples lamps for a lamp itself: what it emits is reflected light.

    Of a material that did so before, and does not now, what Cycles had been told is restored.
    """
    settings = material.cycles
    if sampled or samples_by_second(material):
        if _EMISSION_KEY not in material:
            material[_EMISSION_KEY] = settings.emission_sampling
        settings.emission_sampling = "NONE"
        for other, _ in showing(material):
            if other.cycles.emission_sampling != "NONE":
                lit_by_emission(other, True)
    elif _EMISSION_KEY in material:
        settings.emission_sampling = material[_EMISSION_KEY]
        del material[_EMISSION_KEY]


def safe_name(name: str, room: int = 0) -> str:
    """A name for data-blocks: printable, and cut only where Blender must, by bytes, with `room` of them to spare.

    Blender cuts further by itself where it adds a number to a name that is taken.
    """
    printable = "".join(c if c.isprintable() else "_" for c in name.encode("utf-8", "replace").decode("utf-8"))
    most = compat.longest_name() - room
    return printable.encode("utf-8")[:most].decode("utf-8", "ignore") or "measured"


def part_name(name: str) -> str:
    """Name that a material's groups and textures share; what they are is said before or behind it."""
    return safe_name(name, _ROOM)


def assemble(material: bpy.types.Material, group: bpy.types.ShaderNodeTree, albedo: Colour) -> None:
    """Output <- group <- normal and, where it has them, texture coordinates.

    EEVEE, which cannot follow the mirror, gets the group's own "EEVEE" output or a stand-in of this albedo, and so does
    the viewport's Solid view.
    In a material that has such a group already, the group is exchanged and everything else stays: links to Normal and
    Tint, and whatever else an artist has added.
    """
    tree = compat.node_tree(material)
    describe_sockets(group)
    lookup = any(item.name == "EEVEE" for item in group.interface.items_tree)
    places = measured_nodes(tree) or [(tree, _fresh_tree(tree, None if lookup else albedo))]
    previous = {n.node_tree for _, n in places if n.node_tree and n.node_tree != group}
    for inner, node in places:
        _exchange(inner, node, group)
    top = next((node for inner, node in places if inner == tree), None)
    if top is not None:
        _connect_outputs(tree, top)
        connect_second(tree, top)
    follow(material, group)
    for old in previous:
        # A group that an artist has worked in is left in the file, for its work to be taken over.
        if old.get(HASH_KEY) == content_hash(old):
            remove_unused(old)
        elif not old.users:
            old.use_fake_user = True
    material.diffuse_color = (*albedo, 1)
    # Cycles would bend the mirror's facet where its reflection dips under the surface: +0.8 % light on a coarse sphere.
    material.cycles.use_bump_map_correction = False


def measured_nodes(tree: bpy.types.ShaderNodeTree) -> list[tuple[bpy.types.NodeTree, bpy.types.Node]]:
    """Nodes that hold a material's group, each after its tree; an artist may have put them into a group of his own."""
    return [(inner, node) for inner in trees_below(tree) for node in inner.nodes if node.get(_NODE_KEY)]


def _connect_outputs(tree: bpy.types.ShaderNodeTree, node: bpy.types.Node) -> None:
    """Link the group to the outputs made with it, where nothing else is linked to them."""
    output = next((n for n in tree.nodes if n.get(_OUTPUT_KEY)), None)
    if output is not None and not output.inputs["Surface"].is_linked:
        tree.links.new(node.outputs["BSDF"], output.inputs["Surface"])
    viewport = next((n for n in tree.nodes if n.get(_VIEWPORT_KEY)), None)
    if viewport is not None and "EEVEE" in node.outputs:
        _show_in_eevee(tree, node.outputs["EEVEE"], viewport.inputs["Surface"])


def _show_in_eevee(tree: bpy.types.ShaderNodeTree, shown: Any, surface: Any) -> None:
    """Link the group's own closure where nothing is, or only the stand-in of a material that had none."""
    before = surface.links[0].from_node if surface.is_linked else None
    if before is None or before.get(_STAND_IN_KEY):
        tree.links.new(shown, surface)
        if before is not None:
            tree.nodes.remove(before)


def _exchange(tree: bpy.types.ShaderNodeTree, node: bpy.types.Node, group: bpy.types.ShaderNodeTree) -> None:
    """Give the node another group, and one that had none its usual inputs."""
    if node.node_tree == group:
        return
    fresh = node.node_tree is None
    if fresh:
        exchange_group(tree, node, group)
        connect_inputs(tree, node)
    else:
        exchange_linked(tree, node, group)


def _fresh_tree(tree: bpy.types.ShaderNodeTree, albedo: Colour | None) -> bpy.types.Node:
    """Empty the tree, make its outputs and any stand-in, and return the node that is to hold the group."""
    tree.nodes.clear()
    node = tree.nodes.new("ShaderNodeGroup")
    node[_NODE_KEY] = True
    node.location, node.width = (0, 200), 260
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output[_OUTPUT_KEY] = True
    output.target, output.location = "CYCLES", (340, 200)
    preview = tree.nodes.new("ShaderNodeOutputMaterial")
    preview[_VIEWPORT_KEY] = True
    preview.target, preview.location = "EEVEE", (340, 0)
    if albedo is not None:
        stand_in = tree.nodes.new("ShaderNodeBsdfPrincipled")
        stand_in.label, stand_in.location = "EEVEE stand-in", (0, 0)
        stand_in[_STAND_IN_KEY] = True
        stand_in.inputs["Base Color"].default_value = (*albedo, 1)
        tree.links.new(stand_in.outputs[0], preview.inputs["Surface"])
    return node


def remove_unused(group: bpy.types.ShaderNodeTree) -> None:
    """Remove a group that nothing uses, and with it the groups and textures that only it used."""
    pending = {group.session_uid: group}
    images: dict[int, bpy.types.Image] = {}
    while pending:
        _, tree = pending.popitem()
        if tree.users:
            continue  # if by a group that goes too, that one leads here again
        pending |= {t.session_uid: t for n in tree.nodes if (t := getattr(n, "node_tree", None))}
        images |= {i.session_uid: i for n in tree.nodes if (i := getattr(n, "image", None))}
        bpy.data.node_groups.remove(tree)
    for image in images.values():
        if not image.users:
            bpy.data.images.remove(image)
