"""What a material's graph holds and omits, and who may override that."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.scene_fit import plan_aim, plan_brdf, plan_detail, plan_filter
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.errors import BakeError
from support.records import BRDF, brdf_record, sheet_parts


def record(share: float = 0.8, rim: float | None = None, **further: Any) -> BrdfRecord:
    rows = [[0, share], [45, share], [80, share if rim is None else rim]]
    envelope = {**BRDF["envelope"], "share": share, "by_theta_o_deg": rows}
    return brdf_record(**{"envelope": envelope, "rms_by_filter": None, **further})


def names(plan: Any, kept: bool) -> set[str]:
    return {effect.name for effect in plan.effects if effect.kept is kept}


def test_a_residual_that_carries_light_is_kept_and_may_not_be_left_out() -> None:
    plan = plan_brdf(record(0.8), Choices(), "1 lamp")
    assert plan.residual and plan.aim and "20 % of the light" in plan.effects[0].why
    with pytest.raises(BakeError, match="felt: needs its mirror part: it carries 20 %"):
        plan_brdf(record(0.8), Choices(residual="never"), "1 lamp")


def test_a_residual_of_nothing_is_left_out_with_all_that_served_it() -> None:
    plan = plan_brdf(record(0.9995), Choices(), "1 lamp")
    assert not plan.residual and not plan.aim and names(plan, False) == {"Mirror part"}
    assert plan_brdf(record(0.9995), Choices(residual="always"), "").residual


def test_a_residual_of_the_rim_alone_is_kept() -> None:
    """Little of all light, and all that is seen at grazing."""
    plan = plan_brdf(record(0.9995, rim=0.7), Choices(), "")
    assert plan.residual
    with pytest.raises(BakeError, match="30 % from some viewers"):
        plan_brdf(record(0.9995, rim=0.7), Choices(residual="never"), "")


@pytest.mark.parametrize("aim, found, kept", [("auto", "", False), ("auto", "2 lamps", True), ("always", "", True)])
def test_aiming_follows_the_scene(aim: str, found: str, kept: bool) -> None:
    assert plan_aim(Choices(aim=aim), found).kept is kept


def test_not_aiming_at_lamps_is_allowed_and_said_to_be_noisy() -> None:
    effect = plan_aim(Choices(aim="never"), "2 lamps")
    assert not effect.kept and "2 lamps" in effect.why and "no bias" in effect.why


def test_preview_and_reference_need_no_envelope() -> None:
    bare = record(envelope=None, table={**BRDF["table"], "filter": "bspline"})
    preview = plan_brdf(bare, Choices(mode="preview"), "1 lamp")
    assert not preview.residual and not preview.aim
    reference = plan_brdf(bare, Choices(mode="reference"), "")
    assert reference.residual and "Mirror part" not in names(reference, True)
    for mode in ("exact", "balanced"):
        with pytest.raises(BakeError, match="bake it again"):
            plan_brdf(bare, Choices(mode=mode), "")


def test_balanced_leaves_the_mirror_out_after_diffuse_bounces() -> None:
    plan = plan_brdf(record(), Choices(mode="balanced"), "")
    assert "Mirror after a diffuse bounce" in names(plan, False)
    assert "Mirror after a diffuse bounce" in names(plan_brdf(record(), Choices(), ""), True)


@pytest.mark.parametrize("nearest, chosen", [(0.0109, "nearest"), (0.012, "trilinear")])
def test_the_simplest_filter_that_is_as_good(nearest: float, chosen: str) -> None:
    known = {"nearest": nearest, "trilinear": 0.01}
    found, effect = plan_filter(record(rms_by_filter=known), Choices())
    assert found == chosen and effect.kept is (chosen == "trilinear")
    assert plan_filter(record(rms_by_filter=known), Choices(filter="bspline"))[0] == "bspline"


def test_fitted_coefficients_are_no_values_for_a_simpler_filter() -> None:
    """Of the whole table; the residual holds values."""
    table = {**BRDF["table"], "filter": "bspline", "spline": "fitted"}
    fitted = record(table=table, rms_by_filter={"bspline": 0.01})
    for name in ("nearest", "trilinear"):
        with pytest.raises(BakeError, match=f"fitted spline coefficients, which {name} would take for values"):
            plan_brdf(fitted, Choices(mode="reference", filter=name), "")
        assert plan_brdf(fitted, Choices(filter=name), "").filter == name
    plan = plan_brdf(fitted, Choices(mode="reference"), "")
    (why,) = (effect.why for effect in plan.effects if effect.name == "Interpolation")
    assert plan.filter == "bspline" and "no simpler filter can read" in why
    plain = record(table=table | {"spline": "plain"})
    assert plan_brdf(plain, Choices(mode="reference", filter="nearest"), "").filter == "nearest"


def test_a_filter_of_a_sheet_serves_all_of_its_tables() -> None:
    """Its front's reflection may hardly vary, and what goes through it may: each is read as it was baked."""
    even, steep = {"nearest": 0.01, "trilinear": 0.01}, {"nearest": 0.05, "trilinear": 0.01}
    both = record(rms_by_filter=even, **sheet_parts(through={"rms_by_filter": even}))
    assert plan_filter(both, Choices())[0] == "nearest"
    for name in ("through", "behind", "through_behind"):
        parts = {"through": {"rms_by_filter": even}, name: {"rms_by_filter": steep}}
        found, effect = plan_filter(record(rms_by_filter=even, **sheet_parts(alike=False, **parts)), Choices())
        assert found is None and effect.kept and "nearest is 5 times as large" in effect.why
    spline = {"table": {**BRDF["table"], "filter": "bspline", "spline": "fitted"}, "rms_by_filter": {"bspline": 0.01}}
    plan = plan_brdf(record(rms_by_filter=even, **sheet_parts(through=spline)), Choices(mode="reference"), "")
    (why,) = (effect.why for effect in plan.effects if effect.name == "Interpolation")
    assert plan.filter is None and why.startswith("trilinear and bspline, each")


