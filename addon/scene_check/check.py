"""Scene check: settings that bias or slow measured materials, and how they are fixed (method.md, section 15)."""

from __future__ import annotations

from collections.abc import Container, Iterable

import bpy

from ...nodes.group import looking_once
from . import (
    camera_rules,
    energy_rules,
    light_path_rules,
    material_rules,
    mix_rules,
    pass_rules,
    scene_rules,
    script_rules,
    sheet_rules,
    swatch_rules,
)
from .findings import NOTE, SEVERITIES, Finding, Subject, subject_of

_ROUNDS = 3


def check_scene(scene: bpy.types.Scene) -> list[Finding] | None:
    """Findings on what a render would do to measured materials, the gravest first; None if the scene shows none.

    Nothing is changed, but that Cycles is switched on where it was not.
    """
    with looking_once():
        return _found(subject_of(scene))


def _found(subject: Subject) -> list[Finding] | None:
    if not subject.wearers:
        return None
    rules = (
        *scene_rules.RULES,
        *light_path_rules.RULES,
        *material_rules.RULES,
        *pass_rules.RULES,
        script_rules.script_files,
        *sheet_rules.RULES,
        *swatch_rules.RULES,
        mix_rules.mixed_mirror,
        *camera_rules.RULES,
        energy_rules.too_bright,
    )
    if not subject.mirrors:  # mode Preview: native closures, which Cycles' own settings suit
        rules = (
            material_rules.textures,
            material_rules.common_names,
            material_rules.texture_limit,
            material_rules.changed_groups,
            swatch_rules.swatch_levels,
            swatch_rules.swatch_texels,
            energy_rules.too_bright,
        )
    found = [finding for rule in rules for finding in rule(subject)]
    return sorted(found, key=lambda finding: SEVERITIES.index(finding.severity))


def mend(findings: Iterable[Finding]) -> list[Finding]:
    """Fix what can be fixed, notes included; returns what was."""
    mended = []
    for finding in findings:
        if finding.mend is not None:
            finding.mend()
            mended.append(finding)
    return mended


def mend_scene(scene: bpy.types.Scene, without: Container[str] = ()) -> list[Finding]:
    """Fix all but the notes, and what comes to light by that: a lamp that was given a size can be aimed at.

    Rules named in `without` are left alone.
    """
    mended: dict[str, Finding] = {}
    for _ in range(_ROUNDS):
        found = [
            f for f in check_scene(scene) or () if f.severity != NOTE and not (f.key in mended or f.rule in without)
        ]
        done = mend(found)
        mended |= {finding.key: finding for finding in done}
        if not done:
            break
    return list(mended.values())


def measured_names(scene: bpy.types.Scene) -> list[str]:
    """Names of the measured materials that a render of the scene shows."""
    return [material.name for material in subject_of(scene).wearers]
