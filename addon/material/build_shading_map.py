"""A shading map's bundle as a material fitted to a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy

from ...bake.bundle.bundle import Bundle
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.reduced_map import UNSEEN, reduced_size
from ...bake.shading_maps.render_settings import RenderSettings
from ...bake.shading_maps.slice_atlas import SliceLayout
from ...nodes.aimed_light_group import ON_SHEET
from ...nodes.data_image import Images
from ...nodes.feature_passes import asks_for_passes
from ...nodes.shading_map_material import build_shading_map
from ...nodes.surface_inputs import SWATCH_MAPPING
from ...nodes.surface_marker import shows_normals
from ..lights.aim_targets import GAIN_OF_SWATCH, GAIN_OF_THROUGH, Sampling, sampling_of, what_to_aim_at
from ..lights.kept_surveys import surveyed
from ..lights.lamp_survey import LampReport
from ..lights.light_tables import lamp_image, lamp_light_image
from ..lights.seen_world import surroundings_of
from .choices import OF_MAP, OSL, Choices, choices_of
from .lighting import uses_mode
from .scene_fit import (
    NO_PASSES,
    NO_RAYS,
    OSL_EFFECT,
    RAYS,
    SAMPLED_EFFECT,
    THROUGH,
    Effect,
    is_ready,
    plan_aim,
    plan_azimuth,
    plan_bounces,
    plan_detail,
    plan_levels,
    plan_sampling,
)
from .texel_footprint import texel_footprint, texel_scale, units_seen
from .textures.packed import pack_textures


def build_map(
    source: Bundle | ShadingMapRecord,
    material: bpy.types.Material,
    settings: RenderSettings,
    *,
    images: Images | None = None,
    pack: bool,
    scene: bpy.types.Scene | None = None,
) -> dict[str, Any]:
    """Rebuild a shading map's material with what its quality properties and the scene call for, and return the account.

    The scene is by default the current one, and the material is then prepared for lamps added later. Raises BakeError.
    """
    ready, scene = scene is None, scene or bpy.context.scene
    report, choices = surveyed(scene), choices_of(material.measured_quality)
    record = ShadingMapRecord.of(source)
    stored, layout = record.map, record.map.layout
    per_uv = texels_per_uv(material, layout.width, layout.height)
    footprint = texel_footprint(material, scene, per_uv)
    reduce, detail = plan_detail(choices, stored.model, footprint.pixels, footprint.why_unknown, material.name)
    averaged = SliceLayout(layout.tiles, *reduced_size(layout, reduce))
    levels = plan_levels(choices, stored.model, averaged, settings.tiling, footprint)
    effects = [detail, levels]
    if stored.model == "azimuth":
        effects.append(plan_azimuth(settings, layout.tiles))
    through = record.through is not None
    light = plan_map_light(settings, choices, report, ready=ready, through=through)
    effects += light.effects
    if through and settings.mode != "preview" and not (light.sample and report.slots <= ON_SHEET):
        effects.append(THROUGH)
    passes = asks_for_passes(scene)
    build_lit_map(
        record,
        material,
        settings,
        light,
        report,
        images=images,
        pack=pack,
        reduce=reduce,
        texels=footprint.texels if levels.kept else 0.0,
        features=passes and not light.scripted,
        normals=shows_normals(scene),
    )
    if passes and settings.mode != "preview":
        why = NO_PASSES if light.scripted else "a view layer asks for them"
        effects.append(Effect("Denoiser's passes", not light.scripted, why))
    kept = {name: getattr(choices, name) for name in OF_MAP}
    scale: dict[str, Any] = {"pixels": texel_scale(scene, per_uv)} if levels.kept else {}
    if reduce > 1 and per_uv is not None:
        scale["joined"] = UNSEEN / reduce
        growth, units = scale["joined"] / footprint.pixels, units_seen(scene, [material])[material]
        scale["closest"] = {name: size * growth / min(per_uv) for name, size in units.pixels.items()}
    return {"choices": kept, "effects": [effect.facts() for effect in effects], **scale}


def build_lit_map(
    record: ShadingMapRecord,
    material: bpy.types.Material,
    settings: RenderSettings,
    light: MapLight,
    report: LampReport,
    **asked: Any,
) -> None:
    """Rebuild a shading map's material for the light of a scene that was surveyed; Cycles can read its textures then.

    Parameters
    ----------
    asked : what else `nodes.shading_map_material.build_shading_map` takes

    Raises
    ------
    BakeError : the material cannot be built, or this Blender has no OSL for a script
    """
    build_shading_map(
        record,
        material,
        settings=settings,
        lamps=lamp_image() if light.aim or light.sample else None,
        lights=lamp_light_image() if light.sample else None,
        surroundings=surroundings_of(report) if light.sample else None,
        scripted=light.scripted,
        **asked,
    )
    if light.scripted:
        pack_textures(material)


@dataclass(frozen=True)
class MapLight:
    """What becomes of a scene's light: whether it is aimed at or sampled, whether rays are scripts, and the account."""

    aim: bool
    sample: bool
    scripted: bool
    effects: tuple[Effect, ...]


