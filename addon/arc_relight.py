"""A shading-map material under another light: rebuilt at once of the textures it has, without a bake.

The bundle's folder may be gone by then: what the builder asks of a bundle is answered by the material itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np

from ..bake.bake_brdf import TableSource
from ..bake.bundle import MATERIAL, Bundle, require
from ..bake.errors import BakeError
from ..bake.material_json import Fields
from ..bake.shading.map_albedo import map_albedo_facts
from ..bake.shading.map_facts import map_facts_of
from ..bake.shading.record_parts import render_settings_of
from ..bake.shading.render_settings import RenderSettings
from ..bake.shading.shading_map import ShadingMap
from ..bake.table import FILTERS
from ..bake.table_facts import table_of
from .arc_build import build_map
from .facts import facts_of, keep_facts
from .kept_textures import rebuild


def current_lighting(material: bpy.types.Material) -> RenderSettings:
    """How the material is lit. Raises BakeError."""
    return render_settings_of(Fields(facts_of(material), material.name).part("render"))


def relight(material: bpy.types.Material, settings: RenderSettings, scene: bpy.types.Scene | None = None) -> None:
    """Rebuild the material under another light, of the textures it has, else of its bundle's. Raises BakeError.

    What the scene, by default the current one, does not call for is left out, as far as the quality properties allow.
    """
    facts = {**facts_of(material), "render": settings.facts()}
    images = require(facts, "images", dict, material.name)
    if settings.lobe is None and "table" not in images:
        raise BakeError(material.name, "holds no measured BRDF to use as f_r", "choose a bundle below and bake again")

    def build(bundle: Bundle) -> None:
        facts["albedo"] = _albedo(bundle, settings)
        facts["rendering"] = build_map(bundle, material, settings, pack=facts.get("packed") is True, scene=scene)

    rebuild(material, facts, images_of_map(facts, settings), build)
    keep_facts(material, facts)


def images_of_map(facts: Mapping[str, Any], settings: RenderSettings) -> list[str]:
    """Names of the bundle's images that a map so lit is built of. Raises BakeError."""
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
        f_r = TableSource(table_of(bundle), filter)
    return map_albedo_facts(ShadingMap(means), settings, found.a_max, f_r)
