"""A measured BRDF's bundle as a material fitted to a scene: the one way that panel, import and command line take."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from ...bake.brdf.record import BrdfRecord
from ...bake.bundle.bundle import Bundle
from ...nodes.data_image import Images
from ...nodes.feature_passes import asks_for_passes
from ...nodes.material import build_material, usual_mode
from ...nodes.osl_material import build_osl_material
from ...nodes.osl_script import use_osl
from ...nodes.surface_marker import shows_normals
from ..lights.aim_targets import lamps_are_alone, sampling_of, what_to_aim_at
from ..lights.kept_surveys import surveyed
from ..lights.light_tables import lamp_image, lamp_light_image
from .choices import AUTO, NEVER, Choices
from .scene_fit import BrdfPlan, plan_brdf, plan_sampling


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
    targets = what_to_aim_at(report)
    sampling, normals = sampling_of(report), shows_normals(scene)
    plan = plan_brdf(record, choices, targets, passes, ready=ready, sampling=sampling, normals=normals)
    material = build_material(
        record,
        material,
        filter=plan.filter,
        images=images,
        pack=pack,
        lamps=lamp_image() if plan.aim or plan.sample else None,
        lights=lamp_light_image() if plan.sample else None,
        mode=plan.mode,
        residual=plan.residual,
        features=plan.features,
        normals=plan.normals,
        lamp_share=plan.aim and lamps_are_alone(report),
    )
    return material, plan


def build_osl_brdf(
    source: Bundle | BrdfRecord,
    material: bpy.types.Material | None = None,
    *,
    choices: Choices,
    scene: bpy.types.Scene,
) -> bpy.types.Material:
    """Build or rebuild a material as one OSL shader, which can sample lamps in every version of Blender.

    The scene is made to render with OSL, on the CPU. Raises BakeError where a choice cannot be had.
    """
    record = BrdfRecord.of(source)
    filter = None if choices.filter == AUTO else choices.filter
    record.check_filter(filter or record.table.filter, choices.mode)
    use_osl(scene)
    asked = Choices(choices.mode, sample=choices.sample)  # whatever is aimed at
    sampled = plan_sampling(asked, sampling_of(surveyed(scene), osl=True)).kept
    return build_osl_material(
        record,
        material,
        mode=choices.mode,
        filter=filter,
        lamps=lamp_image() if sampled or choices.aim != NEVER else None,
        lights=lamp_light_image() if sampled else None,
        normals=shows_normals(scene),
    )


def usual_choices(record: BrdfRecord, mode: str | None = None) -> Choices:
    """Everything automatic, in a given mode or the one that the bundle is good for."""
    return Choices(mode=mode or usual_mode(record))


def account_of(choices: Choices, plan: BrdfPlan) -> dict[str, Any]:
    """Choices and their effects as kept with the material; JSON-ready."""
    return {
        "choices": {key: getattr(choices, key) for key in ("mode", "aim", "sample", "residual", "filter")},
        "effects": [effect.facts() for effect in plan.effects],
    }


def choices_from(known: Mapping[str, str]) -> Choices:
    """The choices that `account_of` kept, as far as a record's `rendering` holds them."""
    names = ("mode", "aim", "sample", "residual", "filter", "detail")
    return Choices(**{key: known[key] for key in names if key in known})