def test_a_filter_that_would_misread_a_part_of_a_sheet_is_refused() -> None:
    table = {**BRDF["table"], "filter": "bspline", "spline": "fitted"}
    sheet = record(**sheet_parts(through={"table": table}))
    for name in ("nearest", "trilinear"):
        with pytest.raises(BakeError, match=r"felt: sheet\.through: holds fitted spline coefficients"):
            plan_brdf(sheet, Choices(mode="reference", filter=name), "")
        assert plan_brdf(sheet, Choices(filter=name), "").filter == name
    assert plan_brdf(sheet, Choices(mode="reference", filter="bspline"), "").filter == "bspline"


def test_filters_of_older_bundles_stay() -> None:
    assert plan_filter(record(), Choices())[0] == "trilinear"


@pytest.mark.parametrize("pixels, factor", [(1.0, 1), (0.13, 1), (0.12, 4), (0.01, 32)])
def test_texels_become_one_while_they_stay_below_half_a_pixel(pixels: float, factor: int) -> None:
    found, effect = plan_detail(Choices(), "slices", pixels, "", "felt")
    assert found == factor and effect.kept is (factor == 1)


def test_texels_that_can_be_seen_may_not_be_left_out() -> None:
    never = Choices(detail="never")
    with pytest.raises(BakeError, match="up to 3 pixels across"):
        plan_detail(never, "slices", 3.0, "", "felt")
    with pytest.raises(BakeError, match="the camera moves"):
        plan_detail(never, "slices", float("inf"), "the camera moves", "felt")
    assert plan_detail(replace(never, detail="always"), "slices", 1e-6, "", "felt")[0] == 1


def test_only_slices_have_a_mean() -> None:
    found, effect = plan_detail(Choices(), "power", 1e-3, "", "felt")
    assert found == 1 and effect.kept and "power" in effect.why
