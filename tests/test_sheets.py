"""Sheets that let light through: readers, the analytic thin cloth, and what `inspect` tells; nothing is rendered."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.directions import spherical
from measured_materials.bake.envelope import Elevations, EnvelopeSettings, fit_envelope
from measured_materials.bake.errors import BakeError
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import Array, SheetSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.analytic import ThinCloth
from measured_materials.bake.tables.albedo import albedo_facts, directional_albedo
from measured_materials.bake.tables.sheet import SheetView, sheet_facts, sheet_views
from support.format_files import klems_centres
from support.sheet_files import write_klems_sheet, write_mbsdf_sheet

BELOW = np.array([1.0, 1.0, -1.0])
KLEMS = ("Reflection Back", "Reflection Front", "Transmission Front", "Transmission Back")


class OneWay:
    """A sheet whose four parts differ, none of them reciprocal or symmetric."""

    name, isotropic, bilateral, alike = "one way", False, False, False
    facts: dict[str, Any] = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return self._part(wi, wo, 1, 1, 0.3)

    def transmitted(self, wi: Array, wo: Array) -> Array:
        return self._part(wi, wo, -1, 1, 0.2) + self._part(wi, wo, 1, -1, 0.1)

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return self._part(wi, wo, -1, -1, 0.05)

    def _part(self, wi: Array, wo: Array, lit: int, seen: int, size: float) -> Array:
        value = size * (1 + 0.5 * wi[..., :1] + 0.3 * wo[..., 1:2] + 0.1 * wi[..., 1:2] * wo[..., :1])
        there = (wi[..., 2:] * lit > 0) & (wo[..., 2:] * seen > 0)
        return np.repeat(np.where(there, value, 0), 3, -1)


def centres(count: int = 200) -> tuple[Array, Array]:
    """Pairs of middles of Klems' bins, above the horizon."""
    bins, rng = klems_centres(), np.random.default_rng(5)
    # A middle may lie on either side of an edge by rounding: azimuths of the first ring and of the pole are left out.
    wi, wo = bins[rng.integers(9, 145, count)], bins[rng.integers(9, 145, count)]
    return wi * [-1.0, -1.0, 1.0], wo


@pytest.mark.parametrize("structure", ["Columns", "Rows"])
def test_a_klems_file_keeps_all_four_parts(structure: str, tmp_path: Path) -> None:
    source = read_source(write_klems_sheet(tmp_path / "a.xml", OneWay(), KLEMS, structure))
    assert isinstance(source, SheetSource) and source.facts["transmission"] == "both ways"
    wi, wo = centres()
    for lit, seen in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        pair = wi * [1.0, 1.0, lit], wo * [1.0, 1.0, seen]
        for ours, truth in (
            (source.evaluate, OneWay().evaluate),
            (source.transmitted, OneWay().transmitted),
            (source.reflected_behind, OneWay().reflected_behind),
        ):
            np.testing.assert_allclose(ours(*pair), truth(*pair), rtol=1e-6)


def test_a_klems_file_read_from_its_back_is_turned_about_y(tmp_path: Path) -> None:
    path = write_klems_sheet(tmp_path / "a.xml", OneWay(), KLEMS)
    front, back = read_source(path), read_source(path, Reading(side="back"))
    assert isinstance(front, SheetSource) and isinstance(back, SheetSource)
    (wi, wo), turned = centres(), np.array([-1.0, 1.0, -1.0])
    np.testing.assert_array_equal(back.evaluate(wi, wo), front.reflected_behind(wi * turned, wo * turned))
    for lit in (-1.0, 1.0):
        pair = wi * [1.0, 1.0, lit], wo * [1.0, 1.0, -lit]
        np.testing.assert_array_equal(back.transmitted(*pair), front.transmitted(*(w * turned for w in pair)))


@pytest.mark.parametrize("given", ["Transmission Front", "Transmission Back"])
def test_what_one_way_lets_through_the_other_does_by_reciprocity(given: str, tmp_path: Path) -> None:
    path = write_klems_sheet(tmp_path / "a.xml", OneWay(), (KLEMS[0], given))
    source = read_source(path)
    assert isinstance(source, SheetSource) and "reciprocity" in str(source.facts["transmission"])
    wi, wo = centres()
    there = (wi * BELOW, wo) if given == "Transmission Front" else (wi, wo * BELOW)
    np.testing.assert_allclose(source.transmitted(*there), OneWay().transmitted(*there), rtol=1e-6)
    np.testing.assert_array_equal(source.transmitted(*there[::-1]), source.transmitted(*there))
    assert "black" in str(source.facts["behind"]) and not source.reflected_behind(-wi, -wo).any()


