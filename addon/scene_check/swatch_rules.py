"""Rules of the scene check: swatches whose map knows from which side light comes, and texels averaged by distance."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import bpy

from ...bake.brdf.common import RenderingRecord
from ...nodes.material_tree import measured_nodes
from ...nodes.parallax_group import is_parallax
from ...nodes.second_group import helpers_of, second_node
from ...nodes.surface_inputs import connect_frame, coordinates_before_tiling, frame_before, source_of
from ...nodes.swatch_frame_group import ALONG_U, ALONG_V
from ..material.build_shading_map import texels_per_uv
from ..material.facts import record_of
from ..material.kinds import SHADING_MAP, kind_of
from ..material.rebuild import rendering_of
from ..material.texel_footprint import Units, texel_footprint, texel_scale, units_seen
from .findings import WRONG, Finding, Subject, editable

# By so much texels may have grown in the picture since their material was fitted: a zoom, or a larger picture.
_CLOSER = 1.1


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


def swatch_levels(subject: Subject) -> Iterator[Finding]:
    """Texels are averaged as far as this camera and this picture's size allow it, which may have been others."""
    for material in subject.wearers:
        kind = kind_of(material)
        if kind is not SHADING_MAP or not (fitted := rendering_of(material).pixels):
            continue
        now = texel_scale(subject.scene, _per_uv(material))
        if now > fitted * _CLOSER:
            found = f"texels are {now / fitted:.2g} times as large as when it was fitted"
            why = "they are averaged by distance, now over more than can be seen: what is far away is blurred"
            again = editable(material, partial(kind.refit, material, subject.scene))
            yield Finding("swatch_levels", WRONG, f"material {material.name}", found, "fitted to the scene", why, again)


def swatch_texels(subject: Subject) -> Iterator[Finding]:
    """Texels were joined where this camera sees them smaller than a pixel, which has come nearer since, or moves.

    What is hidden is not asked. Meshes are looked at where one of them is seen larger than it was fitted to.
    """
    kept = {m: rendering_of(m) for m in subject.wearers if kind_of(m) is SHADING_MAP}
    joined = {material: rendering for material, rendering in kept.items() if rendering.joined}
    seen = units_seen(subject.scene, joined) if joined else {}
    for material, rendering in joined.items():
        found = ""
        if seen[material].moves:
            found = f"its texels were joined, and {seen[material].moves}"
        elif _may_be_larger(material, seen[material], rendering):
            now = texel_footprint(material, subject.scene, _per_uv(material), hidden=False)
            if not now.why_unknown and now.pixels > rendering.joined * _CLOSER:
                found = f"texels are {now.pixels / rendering.joined:.2g} times as large as may be joined"
        if found:
            why = "several of its texels became one where they were too small to be seen: it is blurred"
            again = editable(material, partial(SHADING_MAP.refit, material, subject.scene))
            yield Finding("swatch_texels", WRONG, f"material {material.name}", found, "fitted to the scene", why, again)


def _may_be_larger(material: bpy.types.Material, seen: Units, rendering: RenderingRecord) -> bool:
    """Whether texels may be seen larger than they may be joined, by how large meshes are seen."""
    texels = min(_per_uv(material) or (0.0,))
    closest = rendering.closest
    return any(size > closest.get(mesh, 0.0) * texels * _CLOSER for mesh, size in seen.pixels.items())


def _per_uv(material: bpy.types.Material) -> tuple[float, float] | None:
    layout = record_of(material).map.layout
    return texels_per_uv(material, layout.width, layout.height)


RULES = (swatch_frames, swatch_levels, swatch_texels)
