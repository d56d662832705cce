"""Author, licence and source as stated at a bake: kept in the bundle, printed, baked again, told by an asset."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import bpy
import measured_materials
import pytest
from measured_materials.addon.assets.words import rights_of, words_of
from measured_materials.addon.cli.main import main
from measured_materials.addon.material.facts import record_of
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.rights import RIGHTS, Rights
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.merl import write_merl
from support.coarse_bakes import coarse  # noqa: F401
from support.records import BRDF, SHADING_MAP, brdf_record
from support.stacks import write_stack

STATED = Rights("Ada", "CC0", "https://example.org/felt")
SETTINGS = BakeSettings(8, "squared", basis="half", envelope=False, sampler=SamplerLayout(16, 8, 8), rights=STATED)


@pytest.fixture
def registered() -> Iterator[None]:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    measured_materials.register()
    yield
    measured_materials.unregister()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def test_both_kinds_of_bundle_keep_what_was_stated(tmp_path: Path) -> None:
    bundle = read_bundle(bake_source(by_name("lambert"), tmp_path / "a", SETTINGS).path)
    assert bundle.material["rights"] == STATED.facts() and "rights" not in bundle.material["settings"]
    record = BrdfRecord.read(bundle)
    assert record.rights == STATED and record.settings == SETTINGS  # so that a bake again states it again
    write_stack(tmp_path / "swatch")
    photographed = read_bundle(bake_arc(tmp_path / "swatch", tmp_path / "b", ArcSettings(rights=STATED)).path)
    found = ShadingMapRecord.read(photographed)
    assert found.rights == STATED and found.settings is not None and found.settings.rights == STATED
    assert rights_of(found).author == "Ada"


@pytest.mark.usefixtures("registered")
def test_what_is_said_of_one_file_is_not_kept_for_the_next() -> None:
    """Nor the material that was chosen in it: the next file has others, or one."""
    offered = bpy.ops.measured_materials.import_brdf.get_rna_type().properties
    kept = {name for name in (*RIGHTS, "read_material", "read_merl") if not offered[name].is_skip_save}
    assert kept == {"read_merl"}


def test_what_nobody_stated_is_no_entry(tmp_path: Path) -> None:
    bundle = read_bundle(bake_source(by_name("lambert"), tmp_path / "a", BakeSettings(8)).path)
    assert "rights" not in bundle.material and BrdfRecord.read(bundle).rights == Rights()


def test_an_asset_states_it_before_the_file() -> None:
    source = {**BRDF["source"], "facts": {"author": "Bob", "license": "CC-BY 4.0", "copyright": "2020 Bob"}}
    words = words_of(brdf_record(source=source, rights={"author": "Ada", "source_url": "https://example.org"}))
    assert (words.rights.author, words.rights.license, words.rights.copyright) == ("Ada", "CC-BY 4.0", "2020 Bob")
    assert "Found at https://example.org." in words.description


def test_blanks_of_pages_are_blanks_and_control_characters_are_named() -> None:
    assert Rights(author="Ada\u00a0Lovelace\u202f", license="CC\u2009BY\u30004.0") == Rights(
        "Ada Lovelace", "CC BY 4.0"
    )
    for words in ("CC0\tor so", "two\u2028lines", "half \ud800"):
        with pytest.raises(BakeError, match="letters without control characters"):
            Rights(license=words)
    with pytest.raises(BakeError, match="author: cannot be 1001 letters"):
        Rights(author="x" * 1001)


@pytest.mark.parametrize("told", ["Ada", {"author": 1}, {"license": "two\nlines"}, {"source_url": "x" * 1001}])
def test_damaged_entries_are_one_clear_error(told: object) -> None:
    for kind, document in ((BrdfRecord, BRDF), (ShadingMapRecord, SHADING_MAP)):
        with pytest.raises(BakeError) as caught:
            kind.parse({**document, "rights": told}, "felt")
        assert caught.value.file == "felt" and "\n" not in str(caught.value)


def test_the_command_line_takes_and_prints_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.mmat"
    stated = ["--author", "Ada", "--license", "CC0", "--source-url", "https://example.org/felt"]
    model = ["--analytic", "lambert", "--resolution", "8", "--no-envelope"]
    assert main(["bake", "brdf", *model, "--out", str(out), *stated]) == 0
    capsys.readouterr()
    assert main(["inspect", str(out)]) == 0
    printed = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert ["Author", "Ada"] in printed and ["License", "CC0"] in printed
    assert any(line[0] == "Found" and line[1].endswith("https://example.org/felt") for line in printed)
    assert main(["inspect", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rights"] == STATED.facts()
    assert main(["bake", "brdf", "--analytic", "lambert", "--out", str(tmp_path), "--author", "a\nb"]) == 2
    assert "--author" in capsys.readouterr().err


def test_the_window_states_it_for_this_bake_alone(registered: None, coarse: None, tmp_path: Path) -> None:  # noqa: F811
    measurement = tmp_path / "felt.binary"
    write_merl(measurement, by_name("lambert"))
    bpy.ops.measured_materials.import_brdf(
        filepath=str(measurement), resolution=8, envelope=False, author="Ada", license="CC0", as_asset=True
    )
    material = next(one for one in bpy.data.materials if one.get("measured_materials_facts"))
    assert record_of(material).rights == Rights("Ada", "CC0")
    assert (material.asset_data.author, material.asset_data.license) == ("Ada", "CC0")
    properties = material.measured_materials
    assert (properties.author, properties.license) == ("Ada", "CC0")
    operator = bpy.ops.measured_materials.import_brdf.get_rna_type().properties["author"]
    assert operator.is_skip_save  # it is no default of the next measurement, which somebody else has made


def test_another_measurement_takes_no_rights_over(registered: None, coarse: None, tmp_path: Path) -> None:  # noqa: F811
    """Its own, also where it has been moved, keeps them; and what was stated since the bake is of the next one."""
    for name, model in (("felt", by_name("lambert")), ("paint", by_name("ggx", alpha=0.4))):
        write_merl(tmp_path / f"{name}.binary", model)
    stated = {"author": "Ada", "license": "CC0", "source_url": "https://example.org/felt"}
    bpy.ops.measured_materials.import_brdf(
        filepath=str(tmp_path / "felt.binary"), resolution=8, envelope=False, as_asset=True, **stated
    )
    material = next(one for one in bpy.data.materials if one.get("measured_materials_facts"))
    (tmp_path / "felt.binary").rename(tmp_path / "moved.binary")

    def again(name: str) -> tuple[Rights, str, str]:
        with bpy.context.temp_override(material=material):
            assert bpy.ops.measured_materials.bake_again(filepath=str(tmp_path / f"{name}.binary")) == {"FINISHED"}
        data = material.asset_data
        return record_of(material).rights, data.author, data.license

    assert again("moved") == (Rights(**stated), "Ada", "CC0") == again("moved")
    material.measured_materials.license = "CC-BY 4.0"
    assert again("paint") == (Rights(license="CC-BY 4.0"), "", "CC-BY 4.0")
    assert material.measured_materials.author == material.measured_materials.source_url == ""
