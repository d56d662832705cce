"""A bundle's material built for the scene that shows it, and its picture in the studio."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
from numpy.typing import NDArray

from ...bake.brdf.record import BrdfRecord
from ...bake.shading_maps.record import Record, ShadingMapRecord
from ...bake.shading_maps.render_settings import USUAL_REPEAT, RenderSettings
from ...nodes.feature_passes import asks_for_passes
from ...nodes.osl_script import use_osl
from ..lights.kept_surveys import surveyed
from ..material.bake_photographs import set_repeat
from ..material.build_brdf import build_brdf, usual_choices
from ..material.build_shading_map import build_lit_map, plan_map_light
from ..material.choices import Choices
from ..material.scene_fit import Effect, language_of
from ..rendering.contact_sheet import to_display
from ..rendering.denoising import AUTO, denoise_renders, plan_denoising
from .studio import build_studio, remove_studio, render_linear


def build_for(
    scene: bpy.types.Scene,
    record: Record,
    material: bpy.types.Material,
    choices: Choices,
    settings: RenderSettings | None = None,
    repeat: float = USUAL_REPEAT,
) -> Effect | None:
    """Build the material of a bundle in place, fitted to a scene.

    Parameters
    ----------
    settings : how a shading map is lit; None for a measured BRDF
    repeat : times that a swatch lies along a unit of texture coordinates

    Returns
    -------
    What became of Open Shading Language, None where `choices` do not ask for it; if a script takes part, the scene is
    set for it.

    Raises
    ------
    BakeError : the bundle holds not what is asked for
    """
    if isinstance(record, ShadingMapRecord):
        settings, report = settings or record.render, surveyed(scene)
        light = plan_map_light(settings, choices, report, ready=False, through=record.through is not None)
        if light.scripted:
            use_osl(scene)
        passes = asks_for_passes(scene) and not light.scripted
        build_lit_map(record, material, settings, light, report, features=passes)
        set_repeat(material, repeat, record.map.layout)
        return language_of(light.effects)
    plan = build_brdf(record, material, choices=choices, scene=scene)[1]
    if plan.osl or plan.scripted:
        use_osl(scene)
    return language_of(plan.effects)


def studio_picture(
    record: Record, size: int, samples: int, progress: Callable[[float], None] | None = None
) -> NDArray[np.uint8]:
    """A bundle's picture in the studio, as `render` makes it: (size, size, 3) sRGB, row 0 on top.

    Parameters
    ----------
    record : of a bundle, with its images
    size : in pixels
    samples : of each pixel; below 256 the picture is denoised where this Blender can
    progress : called with the share of samples done, in [0, 1]

    Raises
    ------
    BakeError : the bundle cannot be built
    RuntimeError : Blender could not render
    """
    material = bpy.data.materials.new("Shown bundle")
    try:
        scene = build_studio(material, resolution=(size, size), samples=samples)
        try:
            if plan_denoising(AUTO, samples, record).done:
                denoise_renders(scene)  # first, for the material then knows of its passes
            build_for(scene, record, material, usual_choices(record) if isinstance(record, BrdfRecord) else Choices())
            return to_display(render_linear(scene, progress=progress))
        finally:
            remove_studio(scene)
    finally:
        bpy.data.materials.remove(material)
