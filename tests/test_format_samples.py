"""Published files of the formats, beside values that did not come from our readers; skipped where they are absent."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from measured_materials.bake.directions import spherical
from measured_materials.bake.errors import BakeError
from measured_materials.bake.source import Array
from measured_materials.bake.sources import mbsdf, read_source
from measured_materials.bake.sources.goniometer import zemax
from measured_materials.bake.sources.radiance import window_xml
from measured_materials.bake.sources.radiance.klems import klems_lookup
from measured_materials.bake.sources.radiance.tensor_tree import tree_lookup
from support.networks import network_values

# Radiance's library takes the least value out as a diffuse part and adds it again, in single precision and through its
# own encoding of colours: its printed values differ from the file's own text by up to 1e-4 of them.
RADIANCE = 1.5e-4


def radiance_values(path: Path) -> tuple[Array, Array, Array]:
    """wi, wo and the value that Radiance's own library printed for them."""
    rows = np.array(list(csv.reader(path.read_text().splitlines()))[1:], float)
    angles = np.radians(rows[:, :4])
    return spherical(angles[:, 0], angles[:, 1]), spherical(angles[:, 2], angles[:, 3]), rows[:, 4]


@pytest.mark.parametrize("kind", ["klems", "tensortree"])
def test_every_pair_is_what_radiance_says(kind: str, shared_data: Path) -> None:
    compared = 0
    for path in sorted((shared_data / "formats" / kind).glob("*.[xX][mM][lL]")):
        layer = window_xml.read_layer(path)
        make = tree_lookup if layer.structure.startswith("tensortree") else klems_lookup
        for listed in path.parent.glob(f"{path.stem}*.radiance.csv"):
            wi, wo, value = radiance_values(listed)
            for side, sign in (("front", 1), ("back", -1)):
                seen = (wi[:, 2] * sign > 0) & (wo[:, 2] * sign > 0)
                if side not in layer.blocks or not seen.any():
                    continue
                # As Radiance has it, the back is looked up with the front's x and y.
                up = np.array([1.0, 1.0, sign])
                lookup, _ = make(path, layer.structure, layer.blocks[side]["Y"])
                found = lookup(wi[seen] * up, wo[seen] * up)
                np.testing.assert_allclose(found, value[seen], rtol=RADIANCE, atol=1e-6, err_msg=listed.name)
                compared += int(np.count_nonzero(seen))
    assert compared >= {"klems": 1600, "tensortree": 2800}[kind]


def test_the_front_of_a_klems_file_is_its_source(shared_data: Path) -> None:
    folder = shared_data / "formats" / "klems"
    source = read_source(folder / "2011-SA1.XML")
    wi, wo, value = radiance_values(folder / "2011-SA1.Reflection_Back.radiance.csv")
    np.testing.assert_allclose(source.evaluate(wi, wo)[:, 1], value, rtol=RADIANCE)
    assert not source.isotropic and str(source.facts["side"]).startswith("front")


def test_zemax_and_fred_of_one_measurement_agree(shared_data: Path) -> None:
    """Zemax' file is resampled around the mirror and averaged over both sides, FRED's keeps the samples of one: at
    these they differ by 6 % in the median. Azimuth 0 away from the normal, the other reading, would differ by far
    more.
    """
    path = shared_data / "formats" / "fred" / "AnoBlackEC1onAlum.txt"
    grid = read_source(shared_data / "formats" / "zemax" / "AnoBlackEC1onAlum.bsdf")
    rows, theta_i = [], 0.0
    for words in (line.split() for line in path.read_text().splitlines()[2:]):
        if len(words) == 2:
            theta_i = float(words[0])
        else:
            rows.append([theta_i, *map(float, words)])
    ti, to, po, value = np.array(rows).T
    wi, wo = spherical(np.radians(ti), np.pi), spherical(np.radians(to), np.radians(po))
    found = grid.evaluate(wi, wo)[:, 0]
    assert np.median(np.abs(found / value - 1)) < 0.08
    fit = read_source(path)
    assert np.median(np.abs(fit.evaluate(wi, wo)[:, 0] / value - 1)) < 0.03


def test_genuine_files_of_zemax_and_nvidia(shared_data: Path) -> None:
    lenses = zemax.read(shared_data / "formats" / "zemax" / "IMX455_aniso.bsdf")
    assert not lenses.isotropic and lenses.facts["entries"] == [36, 4, 36, 21]
    paint = mbsdf.read(shared_data / "formats" / "mbsdf" / "carpaint_red.mbsdf")
    assert paint.facts["entries"] == [45, 45, 90]
    np.testing.assert_allclose(paint.facts["most_negative"], -0.0997, atol=1e-4)
    theta = np.radians(45.0)
    mirror, retro = (paint.evaluate(spherical(theta, 0.0), spherical(theta, phi))[0] for phi in (np.pi, 0.0))
    assert mirror > 5 * retro


@pytest.mark.parametrize(
    ("name", "count"),
    [("test_rgb_theta_2_phi_3", 36), ("test_scalar_theta_2_phi_3", 12), ("test_reflection_transmission_scalar", 12)],
)
def test_entries_of_nvidias_own_tests(name: str, count: int, shared_data: Path) -> None:
    parts = mbsdf.read_parts(shared_data / "formats" / "mbsdf" / f"{name}.mbsdf")
    assert parts.reflection is not None
    assert np.array_equal(parts.reflection.reshape(-1), np.arange(count))
    if "transmission" in name:
        assert parts.transmission is not None and np.array_equal(parts.transmission.reshape(-1), np.arange(16))


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("test_none", "holds no data"),
        ("test_transmission_scalar_theta_2_phi_4", "transmission only"),
        ("test_file_format_error", "does not begin as"),
    ],
)
def test_files_of_nvidias_that_are_refused(name: str, says: str, shared_data: Path) -> None:
    with pytest.raises(BakeError, match=says):
        read_source(shared_data / "formats" / "mbsdf" / f"{name}.mbsdf")


def test_a_published_network_is_read_from_keras_file(shared_data: Path) -> None:
    """blue-rubber beside the MERL reconstruction's own weights of the same material."""
    pytest.importorskip("pyfive")
    source = read_source(shared_data / "formats" / "neural_brdf" / "blue-rubber.h5")
    weights = np.load(shared_data / "neural_merl" / "weights.npz")
    rng = np.random.default_rng(2)
    wi, wo = (spherical(np.arccos(rng.random(300)), rng.random(300) * 2 * np.pi) for _ in range(2))
    value = network_values(weights, "blue-rubber", wi, wo)
    np.testing.assert_allclose(source.evaluate(wi, wo), value, rtol=1e-4, atol=1e-6)


@pytest.mark.slow
def test_tapes_of_cea_shine_back_to_the_light(shared_data: Path) -> None:
    """Which side is the retro direction is the thing that a good guess has wrong in ALTA's projected angles."""
    source = read_source(shared_data / "alta" / "retro-gray-tape.dat")
    theta = np.radians([15.0, 30.0])
    back = source.evaluate(spherical(theta, 0.0), spherical(theta, 0.0))[:, 0]
    mirror = source.evaluate(spherical(theta, 0.0), spherical(theta, np.pi))[:, 0]
    assert (back > 1.5 * mirror).all(), (back, mirror)
    assert "not stated" in str(source.facts["quantity"])
