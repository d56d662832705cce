"""Who measured it, what others may do with it and where it was found, as properties of a bake of either kind."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ....bake.bundle.origin import file_origin, is_same
from ....bake.errors import BakeError
from ....bake.rights import MOST_LETTERS, RIGHTS, Rights
from ...material.facts import record_of, source_file


def _text(name: str, description: str) -> Any:
    # Kept for no other measurement: it would be stated of somebody else's.
    return bpy.props.StringProperty(name=name, description=description, maxlen=MOST_LETTERS, options={"SKIP_SAVE"})


AUTHOR = _text("Author", "Who measured it or took the photographs; kept with the baked files")
LICENSE = _text("License", "What others may do with it, for example CC0 or CC-BY 4.0; kept with the baked files")
SOURCE_URL = _text("Found At", "Where it was found, an address or a citation; kept with the baked files")


def rights_of(properties: Any) -> Rights:
    """The properties as they are kept. Raises BakeError."""
    return Rights(**{name: getattr(properties, name) for name in RIGHTS})


def show_rights(properties: Any, rights: Rights) -> None:
    """Set the properties to what was stated."""
    for name in RIGHTS:
        setattr(properties, name, getattr(rights, name))


def is_own(material: bpy.types.Material, source: Path | Sequence[Path]) -> bool:
    """Whether this is what the material was baked from: there, or a file of the same content that has been moved."""
    own, place = source_file(material), source if isinstance(source, Path) else source[0].parent
    if own is not None and own == place.resolve():
        return True
    try:
        return place.is_file() and is_same(record_of(material).source.entries, file_origin(place))
    except (BakeError, OSError):
        return False


def rights_beside(material: bpy.types.Material, rights: Rights) -> Rights:
    """Of these what was not stated of the material's own measurement: for a bake of another one."""
    try:
        stated = record_of(material).rights
    except BakeError:  # nobody knows of what this is said
        return Rights()
    kept = {name: words for name, words in rights.facts().items() if words != getattr(stated, name)}
    return Rights(**kept)


def draw_rights(layout: bpy.types.UILayout, properties: Any) -> None:
    """Draw all of them."""
    for name in RIGHTS:
        layout.prop(properties, name)
