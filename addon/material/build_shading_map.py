"""A shading map's bundle as a material fitted to a scene."""

from __future__ import annotations

from typing import Any

import bpy

from ...bake.bundle.bundle import Bundle
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.render_settings import RenderSettings
from ...nodes.data_image import Images
from ...nodes.feature_passes import asks_for_passes
from ...nodes.shading_map_material import build_shading_map
from ...nodes.surface_marker import shows_normals
from ..lights.aim_targets import what_to_aim_at
from ..lights.kept_surveys import surveyed
from ..lights.light_tables import lamp_image
from .choices import OF_MAP, choices_of
from .scene_fit import Effect, is_ready, plan_aim, plan_bounces, plan_detail
from .texel_footprint import texel_footprint

# Label of the node that lays the swatch out.
SWATCH_MAPPING = "Swatch size and rotation"


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
    choices = choices_of(material.measured_quality)
    record = ShadingMapRecord.of(source)
    stored, layout = record.map, record.map.layout
    footprint = texel_footprint(material, scene, texels_per_uv(material, layout.width, layout.height))
    reduce, detail = plan_detail(choices, stored.model, footprint.pixels, footprint.why_unknown, material.name)
    effects = [detail]
    aim = plan_aim(choices, what_to_aim_at(surveyed(scene)), ready=ready)
    if settings.mode != "preview":
        effects += [aim, plan_bounces(settings.mode)]
    lamps = lamp_image() if aim.kept or is_ready(choices, ready) else None
    asked = {"features": asks_for_passes(scene), "normals": shows_normals(scene)}
    build_shading_map(
        record, material, settings=settings, images=images, pack=pack, lamps=lamps, reduce=reduce, **asked
    )
    if asked["features"] and settings.mode != "preview":
        effects.append(Effect("Denoiser's passes", True, "a view layer asks for them"))
    kept = {name: getattr(choices, name) for name in OF_MAP}
    return {"choices": kept, "effects": [effect.facts() for effect in effects]}


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
