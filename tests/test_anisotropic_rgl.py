"""RGL's anisotropic files: written from a known BRDF, read back, against Mitsuba, and baked from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.sources import analytic, read_source
from measured_materials.bake.tables.accuracy import direction_pairs
from support.mitsuba_values import mitsuba_values, random_pairs
from support.rgl_writer import write_anisotropic_rgl

SATIN = analytic.Ggx(alpha=0.15, alpha_y=0.4, f0=(0.9, 0.6, 0.3), diffuse=(0.1, 0.2, 0.3))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rgl") / "satin_rgb.bsdf"
    write_anisotropic_rgl(path, SATIN, (0.2, 0.5))
    return path


@pytest.mark.parametrize("half_circle", [True, False])
def test_what_was_written_is_read(file: Path, tmp_path: Path, half_circle: bool) -> None:
    if not half_circle:
        file = tmp_path / "whole.bsdf"
        write_anisotropic_rgl(file, SATIN, (0.2, 0.5), azimuths=17, half_circle=False)
    source = read_source(file)
    assert not source.isotropic and not source.bilateral
    pairs = direction_pairs(4000, turned=True)
    keep = (pairs.wi[:, 2] > np.cos(np.radians(80))) & (pairs.wo[:, 2] > 0.1)
    wi, wo = pairs.wi[keep], pairs.wo[keep]
    found, truth = source.evaluate(wi, wo), SATIN.evaluate(wi, wo)
    weight = pairs.weight[keep, None] * wi[:, 2:] * wo[:, 2:]
    # Linear between incident directions 12 and 22 degrees apart. A frame turned, mirrored or with its axes exchanged
    # would be off by more than the whole.
    assert (weight * np.abs(found - truth)).sum() / (weight * truth).sum() < 0.06
    turned = wi[:, [1, 0, 2]], wo[:, [1, 0, 2]]
    assert (weight * np.abs(source.evaluate(*turned) - truth)).sum() / (weight * truth).sum() > 0.3


def test_finer_files_are_closer(file: Path, tmp_path: Path) -> None:
    fine = tmp_path / "fine.bsdf"
    write_anisotropic_rgl(fine, SATIN, (0.2, 0.5), azimuths=17, elevations=14)
    pairs = direction_pairs(3000, turned=True)
    keep = (pairs.wi[:, 2] > 0.2) & (pairs.wo[:, 2] > 0.2)
    truth = SATIN.evaluate(pairs.wi[keep], pairs.wo[keep])
    errors = [np.abs(read_source(f).evaluate(pairs.wi[keep], pairs.wo[keep]) - truth).mean() for f in (file, fine)]
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.slow
def test_mitsuba_reads_the_same(file: Path) -> None:
    """Mitsuba's `measured` on the very file, at 300 pairs."""
    wi, wo = random_pairs(0.1)
    truth = mitsuba_values(file, wi, wo)
    np.testing.assert_allclose(read_source(file).evaluate(wi, wo), truth, rtol=2e-3, atol=1e-4)


def test_command_line_bakes_and_inspects_it(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "satin.mmat"
    arguments = [
        "bake",
        "brdf",
        str(file),
        "--out",
        str(out),
        "--resolution",
        "24",
        "--sampler",
        "16",
        "--no-envelope",
        "--json",
    ]
    assert main(arguments) == 0
    facts = json.loads(capsys.readouterr().out)["bundles"][0]
    # The file's interpolation is not exactly reciprocal, and repeats after half a turn.
    assert facts["choice"]["half_turn_error"] < 1e-3
    bundle = read_bundle(out)
    assert BrdfRecord.read(bundle).anisotropic
    source, table = read_source(file), BrdfRecord.read(bundle).load_table()
    assert table.grid == BrdfRecord.read(bundle).table.grid
    pairs = direction_pairs(4000, offset=0.1, turned=True)
    truth = source.evaluate(pairs.wi, pairs.wo)
    error = pairs.relative_error(table.evaluate(pairs.wi, pairs.wo) - truth, truth)
    assert error < 1.3 * facts["errors"]["relative"] < 0.2
    assert main(["inspect", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "anisotropic" in shown and "half" in shown