def plan_map_light(
    settings: RenderSettings, choices: Choices, report: LampReport, *, ready: bool, through: bool
) -> MapLight:
    """The least that the mode needs, as `scene_fit.plan_brdf` has it.

    Parameters
    ----------
    through : whether the swatch lets light through

    Raises
    ------
    BakeError : lamps are to be sampled, which would bias the picture here
    """
    script = choices.shader == OSL
    by_nodes = (Effect(OSL_EFFECT, False, NO_RAYS),) if script else ()
    if settings.mode == "preview":
        return MapLight(False, False, False, by_nodes)
    sampled = Effect(SAMPLED_EFFECT, False, "of this technique Cycles' own shaders and a mirror are all")
    if uses_mode(settings.technique):
        sampling = sampling_for_map(choices, report, through=through)
        sampled = plan_sampling(replace(choices, mode=settings.mode), sampling)
        if sampled.kept:
            beside = (Effect("Aimed light", True, sampling.beside),) if sampling.beside else ()
            osl = (Effect(OSL_EFFECT, True, RAYS),) if script else ()
            return MapLight(False, True, script, (*beside, sampled, plan_bounces(settings.mode), *osl))
    aim = plan_aim(choices, what_to_aim_at(report), ready=ready)
    effects = (aim, sampled, plan_bounces(settings.mode), *by_nodes)
    return MapLight(aim.kept or is_ready(choices, ready), False, False, effects)


def sampling_for_map(choices: Choices, report: LampReport, *, through: bool) -> Sampling:
    """What a swatch, which may let light through, can sample in a scene of which this is the report."""
    gain = GAIN_OF_THROUGH if through else GAIN_OF_SWATCH
    found = sampling_of(report, scripted=choices.shader == OSL, gain=gain)
    if through and report.slots > ON_SHEET and not found.impossible:
        # Of lamps that are neither sampled nor aimed at each is met by chance.
        return replace(found, needless=f"of {report.slots} lamps two could be, and all are aimed at")
    return found


def texels_per_uv(material: bpy.types.Material, width: int, height: int) -> tuple[float, float] | None:
    """Texels along u and v in a unit of the UV map; None where an artist has linked something else to the swatch."""
    mapping = next(
        (n for n in material.node_tree.nodes if n.label == SWATCH_MAPPING and n.bl_idname == "ShaderNodeMapping"), None
    )
    if mapping is None or any(socket.is_linked for socket in mapping.inputs[1:]):
        return None
    source = mapping.inputs["Vector"].links[0].from_node if mapping.inputs["Vector"].is_linked else None
    # A UV map of another name than the active one may be laid out in any way.
    if source is None or source.bl_idname != "ShaderNodeUVMap" or source.uv_map:
        return None
    scale = mapping.inputs["Scale"].default_value
    if mapping.vector_type == "TEXTURE":  # as laid out by its physical size
        scale = [1 / s if s else 0.0 for s in scale]
    # Turned by any angle, a texel is at most as large as by the smaller of the two.
    least = min(abs(scale[0]) * width, abs(scale[1]) * height)
    return least, least
