"""The filter where it is left to the bake: error, bytes and time weighed, and told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from measured_materials.addon.cli.main import main
from measured_materials.addon.summary.bake_stages import bake_stages
from measured_materials.addon.ui.properties.bake import BakeProperties
from measured_materials.bake.brdf.part_bake import PartBake
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sources.analytic import Ggx
from measured_materials.bake.tables import code_fit
from measured_materials.bake.tables.filter_choice import LEAST_GAIN, LEAST_GAIN_OF_CODES, FilterChoice, weighed
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.parameterization import LogWarp

COARSE = ["--basis", "half", "--sampler", "16"]
SQUARED = ["--parameterization", "squared"]


@pytest.mark.parametrize(
    ("trilinear", "bspline", "relative", "taken"),
    [
        (1.0, 0.9 / LEAST_GAIN, 0.05, "bspline"),
        (1.0, 1.1 / LEAST_GAIN, 0.05, "trilinear"),
        (1.0, 0.01, 0.0009, "trilinear"),
        (1.0, 2.0, 0.05, "trilinear"),
        (0.0, 0.0, 0.0, "trilinear"),
    ],
)
def test_the_rule(trilinear: float, bspline: float, relative: float, taken: str) -> None:
    """Half of the bytes for a tenth of the time, where the error can be seen."""
    rms = {"trilinear": trilinear, "bspline": bspline}
    found = weighed(rms, relative)
    assert found.filter == taken and found.why.endswith({"bspline": "B-spline", "trilinear": "trilinear"}[taken])
    assert found.facts()["rms"] == rms


def test_help_and_tooltip_tell_where_the_choice_has_none(capsys: pytest.CaptureFixture[str]) -> None:
    """Over Cycles' own shaders, as usual, "auto" is straight lines."""
    assert main(["bake", "brdf", "--help"]) == 0
    assert "only without Cycles' own shaders" in " ".join(capsys.readouterr().out.split())
    words = BakeProperties.__annotations__["filter"].keywords["description"]
    assert "only without Cycles' own shaders" in words


def baked(folder: Path, *options: str) -> BrdfRecord:
    """Metallic paint, coarse."""
    settings = ["--analytic", "metallic-paint", *COARSE, "--out", str(folder), "--replace", *options]
    assert main(["bake", "brdf", *settings]) == 0
    (path,) = folder.glob("*.mmat")
    return BrdfRecord.read(read_bundle(path))


@pytest.mark.parametrize(
    ("options", "tried"),
    [
        ({"filter": "bspline"}, True),
        ({"filter": "trilinear", "envelope": False}, False),
        ({"filter": "auto", "envelope": False}, True),
        ({"filter": "auto"}, False),
        ({"filter": "auto", "envelope": False, "storage": Storage.LOG}, True),
    ],
)
def test_a_spline_is_told_of_where_it_is_tried(options: dict[str, Any], tried: bool) -> None:
    """Its time is expected, and the panel shows how it is fitted."""
    settings = BakeSettings(**options)
    assert settings.tries_spline == tried and (bake_stages(settings)["fitting spline"] > 0) == tried


def test_a_paint_alone_is_worth_a_spline(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As named; "auto" stays the setting, for the next bake."""
    fitted = ["--resolution", "24", "--parameterization", "fitted", "--no-envelope"]
    found = baked(tmp_path / "auto", "--filter", "auto", *fitted)
    named = baked(tmp_path / "named", "--filter", "bspline", *fitted)
    assert (found.settings.filter, found.table.filter, named.filter_why) == ("auto", "bspline", "")
    assert found.errors.rms == pytest.approx(named.errors.rms, rel=1e-3) and found.table.spline == named.table.spline
    rms = json.loads((found.files().path / "material.json").read_text())["filter_choice"]["rms"]
    assert rms["bspline"] == pytest.approx(found.errors.rms) and rms["bspline"] * LEAST_GAIN < rms["trilinear"]
    capsys.readouterr()
    assert main(["inspect", str(found.files().path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("Filter weighed") and line.endswith(found.filter_why) for line in lines)


@pytest.mark.slow
def test_the_rest_over_shaders_stays_linear(tmp_path: Path) -> None:
    """A B-spline through samples smooths the rest: nothing is measured that cannot change the filter."""
    over = baked(tmp_path / "over", "--resolution", "12", "--filter", "auto", *SQUARED)
    usual = baked(tmp_path / "usual", "--resolution", "12", *SQUARED)
    assert over.table.filter == "trilinear" and over.errors.rms == pytest.approx(usual.errors.rms, rel=1e-3)
    assert "Cycles' own shaders" in over.filter_why and usual.filter_why == ""
    found = json.loads((over.files().path / "material.json").read_text())
    assert found["filter_choice"]["rms"] == {}


def test_fitted_codes_are_weighed_by_a_rule_of_their_own() -> None:
    """Who stores logarithms asks for small files. Too many codes to be fitted stay linear, and nothing is measured."""
    settings = BakeSettings(storage=Storage.LOG, filter="auto", envelope=False)
    warps = LogWarp(), LogWarp(0.01), LogWarp()

    def chosen(sizes: tuple[int, int, int], alpha: float = 0.15, most: int = 1 << 16) -> FilterChoice:
        bake = PartBake(Ggx(alpha=alpha), settings, lambda stage, share: None, 4096)
        with mock.patch.object(code_fit, "MOST_TEXELS", most):
            made = bake.tabulate(HalfVectorGrid(sizes, "fitted", warps=warps, cosine_power=2))
        assert bake.weighed is not None and made.kept.table.filter == bake.weighed.filter
        return bake.weighed

    coarse, finer, large = chosen((9, 12, 4)), chosen((12, 16, 5), 0.3), chosen((9, 12, 4), most=400)
    assert (coarse.filter, finer.filter, large.filter) == ("bspline", "trilinear", "trilinear")
    # Between both rules, so that each tells.
    assert 1 / LEAST_GAIN < coarse.rms["bspline"] / coarse.rms["trilinear"] < 1 / LEAST_GAIN_OF_CODES
    assert finer.rms["bspline"] / finer.rms["trilinear"] > 1 / LEAST_GAIN_OF_CODES
    assert large.rms == {} and "so large a table" in large.why