@pytest.mark.parametrize(
    ("find", "replace", "cause"),
    [
        ("<RowAngleBasis>LBNL/Klems Full", "<RowAngleBasis>LBNL/Klems Fuller", "uses the directions"),
        ('unit="Integral">Visible<', 'unit="Integral">CIE-X<', "no block Visible"),
        ("<ScatteringData>", "<ScatteringData>1 2 ", "numbers instead of"),
    ],
)
def test_a_part_that_cannot_be_read_is_left_out_and_told(tmp_path: Path, find: str, replace: str, cause: str) -> None:
    """The file's reflection is what was always read: what lets light through beside it must not take it away."""
    path = write_klems_sheet(tmp_path / "a.xml", OneWay(), (KLEMS[0], *KLEMS[2:]))
    whole, text = read_source(path), path.read_text()
    reflection, *others = text.split("<WavelengthData>")[1:]
    assert find in others[0] and find in reflection
    damaged = [other.replace(find, replace) for other in others]
    path.write_text(text.split("<WavelengthData>")[0] + "<WavelengthData>".join(["", reflection, *damaged]))
    source = read_source(path)
    assert not isinstance(source, SheetSource) and "through: " in str(source.facts["left_out"])
    assert cause in str(source.facts["left_out"]) and "through behind: " in str(source.facts["left_out"])
    wi, wo = centres()
    np.testing.assert_array_equal(source.evaluate(wi, wo), whole.evaluate(wi, wo))
    one_way = "<WavelengthData>".join(["", reflection, damaged[0], others[1]])
    path.write_text(text.split("<WavelengthData>")[0] + one_way)
    assert "reciprocity" in str(read_source(path).facts["transmission"])
    broken = "<WavelengthData>".join(["", reflection.replace(find, replace), *others])
    path.write_text(text.split("<WavelengthData>")[0] + broken)
    with pytest.raises(BakeError, match=cause):
        read_source(path)


# What Radiance's rtrace 6.0 shows of 2011-SA1.XML between two directions, its viewing ray being what it calls incident:
# where the lamp is, where the viewer is, and the value.
RADIANCE = np.array(
    [
        (0.080501, 0.960382, -0.266806, -0.54115, -0.727561, 0.421677, 0.00545001),
        (-0.49201, -0.278049, -0.824994, -0.176887, 0.645438, 0.743048, 0.0115448),
        (-0.877684, 0.393588, -0.27342, 0.965461, -0.165584, 0.201162, 0.00204329),
        (0.440378, 0.690639, 0.57366, -0.351925, 0.829984, -0.432753, 0.0175099),
        (0.479537, 0.415405, 0.77297, -0.383213, -0.226197, -0.895535, 0.015363),
        (-0.858405, -0.0891945, 0.505158, 0.117974, -0.814793, -0.567622, 0.0175098),
    ]
)


def test_a_genuine_layer_lets_through_what_radiance_says(shared_data: Path) -> None:
    source = read_source(shared_data / "formats" / "klems" / "2011-SA1.XML")
    assert isinstance(source, SheetSource)
    found = source.transmitted(RADIANCE[:, 3:6], RADIANCE[:, :3])[:, 1]
    np.testing.assert_allclose(found, RADIANCE[:, 6], rtol=5e-4)  # it divides by the lamp's small solid angle


def test_an_mbsdf_file_keeps_its_transmission(tmp_path: Path) -> None:
    cloth = ThinCloth((0.3, 0.2, 0.1), None, (0.1, 0.2, 0.3), (0.4, 0.3, 0.2), 6.0)
    source = read_source(write_mbsdf_sheet(tmp_path / "a.mbsdf", cloth))
    assert isinstance(source, SheetSource) and source.alike
    wi, wo = spherical(np.radians(30.0), 0.4), spherical(np.radians(40.0), np.linspace(0, 6, 20))
    for pair in ((wi * BELOW, wo), (wi, wo * BELOW)):
        np.testing.assert_allclose(source.transmitted(*pair), cloth.transmitted(*pair), rtol=2e-3, atol=1e-4)
    np.testing.assert_allclose(source.reflected_behind(wi * BELOW, wo * BELOW), cloth.evaluate(wi, wo), rtol=1e-5)


def test_light_and_viewer_of_a_transmission_are_exchanged_by_choice(tmp_path: Path) -> None:
    path = write_klems_sheet(tmp_path / "a.xml", OneWay(), KLEMS)
    plain, turned, mean = (read_source(path, Reading(reciprocity=how)) for how in ("measured", "exchanged", "mean"))
    assert isinstance(plain, SheetSource) and isinstance(turned, SheetSource) and isinstance(mean, SheetSource)
    wi, wo = centres()
    np.testing.assert_array_equal(turned.transmitted(wi * BELOW, wo), plain.transmitted(wo, wi * BELOW))
    np.testing.assert_allclose(
        mean.transmitted(wi, wo * BELOW), (plain.transmitted(wi, wo * BELOW) + turned.transmitted(wi, wo * BELOW)) / 2
    )


def test_only_what_is_black_on_all_sides_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nothing = ["diffuse=0", "through=0", "forward=0"]
    assert main(["bake", "brdf", "--analytic", "thin-cloth", *nothing, "--out", str(tmp_path)]) == 1
    assert "thin-cloth: reflects nothing" in capsys.readouterr().err


