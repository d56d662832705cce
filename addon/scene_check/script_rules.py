"""Rule of the scene check: files that scripts of Open Shading Language read, which no .blend holds."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial

import bpy

from ...nodes.osl_parts import files_of
from ...nodes.texture_content import file_of
from ..material.kinds import kind_of
from ..material.textures.kept import textures_of
from .findings import WRONG, Finding, Subject, editable, measured_trees


def script_files(subject: Subject) -> Iterator[Finding]:
    """As where a .blend is rendered on another machine than the one on which its materials were built."""
    for material in subject.wearers:
        files = [file for tree in measured_trees(material) for node in tree.nodes for file in files_of(node)]
        lost = list(dict.fromkeys(file for file in files if file and not os.path.isfile(file)))
        if not lost:
            continue
        kind, mend = kind_of(material), None
        if kind is not None and _has_textures(material) and not kind.why_not_rebuildable(material):
            mend = editable(material, partial(kind.refit, material, subject.scene))
        found = f"file {lost[0]} is not there" + (f", nor are {len(lost) - 1} more" if len(lost) > 1 else "")
        why = "an OSL script reads its textures from files on this machine, and renders without them"
        wanted = "written again" if mend else "found, or baked again"
        yield Finding("missing_script_file", WRONG, f"material {material.name}", found, wanted, why, mend)


def _has_textures(material: bpy.types.Material) -> bool:
    """Whether each texture that the material keeps is in the .blend, or its file is there."""
    textures = textures_of(material).values()
    return all(image.packed_file is not None or os.path.isfile(file_of(image)) for image in textures)
