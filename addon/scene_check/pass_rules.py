"""Rules of the scene check: passes of a view layer that mirrors spoil."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import bpy

from ...nodes.feature_passes import ALBEDO
from ...nodes.surface_marker import is_marked_for_passes, shows_normals
from ..material.facts import is_measured
from ..material.kinds import kind_of
from .findings import NOTE, WRONG, Finding, Subject, editable, measured_trees


def normal_pass(subject: Subject) -> Iterator[Finding]:
    """The Normal pass, for which a material has to be built."""
    if not shows_normals(subject.scene):
        return
    for material in subject.mirrors:
        if any(is_marked_for_passes(tree) for tree in measured_trees(material)):
            continue
        kind, mend = kind_of(material) if is_measured(material) else None, None
        if kind is not None and not kind.why_not_rebuildable(material):
            mend = editable(material, partial(kind.refit, material, subject.scene))
        why = "a view layer shows the Normal pass, in which such a material has the normals of its mirrors"
        where, found = f"material {material.name}", "is not built for the Normal pass"
        yield Finding("normal_pass", WRONG, where, found, "fitted to the scene", why, mend)


def denoising_data(subject: Subject) -> Iterator[Finding]:
    """Cycles' own passes for a denoiser, without those of the materials."""
    for layer in subject.scene.view_layers:
        if subject.mirrors and layer.use and _stores_only_its_own(layer):
            why = "noisy where a mirror was drawn; Denoise by Materials adds albedo and normals without noise"
            where = f"scene {subject.scene.name}, {layer.name}"
            yield Finding("denoising_data", NOTE, where, "Denoising Data is on", "", why)


def _stores_only_its_own(layer: bpy.types.ViewLayer) -> bool:
    return layer.cycles.denoising_store_passes and ALBEDO not in layer.aovs


RULES = (normal_pass, denoising_data)
