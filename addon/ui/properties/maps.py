"""What the artist can set where photographs become maps, as Blender properties."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any

import bpy

from ....bake.maps.bake import MapSettings
from ....bake.maps.relief import BY_NORMALS, RELIEFS
from ....bake.maps.write import FILE_KINDS, NORMAL_CONVENTIONS
from ....bake.photographs.settings import StackSettings
from ...material.lighting import number
from .enum_items import enum

_USUAL = MapSettings()
_MAKES = ("shading", "maps", "both")
_WORDS = {
    "shading": ("Shading Map", "A measured material, of lamps along one arc"),
    "maps": (
        "Maps",
        "Normal, albedo, height, roughness and specular as files, of lamps all around, and a Principled BSDF",
    ),
    "both": ("Both", "The measured material, and beside it maps and their Principled BSDF"),
    "normal": ("Normal", "A Normal Map"),
    "bump": ("Bump", "The height, as bump"),
    "displacement": ("Displacement", "The height, as displacement of a mesh that is fine enough, and as bump"),
    "filtered": ("Filtered Normal", "For EEVEE: a Normal Map, and rougher where it is averaged far away"),
    "opengl": ("Green Up", "As Blender and glTF have it (OpenGL)"),
    "directx": ("Green Down", "As DirectX has it"),
    "png8": ("PNG 8 bits", "The smallest"),
    "png16": ("PNG 16 bits", "16 bits for normals, height and albedo"),
    "exr": ("OpenEXR", "32 bits, linear, and reflectance of any strength"),
}


RELIEF = enum("Relief", "What shows the relief in the material of the maps", RELIEFS, _WORDS, RELIEFS[0])
SWATCH_WIDTH = bpy.props.FloatProperty(
    name="Width",
    description="Width of the picture on the object, which heights are measured in",
    default=1.0,
    min=1e-4,
    max=1e4,
    unit="LENGTH",
)


class MapsProperties:
    """Mixed into the import operator of photographs."""

    __annotations__ = {
        "make": enum("Make", "What the photographs become", _MAKES, _WORDS, _MAKES[0], options={"SKIP_SAVE"}),
        "relief": RELIEF,
        "swatch_width": SWATCH_WIDTH,
        "map_normals": enum(
            "Normals", "Which way green points in the file", NORMAL_CONVENTIONS, _WORDS, _USUAL.normals
        ),
        "map_files": enum("Map Files", "Format of the maps", FILE_KINDS, _WORDS, _USUAL.files),
        "level": bpy.props.BoolProperty(
            name="Level",
            description="The swatch is flat as a whole: leave out slopes that a lamp nearby adds",
            default=_USUAL.level,
        ),
        "reduce": bpy.props.IntProperty(
            name="Reduce",
            description="So many texels across become one, for a swatch seen from far away; what their normals vary by "
            "goes into the roughness",
            default=_USUAL.reduce,
            min=1,
            soft_max=64,
            max=4096,
        ),
        "repeats": bpy.props.BoolProperty(
            name="Repeats", description="The frame goes on at its opposite edge", default=_USUAL.repeats
        ),
    }


def map_settings_of(properties: Any, stack: StackSettings) -> MapSettings:
    """The properties, and how the photographs are read, as settings of a bake. Raises BakeError."""
    p = properties
    return MapSettings(p.map_normals, p.map_files, p.level, p.repeats, stack, p.reduce)


def width_of(properties: Any) -> float:
    """As typed."""
    return number(properties.swatch_width)


def draw_maps(layout: bpy.types.UILayout, properties: Any) -> None:
    """Draw what the photographs become, and the settings of maps where they become some."""
    row = layout.row(align=True)
    row.prop(properties, "make", expand=True)
    if properties.make == "shading":
        return
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    names = ("relief", "map_files", "map_normals", "level", "repeats", "reduce")
    for name in names if properties.relief in BY_NORMALS else (names[0], "swatch_width", *names[1:]):
        column.prop(properties, name)
