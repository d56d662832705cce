"""The records of both kinds of bundle: every field arrives, and a document of anybody's is one clear error at most."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_materials.bake.brdf.grids import grid_of, is_anisotropic
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.checked_json import Fields
from measured_materials.bake.envelope import ShareLayout, SlopeShareLayout
from measured_materials.bake.envelope.anisotropic_lobes import AnisotropicLobe
from measured_materials.bake.envelope.viewers import Elevations, ViewerGrid
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.slope_cells import SlopeLayout
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.tables.atlas import AtlasLayout
from measured_materials.bake.tables.grids.anisotropic_grids import AnisotropicHalfGrid, AnisotropicNormalGrid
from measured_materials.bake.tables.grids.half_vector_grid import HalfVectorGrid
from measured_materials.bake.tables.grids.normal_vector_grid import NormalVectorGrid
from measured_materials.bake.tables.grids.parameterization import LogWarp
from measured_materials.bake.tables.log_codes import LogCodes
from support.records import ALBEDO, ANISOTROPIC, BRDF, SHADING_MAP, brdf_record, changed

KINDS: dict[str, tuple[Any, dict[str, Any]]] = {
    "isotropic": (BrdfRecord, BRDF),
    "anisotropic": (BrdfRecord, ANISOTROPIC),
    "shading map": (ShadingMapRecord, SHADING_MAP),
}

# --- every field ------------------------------------------------------------------------------------------


def test_isotropic() -> None:
    found = brdf_record()
    assert (found.name, found.source.format, found.where, found.anisotropic) == ("felt", "MERL", "felt", False)
    assert found.table.grid == NormalVectorGrid(8, "bezier", 0.5, 0.25, 0.02)
    assert found.residual is not None and found.residual.grid == NormalVectorGrid(8, "bezier", 0.0, 0.25, 0.02)
    assert (found.table.filter, found.table.spline, found.table.storage) == ("trilinear", "none", Storage.HALF)
    assert (found.table.scale, found.table.offset, found.table.log) == (2.0, 2.0**-14, None)
    assert (found.residual.scale, found.residual.offset) == (4.0, 0.0)
    assert found.residual.errors is not None and found.residual.errors.relative == 0.004
    assert found.sampler == SamplerLayout(4, 4, 2, 2)
    assert found.settings == BakeSettings(8, "bezier", sampler=SamplerLayout(4, 4, 2, 2))
    assert (found.errors.rms, found.errors.relative, found.errors.directions) == (0.02, 0.01, 27564)
    assert found.rms_by_filter == {"nearest": 0.4, "trilinear": 0.1}
    assert found.color_differences["exact"].median == 0.12 and found.color_differences["table"].p95 == 1.5
    assert found.search is not None and (found.search.by_error.theta, found.search.by_intensity.phi) == (0.5, 1.0)
    assert not found.search.intensity_finds_least_error and found.search.error_of_intensity_choice == 2.5
    assert [(c.basis, c.parameterization, c.rms) for c in found.candidates] == [
        ("normal", "bezier", 0.01),
        ("half", "fitted", 0.03),
    ]
    assert found.envelope is not None and found.envelope.closures == (Lobe("lambert"), Lobe("ggx", 0.3))
    assert (found.envelope.viewers, found.envelope.share, found.envelope.overshoot) == (Elevations(64), 0.8, 1e-4)
    assert found.envelope.by_theta_o_deg == ((0, 0.8), (45, 0.8), (80, 0.8))
    assert found.preview is not None and found.preview.closures == (Lobe("sheen", 0.5),)
    assert (found.preview.viewers, found.preview.error) == (Elevations(32), 0.2)
    assert found.has("table") and not found.has("slices") and found.images["residual"].size == (40, 60)
    assert found.images["table"].render_bytes(packed=False) == 40 * 60 * 8


def test_albedo() -> None:
    found = brdf_record(albedo={**ALBEDO, "directional": [[1.5, -1, 0.3], [0.6, 0.5, 0.4]], "above_one_deg": [0]})
    assert found.albedo.theta_o_deg == (0, 45) and found.albedo.directional[0] == (1.5, -1, 0.3)
    assert found.albedo.white_sky == (0.5, 0.4, 0.3) and found.albedo.above_one_deg == (0,)
    assert found.table_albedo is not None and found.table_albedo.largest == 0.6


def test_anisotropic() -> None:
    found = BrdfRecord.parse(ANISOTROPIC, "brushed")
    assert found.anisotropic and found.table.grid == AnisotropicHalfGrid((4, 4, 8, 8), 0.1, 0.4, True, 1 / 3, 1, False)
    assert found.residual is not None and found.residual.grid == found.table.grid
    assert found.table.log == LogCodes((8, 8, 8), (0.1, 0.1, 0)) and found.table.storage is Storage.LOG
    assert found.sampler == SlopeLayout(2, 2, 4, 4, 0.05, 0.2, True)
    assert found.envelope is not None and found.envelope.viewers == ViewerGrid(6, 4, True)
    assert found.envelope.closures == (AnisotropicLobe("lambert"), AnisotropicLobe("ggx", 0.1, 0.4))
    assert found.preview is not None and found.preview.viewers == ViewerGrid(6, 4, True)
    assert found.search is None and found.table_albedo is None
    assert found.settings == BakeSettings(8, storage=Storage.LOG, filter="bspline", viewers=(6, 4))
    assert [(c.basis, c.parameterization) for c in found.candidates] == [("half", "slopes"), ("normal", "bezier")]


GRIDS = [
    NormalVectorGrid(12, "fitted", warps=(LogWarp(0.1, 0.4), LogWarp(0.01, 4.0))),
    HalfVectorGrid((9, 24, 6), "bezier", alphas=(1.0, 0.125, 0.0), reciprocal=False, horizon_share=0.02),
    HalfVectorGrid((9, 24, 6), "fitted", warps=(LogWarp(), LogWarp(0.003), LogWarp())),
    HalfVectorGrid((9, 24, 6), "squared", cosine_power=2),
    AnisotropicNormalGrid((6, 5, 4, 8), 0.25, 0.75),
    AnisotropicNormalGrid((5, 5, 4, 8), folded=True, parameterization="fitted", warps=(LogWarp(0.1), LogWarp())),
    AnisotropicNormalGrid((6, 5, 4, 8), parameterization="uniform"),
    AnisotropicHalfGrid((8, 4, 12, 12), 0.03, 0.5, False),
]


@pytest.mark.parametrize("grid", GRIDS, ids=repr)
def test_grids_come_back(grid: Any) -> None:
    """Of all four kinds, through JSON."""
    document = json.loads(json.dumps(grid.facts()))
    anisotropic = isinstance(grid, AnisotropicNormalGrid | AnisotropicHalfGrid)
    assert is_anisotropic(grid) is anisotropic and min(AtlasLayout.of(grid).size) > 0
    assert grid_of(Fields(document, "x"), anisotropic) == grid


def test_anisotropic_normal_grids_without_a_name_are_bezier() -> None:
    document = AnisotropicNormalGrid((6, 5, 4, 8), 0.25, 0.75).facts()
    del document["parameterization"]
    assert grid_of(Fields(document, "x"), True) == AnisotropicNormalGrid((6, 5, 4, 8), 0.25, 0.75)


def test_shading_map() -> None:
    found = ShadingMapRecord.parse(SHADING_MAP, "swatch")
    stored, photographs = found.map, found.photographs
    assert (stored.model, stored.slices, stored.scale, stored.envelope_scale) == ("slices", 4, 2.0, 4.0)
    assert (stored.layout.tiles, stored.layout.height, stored.layout.width, stored.image) == (3, 16, 20, "slices")
    assert (stored.storage, stored.a_max, stored.envelope_energy, stored.residual_energy) == ("half", 0.25, 0.75, 0.25)
    assert stored.means is not None and stored.means[1] == (0.3, 0.3, 0.3) and stored.level_by_cosine[-1] == 1
    assert photographs.averages == (0.1, 0.4, 1.0) and photographs.after == (0, 0.3, 0.6, 1)
    assert photographs.elevations_deg == (10, 45, 90) and photographs.files == 5
    assert (photographs.lights, photographs.decoded_as) == ("file names", ("srgb: so it says",))
    assert (photographs.converted_from, photographs.warnings) == (("Display P3",), ("a word",))
    assert (photographs.calibration, photographs.calibrated_by) == ("brightest in a card", "card")
    assert found.render == RenderSettings(lobe=None, sigma=0.5)
    assert (found.albedo.sigma, found.albedo.a_max, found.albedo.largest) == (0.5, 0.25, 0.6)
    errors = found.errors
    assert (errors.storage_rms, errors.signal_rms, errors.held_out) == (1e-4, 0.5, 1)
    assert (errors.held_out_relative, errors.held_out_rms) == (0.05, 0.02)
    assert found.tiling is not None and (found.tiling.method, found.tiling.before, found.tiling.after) == (
        "offset",
        3,
        1,
    )
    assert found.lobe_fit is not None and (found.lobe_fit.lobe, found.lobe_fit.residual) == (Lobe("ggx", 0.5), 0.1)
    lobe = found.measured_lobe()
    assert (lobe.table.grid, lobe.sampler, lobe.albedo) == (NormalVectorGrid(8, "bezier", 0.5, 0.25, 0.02), SIZES, 0.4)


SIZES = SamplerLayout(4, 4, 2, 2)


def test_what_a_material_keeps_beside_it() -> None:
    effects = [{"name": "Mirror", "kept": True, "why": "it shines"}, 3]
    kept = {"packed": True, "rendering": {"choices": {"mode": "exact", "aim": 3}, "effects": effects}}
    found = brdf_record(**kept)
    assert found.packed and found.rendering.choices == {"mode": "exact"}
    (effect,) = found.rendering.effects
    assert (effect.name, effect.kept, effect.why) == ("Mirror", True, "it shines")
    assert not brdf_record().packed and brdf_record(rendering=[]).rendering == brdf_record().rendering


# --- older bundles ----------------------------------------------------------------------------------------


def test_what_older_bundles_lack() -> None:
    """Schema 1 and 2: no choice, no offset, no grid of the residual, no albedo of the table, no preview."""
    table, residual = dict(BRDF["table"]), dict(BRDF["residual"])
    for lacking in ("offset", "spline"):
        del table[lacking]
    del residual["offset"], residual["grid"]
    absent = dict.fromkeys(("choice", "search", "table_albedo", "rms_by_filter", "preview", "color_difference"))
    found = brdf_record(schema=1, table=table, residual=residual, **absent)
    assert found.table.offset == 0 and found.table.spline == "none" and found.residual is not None
    assert found.residual.grid == found.table.grid and found.residual.offset == 0
    assert found.candidates == () and found.search is None and found.table_albedo is None
    assert found.preview is None and found.rms_by_filter == {} and found.color_differences == {}
    bare = brdf_record(schema=1, envelope=None, residual=None)
    assert bare.envelope is None and bare.residual is None
    with pytest.raises(BakeError, match="felt: 'residual' is missing"):
        bare.stored("residual")


def test_what_older_shading_maps_lack() -> None:
    document = changed(SHADING_MAP, f_r=None, tiling=None, lobe_fit=None, warnings=None)
    document["errors"]["held_out_relative"] = None
    del document["map"]["means"]
    found = ShadingMapRecord.parse(document, "swatch")
    assert found.map.means is None and found.tiling is None and found.lobe_fit is None
    assert found.photographs.warnings == () and found.measured_lobe().albedo is None
    assert found.errors.held_out_relative is None and found.errors.held_out == 0
    for key in ("table", "sampler"):
        del document[key], document["images"][key]
    with pytest.raises(BakeError, match="swatch: holds no measured BRDF"):
        ShadingMapRecord.parse(document, "swatch").measured_lobe()


def test_where_the_shares_of_a_lamp_lie() -> None:
    """As the kind of table has it; widths and half turns are those of the sampler."""
    assert brdf_record().share_layout == ShareLayout()
    folded = BrdfRecord.parse(ANISOTROPIC, "brushed").share_layout
    assert folded == SlopeShareLayout(SlopeLayout(8, 8, 16, 16, 0.05, 0.2, True)) and folded.size == (128, 128)
    turning = {**ANISOTROPIC["sampler"], "folded": False}
    whole = BrdfRecord.parse(changed(ANISOTROPIC, sampler=turning), "brushed").share_layout
    assert whole == SlopeShareLayout(SlopeLayout(8, 16, 16, 16, 0.05, 0.2)) and whole.size == (128, 256)


def test_a_document_has_no_pixels() -> None:
    for load in (brdf_record().load_table, brdf_record().load_envelope, brdf_record().check_shares):
        with pytest.raises(BakeError, match="felt: has no images of its own"):
            load()


# --- wrong documents --------------------------------------------------------------------------------------

Change = Callable[[dict[str, Any]], Any]
WRONG: list[tuple[str, Change, str]] = [
    ("isotropic", lambda d: d.update(kind="shading_map"), "kind 'shading_map' is not a BRDF"),
    ("isotropic", lambda d: d.pop("kind"), "'kind' is missing"),
    ("isotropic", lambda d: d.pop("source"), "'source' is missing"),
    ("isotropic", lambda d: d["source"].update(name=3), "'name' is not a text"),
    ("isotropic", lambda d: d.update(settings=None), "'settings' is not an object"),
    ("isotropic", lambda d: d["settings"].update(resolution=True), "'resolution' is not a whole number"),
    ("isotropic", lambda d: d["settings"].update(alpha=[0.5, 2]), "'alpha' is 2.0, above 1"),
    ("isotropic", lambda d: d["settings"].update(storage="byte"), "'storage' is 'byte', not one of"),
    ("isotropic", lambda d: d["settings"].update(sampler={}), "'n_o' is missing"),
    ("isotropic", lambda d: d["settings"].update(resolution=3), "'resolution' cannot be 3"),
    ("isotropic", lambda d: d["settings"].update(basis="third"), "'basis' cannot be third"),
    ("anisotropic", lambda d: d["settings"].update(viewers=[6, 1]), r"'viewers' cannot be \(6, 1\)"),
    ("isotropic", lambda d: d.pop("table"), "'table' is missing"),
    ("isotropic", lambda d: d["table"].update(n=9), "table is 40 x 60 texels, not "),
    ("isotropic", lambda d: d["table"].update(n=257), "'n' is 257, above 256"),
    ("isotropic", lambda d: d["table"].update(alpha_phi=-1), "'alpha_phi' is -1.0, below 0"),
    ("isotropic", lambda d: d["table"].update(horizon_share="low"), "'horizon_share' is not a number"),
    ("isotropic", lambda d: d["table"].update(parameterization="spiral"), "'parameterization' is 'spiral'"),
    ("isotropic", lambda d: d["table"].update(parameterization="fitted"), "'warps' is missing"),
    ("isotropic", lambda d: d["table"].update(basis="half"), "'sizes' is missing"),
    ("isotropic", lambda d: d["table"].update(anisotropic=True), "'shape' is missing"),
    ("isotropic", lambda d: d["table"].update(filter="lanczos"), "'filter' is 'lanczos'"),
    ("isotropic", lambda d: d["table"].update(spline="loose"), "'spline' is 'loose'"),
    ("isotropic", lambda d: d["table"].update(storage="float32"), "'table' is stored as half, and the table as float"),
    ("isotropic", lambda d: d["table"].update(scale=0), "'scale' is 0.0, below"),
    ("isotropic", lambda d: d["table"].update(offset=2), "'offset' is 2.0, above 1"),
    ("isotropic", lambda d: d["residual"].update(scale=1e99), "'scale' is 1e.99, above"),
    ("isotropic", lambda d: d["residual"]["grid"].update(n=7), "residual is 40 x 60 texels"),
    ("isotropic", lambda d: d["residual"]["errors"].update(envelope_and_residual={}), "'rms' is missing"),
    ("isotropic", lambda d: d["sampler"].update(n_o=5), "sampler is 8 x 4 texels, not 8 x 5"),
    ("isotropic", lambda d: d["sampler"].update(warp_power=5), "'warp_power' is 5, above 4"),
    ("isotropic", lambda d: d["errors"].update(rms="none"), "'rms' is not a number"),
    ("isotropic", lambda d: d["errors"].update(rms=float("nan")), "'rms' is not a number"),
    ("isotropic", lambda d: d["errors"].update(directions=1.5), "'directions' is not a whole number"),
    ("isotropic", lambda d: d.update(rms_by_filter={"nearest": "x"}), "'nearest' is not a number"),
    ("isotropic", lambda d: d["color_difference"].update(exact=1), "'exact' is not an object"),
    ("isotropic", lambda d: d["color_difference"]["table"].update(p95=-1), "'p95' is -1"),
    ("isotropic", lambda d: d["search"].pop("by_intensity"), "'by_intensity' is missing"),
    ("isotropic", lambda d: d["search"].update(intensity_finds_least_error=1), "is not true or false"),
    ("isotropic", lambda d: d["choice"].update(candidates=[]), "the length of 'candidates' is 0, below 1"),
    ("isotropic", lambda d: d["choice"].update(candidates=[3]), "'candidates' lists something that is no object"),
    ("isotropic", lambda d: d["albedo"].update(directional=[]), "'albedo': the length of 'directional' is 0, below 2"),
    ("isotropic", lambda d: d["albedo"].update(directional=[[1, 1]] * 2), "'albedo': the length of 'directional'"),
    ("isotropic", lambda d: d["albedo"].update(above_one_deg=7), "'albedo': 'above_one_deg' is not a list"),
    ("isotropic", lambda d: d["table_albedo"].update(largest=None), "'table_albedo': 'largest' is not a number"),
    ("isotropic", lambda d: d["envelope"].update(share=1.1), "'share' is 1.1, above 1"),
    ("isotropic", lambda d: d["envelope"].update(by_theta_o_deg=[[1]]), "the length of 'by_theta_o_deg' is 1, below 2"),
    ("isotropic", lambda d: d["envelope"].update(nodes=2), "'nodes' is 2, below 4"),
    ("isotropic", lambda d: d["envelope"].update(closures=[{"name": "velvet"}]), "'name' is 'velvet'"),
    ("isotropic", lambda d: d["envelope"].update(closures=[{"name": "lambert"}] * 2), "holds a closure twice"),
    ("isotropic", lambda d: d["preview"].update(closures=[{"name": "lambert", "n": 1}]), "has no parameter n"),
    ("isotropic", lambda d: d["preview"].update(error=-1), "'error' is -1.0, below 0"),
    ("isotropic", lambda d: d["images"].update(table=1), "'table' is not an object"),
    ("isotropic", lambda d: d["images"]["table"].update(storage="log"), "'storage' is 'log', not one of"),
    ("isotropic", lambda d: d["images"]["table"].update(file_bytes=-1), "'file_bytes' is -1, below 0"),
    ("anisotropic", lambda d: d["table"].update(shape=[4, 4, 8]), "the length of 'shape' is 3, below 4"),
    ("anisotropic", lambda d: d["table"].update(shape=[4, 4, 8, True]), "'shape' is not a whole number"),
    ("anisotropic", lambda d: d["table"].update(shape=[1024] * 4), "would need a texture"),
    ("anisotropic", lambda d: d["table"].update(width_x=0), "'width_x' is 0.0, below"),
    ("anisotropic", lambda d: d["table"].update(folded=0), "'folded' is not true or false"),
    ("anisotropic", lambda d: d["table"].update(basis="normal", shape=[4, 4, 8, 9]), "has an odd azimuth"),
    ("anisotropic", lambda d: d["table"].pop("log"), "'log' is missing"),
    ("anisotropic", lambda d: d["residual"]["log"].update(gain=[1, 1e36, 1]), "'residual.log' stands for values above"),
    ("anisotropic", lambda d: d["settings"].update(viewers=[6]), "the length of 'viewers' is 1, below 2"),
    ("anisotropic", lambda d: d["sampler"].update(n_x=0), "'n_x' is 0, below 1"),
    ("anisotropic", lambda d: d["envelope"]["closures"][1].update(alpha_x=5), "'alpha_x' is 5.0, above 1"),
    ("anisotropic", lambda d: d["envelope"].update(n_phi=1), "'n_phi' is 1, below 2"),
    ("anisotropic", lambda d: d["search"]["best"]["half"].update(rms=None), "'rms' is not a number"),
    ("shading map", lambda d: d.update(kind="brdf"), "kind 'brdf' is not a shading map"),
    ("shading map", lambda d: d["map"].update(model="neural"), "'model' is 'neural'"),
    ("shading map", lambda d: d["map"].update(model="basis"), "'curves' is missing"),
    ("shading map", lambda d: d["map"].update(model="power"), "'power' is missing"),
    ("shading map", lambda d: d["map"].update(slices=5, means=None), "slices is 20 x 72 texels, not 20 x 96"),
    ("shading map", lambda d: d["map"].update(gutter=0), "'gutter' is 0, below 4"),
    ("shading map", lambda d: d["map"].update(level_by_cosine=["a"] * ANGLES), "'level_by_cosine' is not a number"),
    ("shading map", lambda d: d["map"].update(envelope_energy=2), "'envelope_energy' is 2.0, above"),
    ("shading map", lambda d: d["map"].update(means=[[1, 1, 1]]), "the length of 'means' is 1, below 4"),
    ("shading map", lambda d: d["averages"].update(before=[]), "the length of 'before' is 0, below 1"),
    ("shading map", lambda d: d["errors"].update(storage_rms=-1), "'storage_rms' is -1.0, below 0"),
    ("shading map", lambda d: d["errors"].update(held_out=3), "'held_out' is not a list"),
    ("shading map", lambda d: d.update(tiling={"seams": 1}), "'seams' is not an object"),
    ("shading map", lambda d: d.update(lobe_fit={"lobe": 3}), "'lobe' is not an object"),
    ("shading map", lambda d: d["render"].update(sigma=-1), "'sigma' cannot be -1.0"),
    ("shading map", lambda d: d["render"].update(lobe={"name": "ggx", "alpha": 7}), "'alpha' is 7.0, above 1"),
    ("shading map", lambda d: d["render"].update(tiling="fold"), "'tiling' is 'fold'"),
    ("shading map", lambda d: d["albedo"].pop("sigma"), "'sigma' is missing"),
    ("shading map", lambda d: d["f_r"].update(albedo=11), "'albedo' is 11.0, above 10"),
    ("shading map", lambda d: d["images"]["envelope"].update(channels=1), "envelope is 20 x 16 texels"),
    ("shading map", lambda d: d["table"].update(**SLOPES), "from an anisotropic BRDF"),
]
ANGLES = len(SHADING_MAP["map"]["level_by_cosine"])
SLOPES = {"anisotropic": True, **AnisotropicHalfGrid((4, 4, 8, 8)).facts()}


@pytest.mark.parametrize(("kind", "change", "word"), WRONG, ids=[f"{kind}-{word}" for kind, _, word in WRONG])
def test_wrong_documents(kind: str, change: Change, word: str) -> None:
    record, document = KINDS[kind][0], changed(KINDS[kind][1])
    change(document)
    with pytest.raises(BakeError, match=word) as caught:
        record.parse(document, "place")
    assert "\n" not in str(caught.value)


def paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where every object, list and value of a document stands."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*path, key)
        if isinstance(item, dict | list):
            yield from paths(item, (*path, key))


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just(10**400),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_any_value_anywhere(kind: str, data: st.DataObject) -> None:
    """A record, or one clear error; and what was read stays what it was."""
    record, original = KINDS[kind]
    document = changed(original)
    place = data.draw(st.sampled_from(list(paths(original))))
    owner = document
    for key in place[:-1]:
        owner = owner[key]
    if data.draw(st.booleans()):
        del owner[place[-1]]
    else:
        owner[place[-1]] = data.draw(JSON_VALUES)
    before = repr(document)
    try:
        record.parse(document, "place")
    except BakeError as error:
        assert "\n" not in str(error) and len(str(error)) < 600
    assert repr(document) == before


def test_what_an_anisotropic_grid_tells_of_its_horizon() -> None:
    """Bundles of before have the samples at a third, one cosine and no fall to the horizon."""
    table = ANISOTROPIC["table"] | {"horizon_share": 0.02, "cosine_power": 2, "falling": True}
    grid = BrdfRecord.parse(ANISOTROPIC | {"table": table}, "brushed").table.grid
    assert grid == AnisotropicHalfGrid((4, 4, 8, 8), 0.1, 0.4, True, 0.02, 2, True)
    for key, value in (("horizon_share", 2), ("cosine_power", 3), ("falling", 1)):
        with pytest.raises(BakeError, match=key):
            BrdfRecord.parse(ANISOTROPIC | {"table": table | {key: value}}, "brushed")
