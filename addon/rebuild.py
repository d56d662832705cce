"""A measured BRDF's material in another mode, or fitted to its scene: rebuilt at once, without a bake."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.brdf.common import RenderingRecord
from ..bake.brdf.record import BrdfRecord
from ..nodes.data_image import Images
from .brdf_build import account_of, build_brdf, choices_from
from .choices import Choices
from .effects import Effect
from .facts import facts_of, keep_facts, record_of
from .kept_textures import rebuild

# Images of the bundle that each mode is built of, beside the weights of Preview.
_IMAGES = {
    "preview": (),
    "balanced": ("envelope", "residual", "residual_sampler"),
    "exact": ("envelope", "residual", "residual_sampler"),
    "reference": ("table", "sampler"),
}


def current_choices(material: bpy.types.Material) -> Choices:
    """How the material is built."""
    return choices_from(_rendering_of(material).choices)


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

    rebuild(material, record, images_of_brdf(record, chosen), build)
    keep_facts(material, {**record.document, "rendering": account})


def effects_of(material: bpy.types.Material) -> list[Effect]:
    """What the last build kept and left out, as far as it can be read."""
    return [Effect(effect.name, effect.kept, effect.why) for effect in _rendering_of(material).effects]


def images_of_brdf(record: BrdfRecord, choices: Choices) -> list[str]:
    """Names of the bundle's images that a measured BRDF is built of where this is chosen."""
    return [name for name in (*_IMAGES[choices.mode], "preview_weights") if record.has(name)]


def _rendering_of(material: bpy.types.Material) -> RenderingRecord:
    """Also where nothing else can be read of what the material keeps."""
    return RenderingRecord.parse(facts_of(material).get("rendering"))
