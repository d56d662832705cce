"""Rules of the scene check: swatches whose map knows from which side light comes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import bpy

from ...nodes.material_tree import connect_frame, coordinates_before_tiling, measured_nodes
from ...nodes.swatch_frame_group import ALONG_U, ALONG_V, is_swatch_frame
from .findings import WRONG, Finding, Subject, editable


def swatch_frames(subject: Subject) -> Iterator[Finding]:
    """How the swatch lies has to be known, and by the coordinates that it lies by.

    An artist's own vectors are left alone.
    """
    for material in subject.wearers:
        for tree, node in measured_nodes(material.node_tree):
            if ALONG_U not in node.inputs:
                continue
            where, mend = f"material {material.name}", editable(tree, partial(connect_frame, tree, node))
            loose = [name for name in (ALONG_U, ALONG_V) if not node.inputs[name].is_linked]
            if loose:
                why = "where light comes from is counted by them: shadows fall as from a side that has no lamp"
                found, wanted = f"nothing is linked to {' and '.join(loose)}", "linked to a swatch frame"
                yield Finding("swatch_frame", WRONG, where, found, wanted, why, mend)
                continue
            frame = _frame_before(node)
            source = coordinates_before_tiling(node)
            if frame is None or source is None:
                continue
            given = frame.inputs["UV"].links[0].from_socket if frame.inputs["UV"].is_linked else None
            if given != source:
                why = "shadows fall as if the swatch lay otherwise"
                found = "its swatch frame is given other coordinates than the swatch"
                wanted = f"linked to {source.node.name}"
                yield Finding("swatch_frame_apart", WRONG, where, found, wanted, why, mend)


def _frame_before(node: bpy.types.Node) -> bpy.types.Node | None:
    """The frame that gives both vectors; None where an artist's own nodes do."""
    sources = {node.inputs[name].links[0].from_node for name in (ALONG_U, ALONG_V)}
    source = sources.pop()
    return source if not sources and is_swatch_frame(source) else None


RULES = (swatch_frames,)
