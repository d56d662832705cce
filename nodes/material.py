"""A bundle as a Cycles material."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bake.bundle import Bundle, require
from ..bake.errors import BakeError
from ..bake.table import FILTERS
from ..bake.table_facts import grid_of, sampler_layout_of, scale_of
from .alias_sampler_group import alias_sampler_group
from .group import arrange
from .stochastic_mirror_group import reference_group
from .table_lookup_group import table_lookup_group

# Custom properties of a built material: where it came from, so that the panel can bake it again.
BUNDLE_KEY = "measured_materials_bundle"
SOURCE_KEY = "measured_materials_source"


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
    images = [load_data_image(bundle.image_path(part), f"{name} {part}", pack) for part in ("table", "sampler")]
    lookup = table_lookup_group(f"MM Lookup {name}", images[0], grid, filter, scale, stochastic)
    sampler = alias_sampler_group(f"MM Sampler {name}", images[1], layout)
    assemble(material, reference_group(f"Measured {name}", lookup, sampler), _normal_albedo(bundle))
    material[BUNDLE_KEY] = str(bundle.path)
    material[SOURCE_KEY] = str(source.get("file", ""))
    return material


def load_data_image(path: Path, name: str, pack: bool) -> bpy.types.Image:
    """An image whose numbers reach the shader as they are in the file."""
    image = bpy.data.images.load(str(path), check_existing=False)
    image.name = name
    image.colorspace_settings.name = "Non-Color"
    # RGBA data would otherwise be divided by alpha, and float32 cut to half when it goes to the device.
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = path.suffix == ".exr" and _is_half(image)
    if pack:
        image.pack()
    return image


def _is_half(image: bpy.types.Image) -> bool:
    # Blender counts bits per pixel of the file: 48 and 64 for half RGB and RGBA.
    return image.depth in (48, 64)


def assemble(material: bpy.types.Material, group: bpy.types.ShaderNodeTree, albedo: tuple[float, float, float]) -> None:
    """Output <- group <- normal; EEVEE, which cannot follow the mirror, gets a stand-in of the same albedo.

    What an artist had linked to the group's Normal or Tint stays linked when a material is built again.
    """
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree, node.width = group, 240
    node.inputs["Tint"].default_value = (1, 1, 1)
    tree.links.new(geometry.outputs["Normal"], node.inputs["Normal"])
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.target = "CYCLES"
    tree.links.new(node.outputs["BSDF"], output.inputs["Surface"])
    stand_in = tree.nodes.new("ShaderNodeBsdfPrincipled")
    stand_in.label = "EEVEE stand-in"
    stand_in.inputs["Base Color"].default_value = (*albedo, 1)
    preview = tree.nodes.new("ShaderNodeOutputMaterial")
    preview.target = "EEVEE"
    tree.links.new(stand_in.outputs[0], preview.inputs["Surface"])
    material.diffuse_color = (*albedo, 1)
    # Cycles would bend the mirror's facet where its reflection dips under the surface: +0.8 % light on a coarse sphere.
    material.cycles.use_bump_map_correction = False
    arrange(tree)


def _normal_albedo(bundle: Bundle) -> tuple[float, float, float]:
    """Measured albedo at normal incidence, in [0, 1]."""
    albedo = bundle.material.get("albedo", {})
    rows = albedo.get("rgb") or [[0.5, 0.5, 0.5]]
    red, green, blue = (min(max(float(c), 0.0), 1.0) for c in rows[0])
    return red, green, blue
