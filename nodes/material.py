"""A bundle as a Cycles material."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bake.bundle import Bundle, require
from ..bake.errors import BakeError
from ..bake.storage import Storage
from ..bake.table import FILTERS
from ..bake.table_facts import grid_of, sampler_layout_of, scale_of
from . import compat
from .alias_sampler_group import alias_sampler_group
from .stochastic_mirror_group import reference_group
from .table_lookup_group import table_lookup_group

# Custom properties of a built material: where it came from, so that the panel can bake it again.
BUNDLE_KEY = "measured_materials_bundle"
SOURCE_KEY = "measured_materials_source"
_NODE_KEY, _OUTPUT_KEY = "measured_materials_node", "measured_materials_output"


def build_material(
    bundle: Bundle,
    material: bpy.types.Material | None = None,
    *,
    filter: str | None = None,
    stochastic: bool = True,
    pack: bool = False,
) -> bpy.types.Material:
    """Build or rebuild a material from a bundle, in Reference mode (mirror only).

    Parameters
    ----------
    material : to rebuild in place, so that objects keep it; a new one by default
    filter : "nearest", "trilinear" or "bspline"; by default the bundle's
    stochastic : choose among theta_o slices at random instead of blending them (unbiased, fewer taps)
    pack : store the textures inside the .blend

    Raises
    ------
    BakeError : the bundle does not describe a table this version knows
    """
    where = bundle.path / "material.json"
    if bundle.material.get("kind") != "brdf":
        raise BakeError(where, f"kind {bundle.material.get('kind')!r} is not a BRDF", "update the extension")
    grid, layout = grid_of(bundle), sampler_layout_of(bundle)
    table = require(bundle.material, "table", dict, where)
    if filter is None:
        filter = require(table, "filter", str, where, choices=FILTERS)
    scale = 1 / scale_of(bundle)
    source = require(bundle.material, "source", dict, where)
    name = require(source, "name", str, where)
    if material is None:
        material = bpy.data.materials.new(name)
    half = require(table, "storage", str, where) == Storage.HALF
    atlas = load_data_image(bundle.image_path("table"), f"{name} table", half=half, pack=pack)
    lookup = table_lookup_group(f"MM Lookup {name}", atlas, grid, filter, scale, stochastic)
    cells = load_data_image(bundle.image_path("sampler"), f"{name} sampler", pack=pack)
    sampler = alias_sampler_group(f"MM Sampler {name}", cells, layout)
    assemble(material, reference_group(f"Measured {name}", lookup, sampler), _normal_albedo(bundle))
    material[BUNDLE_KEY] = str(bundle.path)
    material[SOURCE_KEY] = str(source.get("file", ""))
    return material


def load_data_image(path: Path, name: str, *, half: bool = False, pack: bool = False) -> bpy.types.Image:
    """An image whose numbers reach the shader as they are in the file; `half` where they are half floats there."""
    image = bpy.data.images.load(str(path), check_existing=False)
    image.name = name
    image.colorspace_settings.name = "Non-Color"
    # RGBA data would otherwise be divided by alpha, and float32 cut to half when it goes to the device.
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = half
    if pack:
        image.pack()
    return image


def assemble(material: bpy.types.Material, group: bpy.types.ShaderNodeTree, albedo: tuple[float, float, float]) -> None:
    """Output <- group <- normal; EEVEE, which cannot follow the mirror, gets a stand-in of the same albedo.

    In a material that has such a group already, the group is exchanged and everything else stays: links to Normal and
    Tint, and whatever else an artist has added.
    """
    tree = compat.node_tree(material)
    node = next((n for n in tree.nodes if n.get(_NODE_KEY)), None)
    if node is None:
        node = _fresh_tree(tree, albedo)
    previous = node.node_tree
    if previous != group:
        kept = {s.name: (s.default_value[:], [k.from_socket for k in s.links]) for s in node.inputs}
        node.node_tree = group
        for name, (value, sources) in kept.items():
            node.inputs[name].default_value = value
            for source in sources:
                tree.links.new(source, node.inputs[name])
        surface = next(n for n in tree.nodes if n.get(_OUTPUT_KEY)).inputs["Surface"]
        if not surface.is_linked:
            tree.links.new(node.outputs["BSDF"], surface)
        if previous is None:
            _connect_normal(tree, node)
        else:
            remove_unused(previous)
    material.diffuse_color = (*albedo, 1)
    # Cycles would bend the mirror's facet where its reflection dips under the surface: +0.8 % light on a coarse sphere.
    material.cycles.use_bump_map_correction = False


def _fresh_tree(tree: bpy.types.ShaderNodeTree, albedo: tuple[float, float, float]) -> bpy.types.Node:
    """Empty the tree, make its outputs and the stand-in, and return the node that is to hold the group."""
    tree.nodes.clear()
    node = tree.nodes.new("ShaderNodeGroup")
    node[_NODE_KEY] = True
    node.location, node.width = (0, 200), 260
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output[_OUTPUT_KEY] = True
    output.target, output.location = "CYCLES", (340, 200)
    stand_in = tree.nodes.new("ShaderNodeBsdfPrincipled")
    stand_in.label, stand_in.location = "EEVEE stand-in", (0, 0)
    stand_in.inputs["Base Color"].default_value = (*albedo, 1)
    preview = tree.nodes.new("ShaderNodeOutputMaterial")
    preview.target, preview.location = "EEVEE", (340, 0)
    tree.links.new(stand_in.outputs[0], preview.inputs["Surface"])
    return node


def _connect_normal(tree: bpy.types.ShaderNodeTree, node: bpy.types.Node) -> None:
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    geometry.location = (-220, 200)
    tree.links.new(geometry.outputs["Normal"], node.inputs["Normal"])
    node.inputs["Tint"].default_value = (1, 1, 1)


def remove_unused(group: bpy.types.ShaderNodeTree) -> None:
    """Remove a group that nothing uses, and with it the groups and textures that only it used."""
    if group.users:
        return
    inner = {n.node_tree for n in group.nodes if n.bl_idname == "ShaderNodeGroup" and n.node_tree}
    images = {n.image for n in group.nodes if n.bl_idname == "ShaderNodeTexImage" and n.image}
    bpy.data.node_groups.remove(group)
    for child in inner:
        remove_unused(child)
    for image in images:
        if not image.users:
            bpy.data.images.remove(image)


def _normal_albedo(bundle: Bundle) -> tuple[float, float, float]:
    """Measured albedo at normal incidence, in [0, 1]."""
    where = bundle.path / "material.json"
    albedo = require(bundle.material, "albedo", dict, where)
    rows = require(albedo, "directional", list, where, minimum=1)
    try:
        red, green, blue = (min(max(float(c), 0.0), 1.0) for c in rows[0])
    except (TypeError, ValueError) as error:
        raise BakeError(where, "'albedo.directional' does not hold three numbers a row", "bake it again") from error
    return red, green, blue
