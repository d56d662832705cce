"""Colour differences: the published pairs of CIEDE2000, and a bundle's sphere beside its measurement's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.summary import brdf_rows
from measured_materials.bake.brdf.appearance import Together, color_differences
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.color_difference import ciede2000, lab_of
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import Ggx, Lambert
from support.records import BRDF

# L*, a*, b* of two colours and their difference: table 1 of Sharma, Wu and Dalal 2005, all 34 pairs.
PAIRS = np.array(
    """
    50 2.6772 -79.7751 50 0 -82.7485 2.0425  50 3.1571 -77.2803 50 0 -82.7485 2.8615
    50 2.8361 -74.0200 50 0 -82.7485 3.4412  50 -1.3802 -84.2814 50 0 -82.7485 1.0000
    50 -1.1848 -84.8006 50 0 -82.7485 1.0000  50 -0.9009 -85.5211 50 0 -82.7485 1.0000
    50 0 0 50 -1 2 2.3669  50 -1 2 50 0 0 2.3669
    50 2.4900 -0.0010 50 -2.4900 0.0009 7.1792  50 2.4900 -0.0010 50 -2.4900 0.0010 7.1792
    50 2.4900 -0.0010 50 -2.4900 0.0011 7.2195  50 2.4900 -0.0010 50 -2.4900 0.0012 7.2195
    50 -0.0010 2.4900 50 0.0009 -2.4900 4.8045  50 -0.0010 2.4900 50 0.0010 -2.4900 4.8045
    50 -0.0010 2.4900 50 0.0011 -2.4900 4.7461  50 2.5 0 50 0 -2.5 4.3065
    50 2.5 0 73 25 -18 27.1492  50 2.5 0 61 -5 29 22.8977
    50 2.5 0 56 -27 -3 31.9030  50 2.5 0 58 24 15 19.4535
    50 2.5 0 50 3.1736 0.5854 1.0000  50 2.5 0 50 3.2972 0 1.0000
    50 2.5 0 50 1.8634 0.5757 1.0000  50 2.5 0 50 3.2592 0.3350 1.0000
    60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
    63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630
    61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
    35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645
    22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
    36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146
    90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
    90.9257 -0.5406 -0.9208 88.6381 -0.8985 -0.7239 1.5381
    6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
    2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
    """.split(),
    float,
).reshape(-1, 7)


def test_the_published_pairs() -> None:
    """To the four digits that are printed, and the same the other way round."""
    first, second, truth = PAIRS[:, :3], PAIRS[:, 3:6], PAIRS[:, 6]
    assert len(truth) == 34
    np.testing.assert_allclose(ciede2000(first, second), truth, rtol=0, atol=5.1e-5)
    np.testing.assert_allclose(ciede2000(second, first), truth, rtol=0, atol=5.1e-5)


def test_lab_of_white_grey_and_red() -> None:
    """Red of sRGB has L* 53.24, a* 80.09, b* 67.20 under D65 (Lindbloom's calculator)."""
    np.testing.assert_allclose(lab_of(np.ones(3)), [100, 0, 0], atol=1e-9)
    np.testing.assert_allclose(lab_of(np.array([1.0, 0, 0])), [53.24, 80.09, 67.20], atol=0.01)
    dark = lab_of(np.full((2, 3), [[0.001] * 3, [-1.0] * 3]))
    np.testing.assert_allclose(dark[:, 0], [903.3 * 0.001, 0], rtol=1e-4)


@dataclass(frozen=True)
class Scaled:
    """A source times a number."""

    source: Any
    factor: float

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr."""
        return self.factor * self.source.evaluate(wi, wo)


@pytest.mark.parametrize("source", [Lambert(), Ggx(alpha=0.2), Ggx(alpha=0.1, alpha_y=0.4)], ids=lambda s: s.name)
def test_the_same_material_does_not_differ_and_a_brighter_one_does(source: Any) -> None:
    """A fifth more light is plainly seen, a fiftieth more hardly, and parts count by their sum."""
    halves = Together((Scaled(source, 0.5), Scaled(source, 0.5)))
    shown = {"same": source, "parts": halves, "plain": Scaled(source, 1.2), "hardly": Scaled(source, 1.02)}
    found: Any = color_differences(source, shown)
    assert found["same"] == {"median": 0, "p95": 0} and found["parts"]["p95"] < 1e-6
    assert 0.05 < found["hardly"]["median"] < 1 < found["plain"]["median"] < 12
    assert all(entry["median"] <= entry["p95"] for entry in found.values())


def test_a_flat_material_in_the_formula_itself() -> None:
    """White against a tenth less of it in the lit middle: the largest difference is what CIEDE2000 has of the two."""
    found: Any = color_differences(Lambert(), {"dim": Scaled(Lambert(), 0.9)})
    most = float(ciede2000(lab_of(np.full(3, 0.8)), lab_of(np.full(3, 0.72))))
    assert 0.8 * most < found["dim"]["p95"] < 1.2 * most


def test_rows_tell_it_and_older_bundles_do_without() -> None:
    told = dict(brdf_rows.error_rows(BrdfRecord.parse(BRDF, "here")))
    assert told["Color difference"].startswith("0.12 in the median, 0.8 ")
    assert told["In Reference"].startswith("0.2 in the median, 1.5 ")
    alone = {**BRDF, "color_difference": {"table": {"median": 0.2, "p95": 1.5}}}
    assert dict(brdf_rows.error_rows(BrdfRecord.parse(alone, "here")))["Color difference"].startswith("0.2 ")
    older = {key: value for key, value in BRDF.items() if key != "color_difference"}
    assert "Color difference" not in dict(brdf_rows.error_rows(BrdfRecord.parse(older, "here")))
