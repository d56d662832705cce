"""Exact mode in Cycles: native closures under a BRDF and a mirror for the rest, against the mirror alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_same
from support.scenes import lit_sphere

SAMPLER = SamplerLayout(n_o=32, n_h=32, n_phi=16)
SOURCES = {
    "paint": analytic.MetallicPaint(diffuse=(0.05, 0.1, 0.3), flake=(0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2),
    "oren_nayar": analytic.OrenNayar(),
    "phong": analytic.by_name("phong"),
}


@pytest.mark.parametrize(
    "name", ["paint", *(pytest.param(name, marks=pytest.mark.slow) for name in SOURCES if name != "paint")]
)
def test_exact_is_reference(tmp_path: Path, name: str) -> None:
    """Sky, small lamp and bounce light, both modes aiming; with a planted 2 % that fails."""
    settings = BakeSettings(resolution=40, alpha=(0.5, 0.4), sampler=SAMPLER)
    result = bake_source(SOURCES[name], tmp_path / name, settings)
    assert result.facts["envelope"]["share"] > 0.5
    bundle = read_bundle(result.path)
    reference = build_material(bundle, mode="reference", lamps=lamp_image())
    with lit_sphere(reference, 64, lamp_size=0.6) as scene:
        scene.leave_terminator()
        pictures = scene.render(32, 8)
        scene.show(build_material(bundle, lamps=lamp_image()))
        # The envelope is not interpolated from a table, the reference is; and its own stated bias is 0.1 %.
        assert_same(pictures, scene.render(32, range(100, 108)), scene.mask(), 0.004, 0.015)
