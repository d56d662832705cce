"""A measured BRDF's material in another mode, or fitted to its scene: rebuilt at once, without a bake."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy

from ..bake.bundle import Bundle
from .brdf_build import account_of, build_brdf, choices_from
from .choices import Choices
from .effects import Effect
from .facts import facts_of, keep_facts
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

    rebuild(material, facts, images_of_brdf(facts, chosen), build)
    keep_facts(material, {**facts, "rendering": account})


def effects_of(material: bpy.types.Material) -> list[Effect]:
    """What the last build kept and left out, as far as it can be read."""
    listed = _rendering(facts_of(material)).get("effects")
    fields = [entry for entry in listed if isinstance(entry, dict)] if isinstance(listed, list) else []
    return [Effect(str(e.get("name", "")), e.get("kept") is True, str(e.get("why", ""))) for e in fields]


def images_of_brdf(facts: Mapping[str, Any], choices: Choices) -> list[str]:
    """Names of the bundle's images that a measured BRDF is built of where this is chosen."""
    images = facts.get("images")
    wanted = (*_IMAGES[choices.mode], "preview_weights")
    return [name for name in wanted if isinstance(images, dict) and name in images]


def _rendering(facts: Mapping[str, Any]) -> Mapping[str, Any]:
    found = facts.get("rendering")
    return found if isinstance(found, dict) else {}
