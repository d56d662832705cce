"""A shading-map material under another light: rebuilt at once of the textures it has, without a bake.

The bundle's folder may be gone by then: what the builder asks of a bundle is answered by the material itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import bpy
import numpy as np

from ..bake.bundle import MATERIAL, Bundle, require
from ..bake.errors import BakeError
from ..bake.shading.map_albedo import map_albedo_facts
from ..bake.shading.map_facts import map_facts_of
from ..bake.shading.render_settings import RenderSettings
from ..bake.shading.render_settings import render_settings_of as settings_from_facts
from ..bake.shading.shading_map import ShadingMap
from ..bake.table_facts import table_of
from ..bake.tables.table import FILTERS
from .arc_build import build_map
from .cli_bake_arc import is_bundle
from .cli_result import one_line
from .kept_textures import bundle_path, missing_texture, rebuild
from .lighting_properties import lighting_of, show_lighting
from .measured_material import facts_of, is_shading_map, keep_facts


def relight_or_say(material: bpy.types.Material) -> None:
    """Rebuild the material as its lighting properties say; where that fails, say so there and set them back."""
    properties = material.measured_lighting
    properties.problem = ""
    if not is_shading_map(material):
        return
    try:
        relight(material, lighting_of(properties))
    except BakeError as error:
        properties.problem = one_line(f"{error.cause}; {error.remedy}")
        # Foreign facts cannot be shown; the panel tells of them.
        with contextlib.suppress(BakeError):
            show_lighting(properties, current_lighting(material))


def current_lighting(material: bpy.types.Material) -> RenderSettings:
    """How the material is lit. Raises BakeError."""
    return settings_from_facts(require(facts_of(material), "render", dict, material.name), material.name)


def relight(material: bpy.types.Material, settings: RenderSettings, scene: bpy.types.Scene | None = None) -> None:
    """Rebuild the material under another light, of the textures it has, else of its bundle's. Raises BakeError.

    What the scene, by default the current one, does not call for is left out, as far as the quality properties allow.
    """
    facts = {**facts_of(material), "render": settings.facts()}
    images = require(facts, "images", dict, material.name)
    if settings.lobe is None and "table" not in images:
        raise BakeError(material.name, "holds no measured BRDF to use as f_r", "choose a bundle below and bake again")
    needed = _needed(facts, settings)

    def build(bundle: Bundle) -> None:
        facts["albedo"] = _albedo(bundle, settings)
        facts["rendering"] = build_map(bundle, material, settings, pack=facts.get("packed") is True, scene=scene)

    rebuild(material, facts, needed, build)
    keep_facts(material, facts)


def why_not_relightable(material: bpy.types.Material) -> str:
    """Why nothing can be rebuilt; empty if it can."""
    path = bundle_path(material)
    try:
        facts = facts_of(material)
        missing = missing_texture(material, facts, _needed(facts, current_lighting(material)))
    except BakeError as error:
        return one_line(str(error))
    return f"{missing}, and {path} is gone" if missing and not is_bundle(path) else ""


def _needed(facts: Mapping[str, Any], settings: RenderSettings) -> list[str]:
    """Names of the images that a map so lit is built of."""
    unused = ("table", "sampler") if settings.lobe is not None else ()
    return [name for name in require(facts, "images", dict, "material") if name not in unused]


def _albedo(bundle: Bundle, settings: RenderSettings) -> dict[str, Any]:
    """Of the new light, by the slices' mean colours."""
    where, found = bundle.path / MATERIAL, map_facts_of(bundle)
    rows = require(require(bundle.material, "map", dict, where), "means", list, where)
    try:
        means = np.array(rows, np.float32).reshape(found.slices, 1, 1, 3)
    except (ValueError, TypeError) as error:
        raise BakeError(where, "does not say the slices' mean colours", "bake it again") from error
    f_r = None
    if settings.lobe is None:
        table = require(bundle.material, "table", dict, where)
        filter: Any = require(table, "filter", str, where, choices=FILTERS)
        f_r = replace(table_of(bundle), filter=filter)
    return map_albedo_facts(ShadingMap(means), settings, found.a_max, f_r)
