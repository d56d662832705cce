"""A folder of maps as a plain material of Blender's Principled BSDF: textures, Normal Map, and height by choice.

Blender's exporters of glTF and USD find textures by following links, and know few nodes on the way: Normal Map,
Separate Color, and multiplication by a constant. So what `bake maps` makes by default goes along whole. Green that
points down is not turned for them, neither writes anything of heights, and glTF's takes linear albedo for sRGB.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..bake.errors import BakeError, check_choice
from ..bake.maps.detail import filtered_roughness
from ..bake.maps.folder import MapFile, MapsFolder
from ..bake.maps.relief import BY_NORMALS, RELIEFS, Relief, check_width
from ..bake.maps.write import FULL_SPECULAR
from . import compat, expr
from .data_image import movable_path
from .material_tree import safe_name
from .surface_inputs import SWATCH_MAPPING

# By so much a normal of 8 bits a channel may be too short.
_ROUNDED = 3**0.5 / 255
# The index of refraction at which an IOR Level of 1 is an F0 of 0.08.
_IOR = 1.5
# In place of 1: Blender's exporter doubles IOR Level to make it glTF's specular, but only where a factor is not 1.
_NEARLY_ONE = 0.9999
_COLUMN, _ROW = 300, 290


def build_principled(
    maps: MapsFolder, *, relief: Relief = "normal", width: float = 1.0, pack: bool = False
) -> bpy.types.Material:
    """A new material of these maps.

    Parameters
    ----------
    relief : "normal" by the Normal Map; "bump" by the height instead; "displacement" by the height, as displacement
        and bump of what the mesh is too coarse for. Of each other they would count the relief twice. "filtered" by the
        Normal Map, and where a renderer averages normals, as EEVEE does far away, what they vary by is roughness:
        highlights keep their width
    width : of the picture on the object, in Blender's units where it is not scaled: heights are parts of it
    pack : keep the textures inside the .blend

    Raises
    ------
    BakeError : a texture cannot be loaded, or `relief` or `width` make no sense
    """
    check_choice("relief", relief, RELIEFS)
    check_width(width)
    before = set(bpy.data.images)
    material = compat.new_material(safe_name(maps.name))
    try:
        _Tree(material, maps, pack).build(relief, width)
    except BaseException:
        bpy.data.materials.remove(material)
        bpy.data.batch_remove(set(bpy.data.images) - before)
        raise
    material.diffuse_color = (*(min(c, 1.0) for c in maps.mean_albedo), 1.0)
    return material


class _Tree:
    """The nodes of a material, as they are made."""

    def __init__(self, material: bpy.types.Material, maps: MapsFolder, pack: bool) -> None:
        self._material, self._maps, self._pack = material, maps, pack
        self._nodes, self._links = material.node_tree.nodes, material.node_tree.links
        coordinates, self._mapping = self._node("UVMap", -5, 0), self._node("Mapping", -4, 0)
        self._mapping.label = SWATCH_MAPPING
        self._link(coordinates.outputs["UV"], self._mapping.inputs["Vector"])

    def build(self, relief: Relief, width: float) -> None:
        """All of it. Raises BakeError."""
        output, closure = self._node("OutputMaterial", 1, 0), self._node("BsdfPrincipled", 0, 0)
        self._link(closure.outputs[0], output.inputs["Surface"])
        closure.inputs["IOR"].default_value = _IOR
        closure.inputs["Metallic"].default_value = 0.0
        self._link(self._texture("albedo", 0), closure.inputs["Base Color"])
        roughness = self._texture("roughness", 1)
        self._link(self._level(self._texture("specular", 2)), closure.inputs["Specular IOR Level"])
        if relief in BY_NORMALS:
            colour = self._texture("normal", 3)
            self._link(self._normal(colour), closure.inputs["Normal"])
            filtered = relief == "filtered"
            self._link(self._filtered(roughness, colour) if filtered else roughness, closure.inputs["Roughness"])
            return
        self._link(roughness, closure.inputs["Roughness"])
        height, about = self._texture("height", 3), self._maps.files["height"]
        if relief == "bump":
            bump = self._node("Bump", -1, 3)
            bump.inputs["Distance"].default_value = about.number("scale") * width
            self._link(height, bump.inputs["Height"])
            self._link(bump.outputs["Normal"], closure.inputs["Normal"])
            return
        moved = self._node("Displacement", 0, 3)
        moved.inputs["Midlevel"].default_value = about.number("midlevel")
        moved.inputs["Scale"].default_value = about.number("scale") * width
        self._link(height, moved.inputs["Height"])
        self._link(moved.outputs["Displacement"], output.inputs["Displacement"])
        self._material.displacement_method = "BOTH"

    def _texture(self, name: str, row: int) -> bpy.types.NodeSocket:
        """Colour of a map's texture. Raises BakeError."""
        node = self._node("TexImage", -3, row)
        node.image = map_image(self._maps.files[name], f"{self._material.name} {name}", self._pack)
        node.label = name.capitalize()
        if name == "height":  # linear interpolation would show each texel as a facet
            node.interpolation = "Cubic"
        self._link(self._mapping.outputs["Vector"], node.inputs["Vector"])
        return node.outputs["Color"]

    def _level(self, specular: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """IOR Level of F0, which PNG holds so already; by its red, since glTF's exporter takes alpha else."""
        apart, scaled = self._node("SeparateColor", -2, 2), self._node("Math", -1, 2)
        scaled.operation = "MULTIPLY"
        scaled.inputs[1].default_value = 1 / FULL_SPECULAR if self._maps.files["specular"].exact else _NEARLY_ONE
        self._link(specular, apart.inputs[0])
        self._link(apart.outputs[0], scaled.inputs[0])
        return scaled.outputs[0]

    def _filtered(self, roughness: bpy.types.NodeSocket, colour: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """Roughness by the length of the normal as it was read; which way green points is of no matter to that."""
        # Eight bits cannot tell a normal that was averaged a little from one that was rounded.
        rounding = 0.0 if colour.node.image.is_float else _ROUNDED
        before = len(self._nodes)
        with expr.building(self._material.node_tree):
            normal = expr.scale(expr.Vector(colour), 2.0) + expr.vec(-1.0, -1.0, -1.0)
            found = filtered_roughness(expr, expr.Scalar(roughness), expr.length(normal) + rounding)
        for k, node in enumerate(self._nodes[before:]):
            node.hide, node.location = True, (-1.5 * _COLUMN, -1.2 * _ROW - 40 * k)
        return found.socket

    def _normal(self, colour: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        normal = self._node("NormalMap", -1, 3)
        if not self._maps.green_up:
            apart, turned, again = (self._node(kind, -2, 3 + k) for k, kind in enumerate(_TURNING))
            turned.operation = "SUBTRACT"
            turned.inputs[0].default_value = 1.0
            self._link(colour, apart.inputs[0])
            self._link(apart.outputs[1], turned.inputs[1])
            for index in (0, 2):
                self._link(apart.outputs[index], again.inputs[index])
            self._link(turned.outputs[0], again.inputs[1])
            colour = again.outputs[0]
        self._link(colour, normal.inputs["Color"])
        return normal.outputs["Normal"]

    def _node(self, kind: str, column: float, row: float) -> Any:
        node = self._nodes.new(f"ShaderNode{kind}")
        node.location = column * _COLUMN, -row * _ROW
        return node

    def _link(self, output: Any, socket: Any) -> None:
        self._links.new(output, socket)


# Green that points down, turned: Blender's own Normal Map has it up.
_TURNING = ("SeparateColor", "Math", "CombineColor")


def map_image(file: MapFile, name: str, pack: bool = False) -> bpy.types.Image:
    """The map as Blender's image, in its own colour space. Raises BakeError."""
    path = Path(file.path).absolute()
    unreadable = BakeError(path, "cannot be loaded by Blender", "bake the photographs again with bake maps")
    try:
        image = bpy.data.images.load(str(path), check_existing=False)
    except RuntimeError as error:
        raise unreadable from error
    if not all(image.size):  # only now has Blender read it
        raise unreadable
    image.name = name
    if bpy.data.filepath and not pack:
        image.filepath = movable_path(path)
    image.colorspace_settings.name = file.color_space
    if pack:
        image.pack()
    return image
