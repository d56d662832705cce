"""Who measured it, what others may do with it and where it was found, as properties of a bake of either kind."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any

import bpy

from ....bake.rights import MOST_LETTERS, RIGHTS, Rights
from .quality_choice import heading


def _text(name: str, description: str) -> Any:
    # Kept for no other measurement: it would be stated of somebody else's.
    return bpy.props.StringProperty(name=name, description=description, maxlen=MOST_LETTERS, options={"SKIP_SAVE"})


AUTHOR = _text("Author", "Who measured it or took the photographs; kept in the bundle")
LICENSE = _text("License", "What others may do with it, for example CC0 or CC-BY 4.0; kept in the bundle")
SOURCE_URL = _text("Found At", "Where it was found, an address or a citation; kept in the bundle")


def rights_of(properties: Any) -> Rights:
    """The properties as they are kept. Raises BakeError."""
    return Rights(**{name: getattr(properties, name) for name in RIGHTS})


def show_rights(properties: Any, rights: Rights) -> None:
    """Set the properties to what was stated."""
    for name in RIGHTS:
        setattr(properties, name, getattr(rights, name))


def draw_rights(layout: bpy.types.UILayout, properties: Any) -> None:
    """Draw them under their heading."""
    column = heading(layout, "Author and License")
    for name in RIGHTS:
        column.prop(properties, name)
