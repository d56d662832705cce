"""Whether a scene has something that a mirror can be aimed at, in words."""

from __future__ import annotations

import bpy

from .lamp_survey import survey_scene


def what_to_aim_at(scene: bpy.types.Scene) -> str:
    """What is aimed at and why it pays; empty if there is nothing."""
    report = survey_scene(scene, for_render=True)
    if not report.slots and not report.world.aimed:
        return ""
    words = report.words()[0]
    return words[:1].lower() + words[1:]
