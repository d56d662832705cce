"""Sheets that reflect and let through more light than arrives: a bake warns."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli import bake_brdf
from measured_materials.addon.cli.main import main
from measured_materials.addon.summary.sheet_rows import sheet_warning
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import Lambert
from support.coarse_bakes import coarse  # noqa: F401
from support.sheet_scenes import SETTINGS, TURNED, record_of
from test_sheet_material import baked  # noqa: F401


class Lamp:
    """More than arrives: half of it reflected in front, and three quarters let through."""

    name, isotropic, bilateral, alike = "lamp", True, True, True
    facts: dict[str, Any] = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return Lambert((0.5,) * 3).evaluate(wi, wo)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return self.evaluate(wi * TURNED, wo * TURNED)

    def transmitted(self, wi: Array, wo: Array) -> Array:
        across = (wi[..., 2:] > 0) != (wo[..., 2:] > 0)
        return np.where(across, np.full(3, 0.75 / math.pi), 0)


def test_more_light_than_arrives_is_told(baked: dict[str, BakeResult], tmp_path: Path) -> None:
    """Of each side, though neither reflection nor transmission alone is above one."""
    told = sheet_warning(record_of(bake_source(Lamp(), tmp_path / "lamp", SETTINGS)))
    assert "R + T above one: up to 1.25 reflected and let through" in told
    assert not sheet_warning(record_of(baked["white"])) and not sheet_warning(record_of(baked["lined"]))


def test_a_bake_of_a_sheet_warns(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bake_brdf, "sheet_warning", lambda record: f"{record.name} is too bright")
    options = ["--resolution", "8", "--out", str(tmp_path)]
    assert main(["bake", "brdf", "--analytic", "thin-cloth", *options]) == 0
    assert "warning: thin-cloth: thin-cloth is too bright" in capsys.readouterr().err
