"""What is told of a swatch photographed against the light as well, on the command line and in the panel."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from measured_materials.addon.summary.shading_map_rows import (
    albedo_warning,
    all_warnings,
    lighting_rows,
    through_rows,
)
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.photographs.settings import StackSettings
from measured_materials.bake.shading_maps.against_light import ThroughSettings
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from support.stacks import write_stack


@pytest.fixture(scope="module")
def felt(tmp_path_factory: pytest.TempPathFactory) -> ShadingMapRecord:
    folder = tmp_path_factory.mktemp("felt")
    through = ThroughSettings(write_stack(folder / "behind"), transmittance=0.2)
    settings = ArcSettings(stack=StackSettings(albedo=0.4), through=through)
    return ShadingMapRecord.read(read_bundle(bake_arc(write_stack(folder / "front"), folder / "x", settings).path))


def test_warnings_of_both_folders_are_told(felt: ShadingMapRecord) -> None:
    assert felt.through is not None
    doubtful = replace(felt.through.photographs, warnings=("dark",))
    both = replace(felt, through=replace(felt.through, photographs=doubtful))
    assert all_warnings(both) == (*felt.photographs.warnings, "against the light: dark")


@pytest.mark.parametrize(
    ("by", "says"),
    [
        (("albedo", "transmittance"), "state a lower --albedo, or state a lower --transmittance"),
        (("white card", "diffuser"), "check the white card, or check the diffuser"),
        ((None, None), "choose a lower --sigma, or choose a lower --transmission-sigma"),
    ],
)
def test_the_remedy_is_of_what_calibrated(felt: ShadingMapRecord, by: tuple[str | None, str | None], says: str) -> None:
    assert felt.through is not None
    much = replace(felt.through.albedo, directional=((0.9, 0.9, 0.9),) * len(felt.albedo.theta_o_deg))
    seen = [replace(part.photographs, calibrated_by=one) for part, one in zip((felt, felt.through), by, strict=True)]
    through = replace(felt.through, albedo=much, photographs=seen[1])
    assert albedo_warning(replace(felt, photographs=seen[0], through=through)).endswith(f"; {says}")


def test_rows_name_the_control_that_scales(felt: ShadingMapRecord) -> None:
    assert felt.through is not None
    rows = dict(through_rows(felt))
    assert rows["Through: transmitted"].endswith(", as calibrated") and "Through: strength" not in rows
    assert dict(lighting_rows(felt))["Strength"].endswith(", as calibrated")
    relative = replace(felt.through.photographs, calibrated_by=None)
    stored = replace(felt.through.map, a_max=None)
    rows = dict(through_rows(replace(felt, through=replace(felt.through, photographs=relative, map=stored))))
    assert rows["Through: calibration"] == "none, Transmitted sets the scale"
    assert rows["Through: transmitted"].endswith(", by default")


@pytest.mark.parametrize(
    "change", [{}, {"transmittance": None, "diffuser": [1, 2, 3, 4], "diffuser_transmittance": 0.4}]
)
def test_a_record_gives_the_second_folder_back(felt: ShadingMapRecord, change: dict[str, Any]) -> None:
    document = json.loads(json.dumps(felt.document))
    document["settings"]["through"].update(change)
    settings = ShadingMapRecord.parse(document, "felt").settings
    assert settings is not None and settings.through is not None
    assert settings.through.source == Path("behind")
    assert settings.through.facts() == document["settings"]["through"]


@pytest.mark.parametrize("name", ["", "..", 3])
def test_a_second_folder_without_a_name_is_not_believed(felt: ShadingMapRecord, name: object) -> None:
    document = json.loads(json.dumps(felt.document))
    document["settings"]["through"]["source"] = name
    assert ShadingMapRecord.parse(document, "felt").settings is None
