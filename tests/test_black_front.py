"""Sheets that reflect nothing in front: as a bundle and as a material; and what of bundles older versions refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import write_bundle
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import ThinCloth
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401
from test_sheet_material import (
    SETTINGS,
    Woven,
    assert_shows,
    record_of,
    set_sky,
    sheet_scene,
    under_sky,
    upper_hemisphere,
    viewer,
)


@pytest.mark.parametrize("mode", ["preview", "exact", pytest.param("reference", marks=pytest.mark.slow)])
def test_a_black_front_lets_light_through(black_front: BrdfRecord, mode: str) -> None:
    """In every mode what the parts say, seen from the black side and from the other one; no mirror is drawn for it."""
    assert black_front.sheet is not None and not any(black_front.albedo.white_sky)
    material = build_material(black_front, mode=mode)
    for theta in (30.0, 140.0):
        with sheet_scene(material, theta) as scene:
            set_sky(scene.scene)
            truth = under_sky(black_front, mode, theta)
            assert truth.max() > 0.05
            # Closures have so little noise here that the 0.08 % of weights linear between viewers are seen.
            assert_shows(scene, truth, tolerance=2e-3)


@pytest.fixture(scope="module")
def black_front(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    """Black in front, which lets light through both ways and reflects at its back."""
    cloth = ThinCloth((0.0, 0.0, 0.0), (0.3, 0.2, 0.1), (0.2, 0.3, 0.1), (0.1, 0.1, 0.3), 6.0)
    return record_of(bake_source(cloth, tmp_path_factory.mktemp("black") / "front", SETTINGS))


def test_a_black_front_is_kept_in_the_smallest_table(black_front: BrdfRecord) -> None:
    wi = upper_hemisphere()[::97]
    wo = np.broadcast_to(viewer(30.0), wi.shape)
    for table in (black_front.load_table(), black_front.load_table("residual"), black_front.load_preview()):
        assert not table.evaluate(wi, wo).any()
    assert black_front.load_table().values.size == 4 * 4 * 8 * 3
    assert black_front.envelope is not None and black_front.envelope.suffices


@pytest.mark.slow
def test_an_anisotropic_black_front_is_baked(tmp_path: Path) -> None:
    class Dark(Woven):
        def evaluate(self, wi: Array, wo: Array) -> Array:
            return np.zeros((*np.broadcast_shapes(wi.shape[:-1], wo.shape[:-1]), 3))

    settings = BakeSettings(8, basis="normal", parameterization="uniform", sampler=SETTINGS.sampler, viewers=(6, 3))
    record = record_of(bake_source(Dark(), tmp_path / "dark", settings))
    assert record.anisotropic and record.sheet is not None and "through" in record.sheet.parts
    assert build_material(record, mode="exact", lamps=lamp_image()) is not None


@pytest.mark.parametrize("place", ["table", "residual"])
def test_tables_stored_times_cosines_are_of_the_newest_schema(place: str, tmp_path: Path) -> None:
    """Older versions would show them for the BRDF itself; anisotropic ones they know."""
    stored: dict[str, Any] = {"cosine_power": 2}
    document = {"table": stored} if place == "table" else {"table": {}, "residual": {"grid": stored}}
    for name, anisotropic, schema in (("a", False, 5), ("b", True, 4)):
        document["table"]["anisotropic"] = anisotropic
        written = write_bundle(tmp_path / name, {**document, "source": {"name": "x"}}, {})
        assert json.loads((written / "material.json").read_text())["schema"] == schema
