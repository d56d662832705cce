"""Rules of the scene check: swatches whose map knows from which side light comes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import bpy

from ...nodes.material_tree import measured_nodes
from ...nodes.parallax_group import is_parallax
from ...nodes.second_group import helpers_of, second_node
from ...nodes.surface_inputs import connect_frame, coordinates_before_tiling, frame_before, source_of
from ...nodes.swatch_frame_group import ALONG_U, ALONG_V
from .findings import WRONG, Finding, Subject, editable


def swatch_frames(subject: Subject) -> Iterator[Finding]:
    """How the swatch lies has to be known, and by the coordinates that it lies by; also of one that is blended in.

    An artist's own vectors are left alone.
    """
    for material in subject.wearers:
        for tree, node in _swatches(material.node_tree):
            where, mend = f"material {material.name}", editable(tree, partial(_mend, tree, node))
            loose = [name for name in (ALONG_U, ALONG_V) if source_of(node.inputs[name]) is None]
            if loose:
                why = "where light comes from is counted by them: shadows fall as from a side that has no lamp"
                found, wanted = f"nothing is linked to {' and '.join(loose)}", "linked to a swatch frame"
                yield Finding("swatch_frame", WRONG, where, found, wanted, why, mend)
                continue
            frame = frame_before(node)
            source = coordinates_before_tiling(node)
            if frame is None or source is None:
                continue
            if source_of(frame.inputs["UV"]) != source:
                why = "shadows fall as if the swatch lay otherwise"
                found = "its swatch frame is given other coordinates than the swatch"
                wanted = f"linked to {source.node.name}"
                yield Finding("swatch_frame_apart", WRONG, where, found, wanted, why, mend)


def _swatches(tree: bpy.types.ShaderNodeTree) -> Iterator[tuple[bpy.types.NodeTree, bpy.types.Node]]:
    """Nodes whose map knows from which side light comes, or that move its coordinates, each after its tree."""
    second = second_node(tree)
    for inner, node in [*measured_nodes(tree), *([(tree, second)] if second is not None else [])]:
        if ALONG_U in node.inputs:
            yield inner, node
        source = source_of(node.inputs["UV"]) if "UV" in node.inputs else None
        if source is not None and is_parallax(source.node):
            yield inner, source.node


def _mend(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    with helpers_of(tree, node):
        connect_frame(tree, node)


RULES = (swatch_frames,)
