"""A measured BRDF's material in another mode, or fitted to its scene: rebuilt at once, without a bake."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import bpy

from ..bake.bundle import Bundle, is_bundle
from ..bake.errors import BakeError
from .brdf_build import account_of, build_brdf, choices_from
from .choices import Choices, choices_of, show_choices
from .effects import Effect
from .facts import facts_of, is_measured, is_shading_map, keep_facts
from .kept_textures import bundle_path, missing_texture, rebuild
from .text import one_line

# Images of the bundle that each mode is built of, beside the weights of Preview.
_IMAGES = {
    "preview": (),
    "balanced": ("envelope", "residual", "residual_sampler"),
    "exact": ("envelope", "residual", "residual_sampler"),
    "reference": ("table", "sampler"),
}


def rebuild_or_say(material: bpy.types.Material) -> None:
    """Rebuild the material as its quality properties say; where that fails, say so there and set them back."""
    properties = material.measured_quality
    properties.problem = ""
    if not is_measured(material):
        return
    try:
        if is_shading_map(material):
            refit(material)
        else:
            rebuild_brdf(material, choices_of(properties))
    except BakeError as error:
        properties.problem = one_line(f"{error.cause}; {error.remedy}")
        with contextlib.suppress(BakeError):
            show_choices(properties, current_choices(material))


def current_choices(material: bpy.types.Material) -> Choices:
    """How the material is built."""
    return choices_from(_rendering(facts_of(material)))


def rebuild_brdf(
    material: bpy.types.Material, choices: Choices | None = None, scene: bpy.types.Scene | None = None
) -> None:
    """Rebuild the material in place, of the textures it has, else of its bundle's; its choices stay by default.

    Raises BakeError.
    """
    facts = dict(facts_of(material))
    chosen = choices or current_choices(material)
    account: dict[str, Any] = {}

    def build(bundle: Bundle) -> None:
        _, plan = build_brdf(bundle, material, choices=chosen, pack=facts.get("packed") is True, scene=scene)
        account.update(account_of(chosen, plan))

    rebuild(material, facts, _needed(facts, chosen), build)
    keep_facts(material, {**facts, "rendering": account})


def refit(material: bpy.types.Material, scene: bpy.types.Scene | None = None) -> None:
    """Rebuild a material of either kind with what a scene calls for; all that was chosen stays. Raises BakeError.

    Without a scene it is the current one, and the material is ready for lamps that come later.
    """
    if is_shading_map(material):
        from .arc_relight import current_lighting, relight

        relight(material, current_lighting(material), scene)
    else:
        rebuild_brdf(material, scene=scene)


def effects_of(material: bpy.types.Material) -> list[Effect]:
    """What the last build kept and left out, as far as it can be read."""
    listed = _rendering(facts_of(material)).get("effects")
    fields = [entry for entry in listed if isinstance(entry, dict)] if isinstance(listed, list) else []
    return [Effect(str(e.get("name", "")), e.get("kept") is True, str(e.get("why", ""))) for e in fields]


def why_not_rebuildable(material: bpy.types.Material) -> str:
    """Why the mode cannot be changed; empty if it can."""
    path = bundle_path(material)
    try:
        facts = facts_of(material)
        missing = missing_texture(material, facts, _needed(facts, current_choices(material)))
    except BakeError as error:
        return one_line(str(error))
    return f"{missing}, and {path} is gone" if missing and not is_bundle(path) else ""


def _needed(facts: Mapping[str, Any], choices: Choices) -> list[str]:
    images = facts.get("images")
    wanted = (*_IMAGES[choices.mode], "preview_weights")
    return [name for name in wanted if isinstance(images, dict) and name in images]


def _rendering(facts: Mapping[str, Any]) -> Mapping[str, Any]:
    found = facts.get("rendering")
    return found if isinstance(found, dict) else {}
