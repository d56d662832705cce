"""How to read what a measurement's file leaves open, as properties: the same on the import operator and a material."""

# No postponed annotations here: Blender reads the properties from them.
from dataclasses import asdict
from typing import Any

import bpy

from ....bake.reading import READING_CHOICES, READING_NAMES, Reading
from .enum_items import enum

_USUAL = asdict(Reading())


def _choice(key: str, name: str, description: str, words: dict[str, tuple[str, str]]) -> Any:
    return enum(name, description, READING_CHOICES[key], words, _USUAL[key])


_ILLUMINANT = _choice(
    "illuminant",
    "Illuminant",
    "Light that a spectral measurement becomes colours under; its white is white",
    {
        "D65": ("D65", "Daylight"),
        "E": ("E", "Equal energy"),
        "A": ("A", "Lamplight"),
        "LED-B3": ("LED-B3", "A white LED of 4100 K"),
    },
)
_MERL = _choice(
    "merl",
    "MERL Entries",
    "What an entry of a MERL file stands for",
    {
        "auto": ("Automatic", "As the file's own mirror symmetry has it"),
        "bins": ("Cells", "The cell above its index, as the authors' own program reads it"),
        "nodes": ("Points", "The point at its index, as programs that interpolate mostly read it"),
    },
)
_RECIPROCITY = _choice(
    "reciprocity",
    "Light and Viewer",
    "Which direction of a measured pair is the light's",
    {
        "measured": ("As Measured", "The file's incident direction"),
        "exchanged": ("Exchanged", "The file's other direction, as Mitsuba and pbrt read RGL files"),
        "mean": ("Mean of Both", "The same from both sides, with half the noise of the measurement"),
    },
)
_SIDE = _choice(
    "side",
    "Side",
    "Side of a window layer",
    {
        "auto": ("Automatic", "The front where there is one"),
        "front": ("Front", "Reflection Back of the file, which Radiance loads as the front"),
        "back": ("Back", "Reflection Front of the file"),
    },
)
_UTIA = _choice(
    "utia",
    "UTIA Values",
    "What the numbers of a UTIA file are, which the file does not say",
    {
        "auto": ("Automatic", "Linear, unless that would reflect more light than arrives"),
        "linear": ("Linear", "Reflectance in 1/sr"),
        "sRGB": ("sRGB", "Encoded for a screen"),
        "scaled": ("Scaled", "Divided by 140, encoded, times 100"),
    },
)
_MATERIAL = bpy.props.StringProperty(
    name="Material",
    description="Name of one of several materials in a file, such as the published parameters of all MERL materials",
    default=_USUAL["material"],
    maxlen=100,
    options={"SKIP_SAVE"},  # kept for no other file, which has other materials
)
_PREFIX = "read_"


class ReadingProperties:
    """Mixed into a PropertyGroup or an Operator."""

    read_illuminant: _ILLUMINANT
    read_merl: _MERL
    read_reciprocity: _RECIPROCITY
    read_side: _SIDE
    read_utia: _UTIA
    read_material: _MATERIAL


def reading_of(properties: Any) -> Reading:
    """The properties as a reading."""
    return Reading(**{name: getattr(properties, _PREFIX + name) for name in READING_NAMES})


def show_reading(properties: Any, reading: Reading) -> None:
    """Set the properties to a reading."""
    for name, value in asdict(reading).items():
        setattr(properties, _PREFIX + name, value)


def draw_reading(layout: bpy.types.UILayout, properties: Any) -> None:
    """Draw the choices."""
    layout.label(text="What the File Leaves Open")
    for name in READING_NAMES:
        layout.prop(properties, _PREFIX + name)
