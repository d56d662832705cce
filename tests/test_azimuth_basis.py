"""A map over azimuth: its values between the nodes, its curves as a texture, and what a bundle keeps of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis, levels_of, mean_curves
from measured_materials.bake.shading_maps.azimuth.azimuth_envelope import azimuth_envelope
from measured_materials.bake.shading_maps.azimuth.curve_layout import (
    CurveLayout,
    curve_uv,
    pack_curves,
    unpack_curves,
)
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.store import store_azimuth
from measured_materials.nodes.shading_map_material import build_shading_map
from support import azimuth
from support.azimuth import clamped_basis, lambert_basis, write_azimuth_bundle


def test_values_are_those_of_the_closed_form_at_the_nodes_and_the_mean_is_the_level() -> None:
    basis = lambert_basis(azimuths=16, levels=9)
    slope = basis.coefficients[..., 1:]
    for i, p in ((1, 0), (4, 3), (7, 15), (8, 5)):
        x, phi = levels_of(9)[i], 2 * np.pi * p / 16
        lean = x * np.sqrt(1 - x * x)
        expected = x + lean * (slope[..., 0] * np.cos(phi) + slope[..., 1] * np.sin(phi))
        assert np.abs(basis.evaluate(x, phi) - expected).max() < 1e-6
        assert abs(basis.evaluate(x, phi).mean() - x) < 1e-6
    assert not basis.evaluate(0.0, 1.0).any()
    assert np.array_equal(basis.evaluate(3.0, 0.4), basis.evaluate(1.0, 2.0))


def test_azimuth_is_periodic_and_linear_between_its_nodes() -> None:
    basis = clamped_basis(azimuths=8)
    step = 2 * np.pi / 8
    for p in (0, 3, 7):
        ends = basis.weights(0.4, p * step), basis.weights(0.4, (p + 1) * step)
        assert np.allclose(basis.weights(0.4, (p + 0.25) * step), 0.75 * ends[0] + 0.25 * ends[1], atol=1e-6)
    phi = np.linspace(-9, 9, 50)
    assert np.allclose(basis.weights(0.4, phi), basis.weights(0.4, phi + 2 * np.pi), atol=1e-5)
    assert np.allclose(basis.weights(0.4, -1e-9), basis.weights(0.4, 0.0), atol=1e-6)


def test_levels_crowd_towards_black_and_means_are_those_of_even_ones() -> None:
    basis = clamped_basis(azimuths=8, levels=12)
    x = levels_of(12)
    assert x[0] == 0 and x[-1] == 1 and (np.diff(x, 2) > 0).all()
    # Straight lines in the position: half way between two nodes are half of both, in parts of the level.
    middle = ((4.5) / 11) ** 1.5
    ends = [basis.weights(level, 0.3) / level for level in x[4:6]]
    assert np.allclose(basis.weights(middle, 0.3) / middle, (ends[0] + ends[1]) / 2, atol=1e-6)
    means = mean_curves(basis.curves)
    around = np.mean([basis.weights(5 / 11, 2 * np.pi * p / 8) for p in range(8)], axis=0)
    assert np.allclose(means[:, 5], around, atol=1e-6) and not means[:, 0].any()


def test_points_of_the_texture_and_channels_of_their_own_level() -> None:
    basis = clamped_basis(4, 6)
    uv = np.array([[(2 + 0.5) / 6, 1 - (1 + 0.5) / 4]])
    whole = [basis.evaluate(x, 1.1)[1, 2] for x in (0.2, 0.5, 0.9)]
    assert np.allclose(basis.at(uv, np.array([0.5]), np.array([1.1]))[0], whole[1], atol=1e-6)
    apart = basis.at(uv, np.array([[0.2, 0.5, 0.9]]), np.array([1.1]))[0]
    assert np.allclose(apart, [whole[k][k] for k in range(3)], atol=1e-6)
    last = basis.evaluate(1.0, 0.0)[1, 2]
    assert np.allclose(basis.at(uv, np.array([2.0]), np.array([0.3]), "scale")[0], 2 * last, atol=1e-5)


@pytest.mark.parametrize("rank", [1, 4, 5])
def test_a_linear_filter_of_the_curves_texture_finds_the_weights(rank: int) -> None:
    basis = clamped_basis(rank=rank, azimuths=6, levels=5)
    image, layout = pack_curves(basis.curves), CurveLayout(rank, 6, 5)
    assert np.array_equal(unpack_curves(image, layout), basis.curves)
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(0, 1.2, 60), [1e-9, 1, 1, 1e-9]])
    turns = np.concatenate([rng.uniform(0, 1, 60), [0, 0, 1, 1]])
    expected = basis.weights(x, 2 * np.pi * turns) / np.minimum(x, 1)[:, None]
    for group in range(layout.groups):
        u, v = curve_uv(xp_numpy, layout, group, x, turns)
        found = _bilinear(image, u, v)[:, : rank - 4 * group]
        assert np.abs(found - expected[:, 4 * group : 4 * group + 4]).max() < 1e-5


def _bilinear(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """As a texture that is extended by its edge."""
    height, width = image.shape[:2]
    column, row = u * width - 0.5, (1 - v) * height - 0.5
    left, top = np.floor(column).astype(int), np.floor(row).astype(int)
    a, b = (column - left)[:, None], (row - top)[:, None]

    def texel(i: int, j: int) -> np.ndarray:
        return image[np.clip(top + i, 0, height - 1), np.clip(left + j, 0, width - 1)]

    return (1 - b) * ((1 - a) * texel(0, 0) + a * texel(0, 1)) + b * ((1 - a) * texel(1, 0) + a * texel(1, 1))


@pytest.mark.parametrize("storage", [Storage.HALF, Storage.FLOAT32])
@pytest.mark.parametrize("make", [lambert_basis, clamped_basis])
def test_the_envelope_lies_under_the_stored_map_everywhere_and_touches_it(make: object, storage: Storage) -> None:
    basis = store_azimuth(make(), storage)[2]  # type: ignore[operator]
    found = azimuth_envelope(basis, storage)
    rng = np.random.default_rng(1)
    places = [(x, phi) for x, phi in zip(rng.uniform(0.02, 1, 300), rng.uniform(0, 7, 300), strict=True)]
    nodes = [(x, 2 * np.pi * p / 16) for x in levels_of(8)[1:] for p in range(16)]
    slopes = np.stack([basis.evaluate(x, phi) / x for x, phi in nodes])
    for x, phi in places:
        assert (basis.evaluate(x, phi) - x * found.envelope).min() > -1e-6
    assert (slopes.min(0) - found.envelope).max() < (2e-3 if storage is Storage.HALF else 1e-4)
    # The light of all levels, between the nodes too, where what is held at 0 is held exactly: 1 % of it.
    fine = [(x, 2 * np.pi * (p + 0.5) / 16) for x in (np.arange(64) + 0.5) / 64 for p in range(16)]
    whole = np.mean([basis.evaluate(x, phi) for x, phi in fine], axis=0)
    assert abs(found.energy - 0.5 * found.envelope.sum() / whole.sum()) < 0.01 * found.energy + 1e-6


def test_a_bundle_gives_the_map_back(tmp_path: Path) -> None:
    basis = clamped_basis(5, 7)
    record = ShadingMapRecord.read(write_azimuth_bundle(tmp_path / "cloth.mmat", basis))
    assert record.document["schema"] == 7
    assert (record.map.model, record.map.azimuths, record.map.layout.tiles, record.map.slices) == ("azimuth", 16, 5, 8)
    again = record.load_azimuth()
    assert np.array_equal(again.curves, basis.curves)
    assert np.abs(again.coefficients - basis.coefficients).max() < 1e-6
    mean = np.mean([basis.evaluate(3 / 7, 2 * np.pi * p / 16) for p in range(16)], axis=0)
    assert np.abs(record.load_map().slices[3] - mean).max() < 1e-5


def _grown(image: np.ndarray, told: dict[str, Any]) -> None:
    image[2, 3] = 2e6


def _open(image: np.ndarray, told: dict[str, Any]) -> None:
    image[16] += 0.01  # the row that repeats the first, which numpy does not read


def _surplus(image: np.ndarray, told: dict[str, Any]) -> None:
    image[20, 2, 3] = 0.5  # an eighth curve of five


def _black(image: np.ndarray, told: dict[str, Any]) -> None:
    image[:17, 0] += 0.5


def _others(image: np.ndarray, told: dict[str, Any]) -> None:
    told["mean_curves"][1][4] += 0.01


def _from_light(image: np.ndarray, told: dict[str, Any]) -> None:
    told["mean_curves"][0][0] = 0.01  # S of no light


@pytest.mark.parametrize(
    ("damage", "cause"),
    [
        (_grown, r"holds curves above 1e\+06"),
        (_open, "does not go on at a whole turn as it begins"),
        (_surplus, "holds more curves than the map has"),
        (_black, "has curves at black that are not those of the level after it"),
        (_others, "holds other curves than those whose means material.json gives"),
        (_from_light, "holds other curves than those whose means material.json gives"),
    ],
)
def test_damaged_curves_are_one_line_wherever_they_are_read(
    damage: Callable[[np.ndarray, dict[str, Any]], None],
    cause: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def damaged(basis: AzimuthBasis, storage: Storage) -> tuple[Any, dict[str, Any], AzimuthBasis]:
        images, told, stored = store_azimuth(basis, storage)
        pixels = images["curves"].pixels.copy()
        damage(pixels, told)
        return {**images, "curves": replace(images["curves"], pixels=pixels)}, told, stored

    monkeypatch.setattr(azimuth, "store_azimuth", damaged)
    record = ShadingMapRecord.read(write_azimuth_bundle(tmp_path / "cloth.mmat", clamped_basis()))
    line = rf"_curves\.exr: .*{cause}.*; bake the photographs again"
    for load in (record.load_azimuth, record.load_map, lambda: build_shading_map(record.files())):
        with pytest.raises(BakeError, match=line):
            load()


def test_curves_at_even_levels_are_refused(tmp_path: Path) -> None:
    bundle = write_azimuth_bundle(tmp_path / "cloth.mmat", clamped_basis())
    told = dict(bundle.material["map"])
    with pytest.raises(BakeError, match="crowding"):
        ShadingMapRecord.parse({**bundle.material, "map": {**told, "crowding": 1.0}}, bundle.path)
    told.pop("crowding")
    with pytest.raises(BakeError, match="of an early version, which is not read any more; bake its photographs again"):
        ShadingMapRecord.parse({**bundle.material, "map": told}, bundle.path)


def test_what_cannot_be_kept_is_refused() -> None:
    basis = lambert_basis()
    with pytest.raises(BakeError, match=r"rgbe.*either sign.*half or float32"):
        store_azimuth(basis, Storage.RGBE)
    with pytest.raises(BakeError, match=r"azimuth rank.*24.*1 to 23"):
        AzimuthBasis(np.zeros((2, 2, 3, 24), np.float32), np.zeros((24, 8, 4), np.float32))
