"""What a material of ours keeps of its bundle, so that it is known wherever the .blend goes."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy

from ...bake.brdf.common import ImageRecord
from ...bake.bundle.checked_json import dump_json
from ...bake.errors import BakeError
from ...bake.shading_maps.record import Record, parse_record
from ...nodes.material_tree import SOURCE_KEY

# The bundle's facts as JSON text, kept with the material.
FACTS_KEY = "measured_materials_facts"


def keep_facts(material: bpy.types.Material, facts: Mapping[str, Any]) -> None:
    """Replace what is known of the material."""
    material[FACTS_KEY] = dump_json(facts, material.name)


def is_measured(material: bpy.types.Material | None) -> bool:
    """Whether the material was made here."""
    return material is not None and isinstance(material.get(FACTS_KEY), str)


def facts_of(material: bpy.types.Material) -> dict[str, Any]:
    """What its bundle said of it, as it is written; empty if that is not to be read. Do not change it."""
    return _parsed(material[FACTS_KEY])


def record_of(material: bpy.types.Material) -> Record:
    """What its bundle said of it, checked, without images. Raises BakeError that names the material."""
    return _recorded(material[FACTS_KEY], material.name)


def images_of(material: bpy.types.Material) -> Mapping[str, ImageRecord]:
    """The images of its bundle by name; none where what it keeps is not to be read."""
    try:
        return record_of(material).images
    except BakeError:
        return {}


# A panel asks several times in each redraw.
@functools.lru_cache(maxsize=64)
def _recorded(text: str, name: str) -> Record:
    return parse_record(_parsed(text), name)


@functools.lru_cache(maxsize=64)
def _parsed(text: str) -> dict[str, Any]:
    try:
        facts = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return facts if isinstance(facts, dict) else {}


def source_file(material: bpy.types.Material) -> Path | None:
    """The measurement or the folder of photographs it was baked from, as a path that may be gone; None for a model."""
    text = material.get(SOURCE_KEY)
    return Path(text) if isinstance(text, str) and text else None
