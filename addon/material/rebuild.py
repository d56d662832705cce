"""A material in another mode, fitted to its scene or under another light: rebuilt at once, without a bake.

The bundle's folder may be gone by then: what a builder asks of a bundle is answered by the material itself.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...bake.brdf.baked_table import images_of_table
from ...bake.brdf.common import RenderingRecord
from ...bake.brdf.record import BrdfRecord
from ...bake.errors import BakeError
from ...bake.shading_maps.albedo import map_albedo_facts
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.render_settings import RenderSettings
from ...bake.shading_maps.shading_map import ShadingMap
from ...nodes.data_image import Images
from .build_brdf import account_of, build_brdf, choices_from
from .build_shading_map import build_map
from .choices import Choices
from .facts import facts_of, keep_facts, record_of
from .scene_fit import Effect
from .textures.kept import rebuild


def current_choices(material: bpy.types.Material) -> Choices:
    """Choices that a material is built by."""
    return choices_from(rendering_of(material).choices)


def rebuild_brdf(
    material: bpy.types.Material, choices: Choices | None = None, scene: bpy.types.Scene | None = None
) -> None:
    """Rebuild the material in place, of the textures it has, else of its bundle's; its choices stay by default.

    Raises BakeError.
    """
    record = record_of(material)
    chosen = choices or current_choices(material)
    account: dict[str, Any] = {}

    def build(loaded: BrdfRecord, images: Images | None) -> None:
        _, plan = build_brdf(loaded, material, choices=chosen, images=images, pack=record.packed, scene=scene)
        account.update(account_of(chosen, plan))

    rebuild(material, record, record.images_of(chosen.mode), build)
    keep_facts(material, {**record.document, "rendering": account})


def effects_of(material: bpy.types.Material) -> list[Effect]:
    """Effects that the last build kept and left out, as far as they can be read."""
    return [Effect(effect.name, effect.kept, effect.why) for effect in rendering_of(material).effects]


def current_lighting(material: bpy.types.Material) -> RenderSettings:
    """Lighting settings of a shading-map material. Raises BakeError."""
    render: RenderSettings = record_of(material).render
    return render


def relight(material: bpy.types.Material, settings: RenderSettings, scene: bpy.types.Scene | None = None) -> None:
    """Rebuild the material under another light, of the textures it has, else of its bundle's. Raises BakeError.

    What the scene, by default the current one, does not call for is left out, as far as the quality properties allow.
    """
    facts = {**facts_of(material), "render": settings.facts()}
    record = ShadingMapRecord.parse(facts, material.name)
    if settings.lobe is None and not record.has("table"):
        raise BakeError(material.name, "holds no measured BRDF to reflect by", "choose one under Bake and bake again")

    def build(loaded: ShadingMapRecord, images: Images | None) -> None:
        facts["albedo"] = _albedo(loaded)
        if loaded.through is not None:
            facts["through"] = {**facts["through"], "albedo": _albedo(loaded.through)}
        # What is built reads the albedo, which is that of the light before in what was loaded.
        lit = ShadingMapRecord.parse(facts, loaded.where, loaded.bundle)
        facts["rendering"] = build_map(lit, material, settings, images=images, pack=record.packed, scene=scene)

    rebuild(material, record, images_of_map(record, settings), build)
    keep_facts(material, facts)


def images_of_map(record: ShadingMapRecord, settings: RenderSettings) -> list[str]:
    """Names of the bundle's images that a map so lit is built of."""
    unused = images_of_table("table") if settings.lobe is not None else ()
    return [name for name in record.images if name not in unused]


def rendering_of(material: bpy.types.Material) -> RenderingRecord:
    """Also where nothing else can be read of what the material keeps."""
    return RenderingRecord.parse(facts_of(material).get("rendering"))


def _albedo(record: ShadingMapRecord) -> dict[str, Any]:
    """Under the light of the record, by the slices' mean colours. Raises BakeError."""
    stored, f_r = record.map, None
    if stored.means is None:
        raise BakeError(record.where, "does not say the slices' mean colours", "bake it again")
    if record.render.lobe is None:
        f_r = record.baked_lobe().load()
    means = np.array(stored.means, np.float32).reshape(stored.slices, 1, 1, 3)
    return map_albedo_facts(ShadingMap(means), record.render, stored.a_max, f_r)
