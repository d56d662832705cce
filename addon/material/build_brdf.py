"""A measured BRDF's bundle as a material fitted to a scene: the one way that panel, import and command line take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import bpy

from ...bake.brdf.record import BrdfRecord
from ...bake.bundle.bundle import Bundle
from ...bake.envelope.gloss_energy import Rows, brightened_by_gloss
from ...nodes.aimed_light_group import MAX_SLOTS, ON_SHEET
from ...nodes.data_image import Images
from ...nodes.feature_passes import asks_for_passes
from ...nodes.material import build_material, usual_mode
from ...nodes.osl_material import build_osl_material
from ...nodes.surface_marker import shows_normals
from ..lights.aim_targets import (
    GAIN_OF_BRDF,
    GAIN_OF_SHEET,
    Sampling,
    lamps_are_alone,
    sampling_of,
    what_to_aim_at,
)
from ..lights.kept_surveys import surveyed
from ..lights.lamp_survey import LampReport
from ..lights.light_tables import lamp_image, lamp_light_image
from ..lights.seen_world import surroundings_of
from .choices import NAMES, OF_BRDF, OSL, Choices
from .scene_fit import BrdfPlan, plan_brdf
from .textures.packed import pack_textures
from .textures.script_files import texture_files


def build_brdf(
    source: Bundle | BrdfRecord,
    material: bpy.types.Material | None = None,
    *,
    choices: Choices | None = None,
    images: Images | None = None,
    pack: bool = False,
    scene: bpy.types.Scene | None = None,
) -> tuple[bpy.types.Material, BrdfPlan]:
    """Build or rebuild a material with what the choices and the scene call for.

    Parameters
    ----------
    source : the bundle's record, or the bundle, which is then read
    choices : by default the bundle's usual mode, all else automatic
    images : the textures; by default those of the bundle, loaded
    scene : that it is fitted to; by default the current one, and prepared for lamps added later

    Raises
    ------
    BakeError : the bundle holds not what is asked for
    """
    record = BrdfRecord.of(source)
    choices = choices or usual_choices(record)
    ready, scene = scene is None, scene or bpy.context.scene
    report, passes = surveyed(scene), asks_for_passes(scene)
    most = ON_SHEET if record.sheet is not None and choices.shader != OSL else MAX_SLOTS
    targets, sampling = what_to_aim_at(report, most), sampling_for(record, choices, report)
    plan = plan_brdf(
        record,
        choices,
        targets,
        passes,
        ready=ready,
        sampling=sampling,
        by_script=_sampling_by_script(report),
        normals=shows_normals(scene),
    )
    behind = _brightened(record.part("behind"), plan.mode)
    plan = replace(plan, brightened=_brightened(record, plan.mode), brightened_behind=behind)
    lamps = lamp_image() if plan.aim or plan.sample else None
    lights = lamp_light_image() if plan.sample else None
    surroundings = surroundings_of(report) if plan.sample else None
    if plan.osl:
        material = build_osl_material(
            record,
            material,
            mode=plan.mode,
            filter=plan.filter,
            lamps=lamps,
            lights=lights,
            surroundings=surroundings,
            files=texture_files(record),
            images=images,
            normals=plan.normals,
        )
    else:
        material = build_material(
            record,
            material,
            filter=plan.filter,
            images=images,
            pack=pack,
            lamps=lamps,
            lights=lights,
            surroundings=surroundings,
            mode=plan.mode,
            residual=plan.residual,
            features=plan.features,
            normals=plan.normals,
            lamp_share=plan.aim and lamps_are_alone(report),
            scripted=plan.scripted,
        )
    if plan.osl or plan.scripted:
        pack_textures(material)
    return material, plan


def sampling_for(record: BrdfRecord, choices: Choices, report: LampReport) -> Sampling:
    """What a material can sample in a scene of which this is the report."""
    gain = GAIN_OF_BRDF if record.sheet is None else GAIN_OF_SHEET
    return sampling_of(report, osl=choices.shader == OSL, gain=gain)


def _sampling_by_script(report: LampReport) -> Sampling:
    """What nodes of a BRDF can sample that a script tells which lamps are seen, as far as that is as good as one
    script."""
    if report.slots + (not report.world_inexact) > 1:
        # Nodes draw one of the lights, and are noisier at equal time.
        return Sampling(needless="there are several lights, of which one script as a whole samples each")
    return sampling_of(report, scripted=True)


def usual_choices(record: BrdfRecord, mode: str | None = None) -> Choices:
    """Everything automatic, in a given mode or the one that the bundle is good for."""
    return Choices(mode=mode or usual_mode(record))


def account_of(choices: Choices, plan: BrdfPlan) -> dict[str, Any]:
    """Choices and their effects as kept with the material; JSON-ready."""
    account = {
        "choices": {name: getattr(choices, name) for name in OF_BRDF},
        "effects": [effect.facts() for effect in plan.effects],
        "brightened": _told(plan.brightened),
    }
    return account | ({"brightened_behind": _told(plan.brightened_behind)} if plan.brightened_behind else {})


def _told(brightened: tuple[tuple[float, Rows], ...]) -> list[Any]:
    return [[gloss, [list(row) for row in rows]] for gloss, rows in brightened]


def _brightened(record: BrdfRecord | None, mode: str) -> tuple[tuple[float, Rows], ...]:
    """What a mode's native closures gain with the gloss; nothing of what is not there. Raises BakeError."""
    if record is None or mode == "reference":
        return ()
    fit = record.load_preview() if mode == "preview" else record.load_envelope()
    return brightened_by_gloss(fit, record.albedo.theta_o_deg)


def choices_from(known: Mapping[str, str]) -> Choices:
    """The choices that `account_of` kept, as far as a record's `rendering` holds them."""
    # Any: that these texts are choices only whoever wrote them knows.
    kept: dict[str, Any] = {name: known[name] for name in NAMES if name in known}
    return Choices(**kept)
