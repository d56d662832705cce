"""Sheets as OSL scripts whose shader samples several lights, adjusted as artists do: pictures against quadrature."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from measured_materials.addon.lights import light_tables
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.source import luminance
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.direct_light import environment
from support.osl import skip_without_osl
from support.scenes import add_lamp, diffuse_material
from support.sheet_scenes import (
    GLAZED,
    SETTINGS,
    adjust,
    assert_mean,
    lit_by,
    osl_that_samples,
    record_of,
    sheet_scene,
    under_sky,
    viewer,
)
from test_sampled_sheets import add_room


@pytest.fixture(scope="module")
def glazed(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    skip_without_osl()
    return record_of(bake_source(GLAZED, tmp_path_factory.mktemp("glazed") / "glazed", SETTINGS))


@pytest.mark.slow
def test_a_picture_is_sampled_also_where_the_world_is_not_to_be_aimed_at(
    glazed: BrdfRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the world's own tables, whatever that of lamps says: what a point and a mirror find is counted once."""
    known = light_tables.table_of

    def without_a_world(report: Any) -> Any:
        table = known(report)
        assert table[1, 4, 3] > 0
        table[1, 4, 3] = 0
        return table

    with sheet_scene(diffuse_material(), 70.0) as scene:
        pixels = add_room(scene)
        monkeypatch.setattr(light_tables, "table_of", without_a_world)
        osl_that_samples(scene, glazed)
        assert_mean(scene, under_sky(glazed, "exact", 70.0, environment(pixels)), samples=256, tolerance=5e-4)


ADJUSTED = {"Tint": (0.5, 1.0, 0.8, 1.0), "Brightness": 0.9, "Saturation": 0.2}
# Where the light straight through comes from, and that of the highlight: both parts' mirrors have much to show.
THROUGH, HIGHLIGHT = (tuple(3 * viewer(40.0) * turn) for turn in ((-1, -1, -1), (-1, -1, 1)))


def test_lamps_on_both_sides_by_two_points_each(glazed: BrdfRecord) -> None:
    """Of different light, each seen by the sheet's table of its own side, adjusted as an artist may."""
    truth = np.zeros(3)
    with sheet_scene(diffuse_material(), 40.0) as scene:
        for place, energy, size in ((THROUGH, 300.0, 2.0), (HIGHLIGHT, 120.0, 1.0)):
            truth += lit_by(glazed, "exact", 40.0, add_lamp(scene, "AREA", place, energy=energy, size=size))
        adjust(osl_that_samples(scene, glazed, points=2), **ADJUSTED)
        grey = luminance(truth)
        shown = np.array(ADJUSTED["Tint"][:3]) * ADJUSTED["Brightness"] * (grey + 0.2 * (truth - grey))
        assert_mean(scene, shown, samples=48)


@pytest.mark.slow
def test_gloss_is_that_of_the_nodes_under_two_lamps(glazed: BrdfRecord) -> None:
    with sheet_scene(diffuse_material(), 40.0) as scene:
        usual = np.zeros(3)
        for place, energy in ((THROUGH, 100.0), (HIGHLIGHT, 120.0)):
            usual += lit_by(glazed, "exact", 40.0, add_lamp(scene, "AREA", place, energy=energy, size=1.0))
        script = osl_that_samples(scene, glazed, points=2)
        tables = {"lamps": lamp_image(), "lights": lamp_light_image()}
        nodes = build_material(glazed, mode="exact", scripted=True, pack=True, **tables)
        for material in (nodes, script):
            adjust(material, Gloss=2.0)
        scene.show(nodes)
        update_scene(scene.scene)
        sharp = scene.render(256, 2).astype(float).mean((0, 1, 2))
        assert (np.abs(sharp / usual - 1) > 0.1).all()
        scene.show(script)
        assert_mean(scene, sharp, samples=64)