@pytest.mark.parametrize("side", ["auto", "front", "back"])
def test_a_file_of_transmission_alone_is_a_sheet_of_black_sides(side: Any, tmp_path: Path) -> None:
    path = write_klems_sheet(tmp_path / "a.xml", OneWay(), KLEMS[2:])
    whole = read_source(write_klems_sheet(tmp_path / "whole.xml", OneWay(), KLEMS), Reading(side=side))
    source = read_source(path, Reading(side=side))
    assert isinstance(source, SheetSource) and isinstance(whole, SheetSource)
    assert "black" in str(source.facts["side"]) and "black" in str(source.facts["behind"])
    wi, wo = centres()
    assert not source.evaluate(wi, wo).any() and not source.reflected_behind(-wi, -wo).any()
    for lit in (1.0, -1.0):
        pair = wi * [1.0, 1.0, lit], wo * [1.0, 1.0, -lit]
        np.testing.assert_array_equal(source.transmitted(*pair), whole.transmitted(*pair))
        assert source.transmitted(*pair).any()


def test_a_file_of_transmission_alone_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    path = write_klems_sheet(tmp_path / "a.xml", OneWay(), KLEMS[2:])
    path.write_text(path.read_text().replace("<ScatteringData>", "<ScatteringData>1 2 "))
    with pytest.raises(BakeError, match=r"holds nothing that can be read: .* numbers instead of"):
        read_source(path)


def test_thin_cloth_is_reciprocal_and_keeps_its_energy() -> None:
    cloth = ThinCloth((0.3, 0.2, 0.1), (0.1, 0.1, 0.1), (0.3, 0.3, 0.3), (0.2, 0.3, 0.4), 10.0)
    rng = np.random.default_rng(1)
    wi, wo = (spherical(np.arccos(rng.uniform(0.1, 1, 50)), rng.uniform(0, 6.3, 50)) for _ in range(2))
    np.testing.assert_allclose(cloth.transmitted(wi, wo * BELOW), cloth.transmitted(wo * BELOW, wi))
    assert not cloth.transmitted(wi, wo).any() and not cloth.reflected_behind(wi, wo * BELOW).any()
    straight = directional_albedo(SheetView(cloth, "through"), 0.0)[0]
    np.testing.assert_allclose(straight, np.array(cloth.through) + cloth.forward, atol=1e-4)
    for side in sheet_facts(cloth, albedo_facts(cloth))["energy"].values():
        assert side["largest"] <= 1 + 1e-4 and side["above_one_deg"] == []


def test_thin_cloth_of_more_light_than_arrives_is_refused() -> None:
    ThinCloth((0.5, 0.5, 0.5), None, (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
    with pytest.raises(BakeError, match=r"lets through 1\.1 of the light"):
        ThinCloth((0.6, 0.5, 0.5), None, (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
    with pytest.raises(BakeError, match=r"lets through 1\.2 of the light"):
        ThinCloth((0.1, 0.1, 0.1), (0.7, 0.1, 0.1), (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))


def test_views_put_what_goes_straight_on_in_the_mirrors_place() -> None:
    sheet = OneWay()
    wi, wo = spherical(0.5, 0.3), spherical(0.9, 2.0)
    views = sheet_views(sheet)
    assert set(views) == {"through", "behind", "through_behind"} and set(sheet_views(ThinCloth())) == {"through"}
    np.testing.assert_array_equal(views["through"].evaluate(wi, wo), sheet.transmitted(wi * BELOW, wo))
    turned = np.array([1.0, -1.0, -1.0])
    np.testing.assert_array_equal(views["behind"].evaluate(wi, wo), sheet.reflected_behind(wi * turned, wo * turned))
    # The light of a viewer behind is mirrored in his own frame, then both go to the front's.
    np.testing.assert_array_equal(
        views["through_behind"].evaluate(wi, wo), sheet.transmitted(wi * BELOW * turned, wo * turned)
    )
    assert not views["behind"].evaluate(wi * BELOW, wo).any() and not views["through"].evaluate(wi, wo * BELOW).any()


def test_inspect_tells_what_comes_through_and_where_it_is_too_much(tmp_path: Path, capsys: Any) -> None:
    path = write_klems_sheet(tmp_path / "a.xml", OneWay(), KLEMS)
    assert main(["inspect", str(path)]) == 0
    words = capsys.readouterr().out
    assert "Transmittance 0°" in words and "Back: through 0°" in words and "Back: albedo 0°" in words
    # Reflected and let through are about pi (0.3 + 0.2).
    assert "reflected and let through" in words
    assert main(["inspect", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["sheet"]
    assert found["energy"]["front"]["largest"] > 1.5 and found["energy"]["behind"]["above_one_deg"] == []
    assert 0.5 < found["through"]["directional"][0][1] < 0.8


def test_light_that_all_goes_straight_on_leaves_native_closures_nothing() -> None:
    """Even Translucent BSDF is worth less than nothing then; one closure is there all the same."""
    cloth = ThinCloth((0.0, 0.0, 0.0), None, (0.0, 0.0, 0.0), (0.9, 0.9, 0.9), 8.0)
    settings = EnvelopeSettings(viewers=Elevations(8), basis=(Lobe("lambert"),))
    fit = fit_envelope(sheet_views(cloth)["through"], settings)
    assert [lobe.name for lobe in fit.closures] == ["lambert"]
