"""What the panel says a mode and a filter cost and miss, before anything is rendered."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from measured_materials.addon.material.bake_material import material_from
from measured_materials.addon.material.kinds import BRDF
from measured_materials.addon.summary.cost_estimate import (
    MODE_TIME,
    NODES,
    RAY_SCRIPT,
    SAMPLED_TIME,
    SCRIPT,
    expectation,
)
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import MODES
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from support.coarse_bakes import coarse  # noqa: F401
from support.records import brdf_record, sheet_parts
from test_addon import registered  # noqa: F401


def test_words_of_every_mode() -> None:
    known = brdf_record()
    assert expectation(known, "exact", "trilinear").endswith("Principled BSDF; error 0.4 % of the reflected light")
    assert expectation(known, "reference", "trilinear").startswith("About 2.3 times")
    assert "; error 4 % of" in expectation(known, "reference", "nearest")
    assert (
        expectation(known, "preview", "trilinear")
        == "About 1.1 times the render time of a Principled BSDF; error 20 % of the reflected light"
    )


def test_a_filter_that_was_not_measured_gives_the_time_alone() -> None:
    assert "%" not in expectation(brdf_record(rms_by_filter={"trilinear": 0.1}), "reference", "nearest")


def test_times_are_those_of_the_bench() -> None:
    file = Path(__file__).parent / "bench" / "recorded" / "engine.json"
    figures = json.loads(file.read_text(encoding="utf-8"))["values"]
    assert {mode: round(figures[f"time, {mode}"], 1) for mode in MODE_TIME} == MODE_TIME
    assert round(figures["time, exact, lamps sampled"], 1) == SAMPLED_TIME[SCRIPT]


def test_a_time_is_told_of_what_it_was_measured_of() -> None:
    """Of nodes that ask a script what is seen, and of sheets, the error alone."""
    known, error = brdf_record(), "rror 0.4 % of the reflected light"
    times = {sampler: expectation(known, "exact", "trilinear", sampler=sampler) for sampler in (SCRIPT, NODES)}
    assert times == {
        SCRIPT: f"About 3.6 times the render time of a Principled BSDF; e{error}",
        NODES: f"About 3.0 times the render time of a Principled BSDF; e{error}",
    }
    assert expectation(known, "exact", "trilinear", sampler=RAY_SCRIPT) == f"E{error}"
    sheet = brdf_record(**sheet_parts(through={}))
    assert {expectation(sheet, "exact", "trilinear", sampler=by) for by in ("", NODES, RAY_SCRIPT)} == {f"E{error}"}
    assert not expectation(brdf_record(residual=None), "exact", "trilinear", sampler=RAY_SCRIPT)


@pytest.mark.parametrize("mode", ("preview", "balanced", "exact"))
def test_what_a_bundle_does_not_tell_gives_the_time_alone(mode: str) -> None:
    assert "%" not in expectation(brdf_record(preview=None, residual=None), mode, "trilinear")


@pytest.mark.parametrize("kind", ["plastic", "brushed"])
def test_the_panel_speaks_of_what_is_set(registered: None, tmp_path: Path, kind: str) -> None:  # noqa: F811
    plastic, brushed = analytic.BlinnPhong((0.3, 0.2, 0.1), (0.1,) * 3, 20), analytic.Ggx(alpha=0.2, alpha_y=0.5)
    settings = BakeSettings(16, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8), viewers=(6, 4))
    result = bake_source(plastic if kind == "plastic" else brushed, tmp_path / kind, settings)
    material = material_from(result, pack=True)
    said = {}
    for mode in MODES:
        material.measured_quality.mode = mode
        said[mode] = BRDF.cost(material)
    assert len(set(said.values())) >= 3 and all("%" in words for words in said.values())
