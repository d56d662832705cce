"""What a report measures: tables of three and four axes, shading maps as stored, and expressions in renders."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.report import lookups, render_timing
from measured_materials.addon.report import maps as report_maps
from measured_materials.addon.report import pictures as report_pictures
from measured_materials.addon.report.lobe_timing import measure_rendered
from measured_materials.addon.report.render_timing import Effort
from measured_materials.addon.studio.studio import render_linear
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.report import maps, tables, tabulation
from measured_materials.bake.report.journal import Journal
from measured_materials.bake.report.lobes import BARE_POWER
from measured_materials.bake.shading_maps.shading_map import at_level, averages_of, linearise
from measured_materials.bake.shading_maps.slice_atlas import GUTTER
from measured_materials.bake.sources.analytic import Ggx
from measured_materials.bake.tables.atlas import AtlasLayout
from measured_materials.bake.tables.table import FILTERS
from measured_materials.nodes import expr

TINY = Effort(16, 2, 1)


def test_tables_of_four_axes_are_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tabulation, "CHOSEN_AT", 12)
    monkeypatch.setattr(tabulation, "_TURNED_PAIRS", 2048)
    source = Ggx(alpha=0.15, alpha_y=0.4)
    sizes = tables.TableSizes((8, 16), False)
    found = tables.measure_tables(source, Journal(tmp_path / "j", {}), sizes, lambda _: None)
    assert {(s.basis, s.parameterization) for s in found.settings} == set(tabulation.ANISOTROPIC_KINDS)
    # Brushing is a ridge in half vectors, which the normal-vector basis meets askew (`bench anisotropic`).
    assert found.auto[0] == "half"
    usual = {(s.basis, s.resolution): s for s in found.settings if s.filter == "trilinear" and s.storage == "half"}
    assert usual["half", 16].rms < 0.7 * usual["half", 8].rms and usual["half", 16].bytes > usual["half", 8].bytes
    title = tables.tables_section("brushed", found).charts[1].title
    assert "half-vector, slopes" in title


@pytest.mark.parametrize(
    "kind, anisotropic",
    [*((kind, False) for kind in tabulation.KINDS), *((kind, True) for kind in tabulation.ANISOTROPIC_KINDS)],
)
def test_timed_lookups_are_whole(kind: tabulation.Kind, anisotropic: bool, tmp_path: Path) -> None:
    """A graph too large for Cycles would be timed as well, and show nothing: white tables must be seen as white."""
    grid = lookups._grid(kind, 8, anisotropic)
    four_halves = kind == ("half", "slopes")
    size = AtlasLayout.of(grid).size
    for storage, filter in [*((Storage.HALF, filter) for filter in FILTERS), (Storage.LOG, "trilinear")]:
        image = lookups._white(tmp_path / f"white{storage.suffix}", size, storage)
        group = lookups._group(f"Test {filter}", image, grid, filter, storage)
        with render_timing._plane(lambda place, group=group: lookups._looked_up(group, place), 8, False) as scene:
            pixels = render_linear(scene)
        # The half basis of four axes stores f times cosines: there a white table is above 1.
        expected = (pixels > lookups.LOOKUPS) if four_halves else np.isclose(pixels, lookups.LOOKUPS, 1e-4)
        assert expected.all(), (storage, filter, pixels.min(), pixels.max())


def test_timed_expressions_differ_by_their_own_work_alone() -> None:
    seen: list[float] = []

    def build(factor: float) -> render_timing.Build:
        return lambda place: expr.components(place)[0] * factor

    found = render_timing.evaluation_ns(
        {"a": build(2.0), "b": build(3.0)}, build(1.0), 1, TINY, progress=lambda share: seen.append(share)
    )
    assert set(found) == {"a", "b"} and min(found.values()) >= render_timing.LEAST_NS
    assert seen == sorted(seen) and 0 <= seen[0] and seen[-1] < 1


def test_lobes_without_osl_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise BakeError("Open Shading Language", "is not part of this Blender", "use nodes")

    monkeypatch.setattr("measured_materials.addon.report.lobe_timing.require_osl", refuse)
    found = measure_rendered(("cubic",), TINY, thorough=False)
    assert found.missing == "Open Shading Language is not part of this Blender"
    assert {column: set(times) for column, times in found.ns.items()} == {"nodes, n varies": {"cubic", BARE_POWER}}


# --- shading maps ---------------------------------------------------------------------------------------


def power_law_photographs(count: int = 12, size: int = 8) -> maps.Images:
    """Every texel answers to the light by a power of its own."""
    rng = np.random.default_rng(2)
    k, exponent = rng.uniform(0.3, 1.0, (size, size, 3)), rng.uniform(0.6, 1.8, (size, size, 3))
    levels = np.linspace(0.05, 1, count)[:, None, None, None]
    return (k * levels**exponent).astype(np.float32)


@pytest.mark.parametrize("model", maps.MODELS, ids=lambda model: model.name)
def test_stored_lookup_is_what_a_bundle_gives_back(model: maps.Model) -> None:
    made = linearise(power_law_photographs(), 8)
    lookup, size = maps.stored_lookup(made.map, model, Storage.FLOAT32)
    tiles = {"none": 7, "power": 2}.get(model.compression, model.rank)
    # Colours of each tile with its gutters, and the envelope with its share where there is one.
    assert size == 4 * 8 * ((8 + 2 * GUTTER) * 3 * tiles + (0 if model.compression == "power" else 8 * 4))
    truth = at_level(made.map, 0.6)
    off = float(np.sqrt(np.square(lookup(0.6) - truth).mean() / np.square(truth).mean()))
    # Slices come back to rounding; one curve for all texels cannot follow powers of 0.6 to 1.8.
    assert off < {"slices": 1e-5, "1 curve": 0.3}.get(model.name, 0.05)


def test_maps_are_measured_at_photographs_they_do_not_hold(tmp_path: Path) -> None:
    images = power_law_photographs()
    sizes = maps.MapSizes((3, 8), (3,), (Storage.FLOAT32, Storage.BYTE), 4)
    found = maps.measure_maps("p", images, Journal(tmp_path / "j", {}), sizes, lambda _: None)
    by = {(s.model, s.slices, s.storage): s for s in found}
    assert by["slices", 8, "float32"].error < by["slices", 3, "float32"].error
    assert by["slices", 8, "float32"].error <= by["slices", 8, "byte"].error * 1.01
    assert ("power law", 8, "byte") not in by and ("3 curves", 3, "float32") not in by
    # By hand: photograph 5 from the others.
    rest = linearise(np.delete(images, 5, axis=0), 8)
    lookup, _ = maps.stored_lookup(rest.map, maps.MODELS[0], Storage.FLOAT32)
    off = lookup(averages_of(images)[5] / rest.a_max) * rest.a_max - images[5]
    # The parts leave out neighbours too far away to matter much: a factor of 3 holds for all of them.
    assert float(np.sqrt(np.square(off).mean() / np.square(images[5]).mean())) < 3 * by["slices", 8, "float32"].error
    assert "slices" in maps.maps_section("p", found, len(images)).words[1].lower()


def test_every_model_is_timed(tmp_path: Path) -> None:
    sizes = maps.MapSizes((3, 4), (4,), (Storage.HALF,), 2)
    journal = Journal(tmp_path / "j", {})
    times = report_maps.measure_map_times("p", power_law_photographs(), journal, sizes, TINY, lambda _: None)
    assert set(times) == {(model.name, 4, "half") for model in maps.MODELS}


def test_the_closest_picture_is_of_those_that_render_makes_unasked() -> None:
    """Denoised below 256 samples and not from there on; Principled and Reference are nothing that `render` denoises."""
    errors = {
        "Principled BSDF": (0.01, 0.01),
        "reference": (0.02, 0.02),
        "preview": (0.1, 0.09),
        "preview, denoised": (0.06, 0.04),
        "exact": (0.2, 0.05),
        "exact, denoised": (0.05, 0.03),
        report_pictures.SAMPLED: (0.15, 0.07),
    }
    rows = [
        report_pictures.Rendered(variant, samples, 1.0, error)
        for variant, found in errors.items()
        for samples, error in zip((64, 256), found)
    ]
    usual = report_pictures.as_rendered(rows)
    shown = {(row.variant, row.samples) for row in usual}
    of_few = {("preview, denoised", 64), ("exact, denoised", 64), (report_pictures.SAMPLED, 64)}
    assert shown == of_few | {("preview", 256), ("exact", 256), (report_pictures.SAMPLED, 256)}
    best = report_pictures.closest(usual)
    assert {samples: (row.variant, row.error) for samples, row in best.items()} == {
        64: ("exact, denoised", 0.05),
        256: ("exact", 0.05),
    }
    note = report_pictures.pictures_section("paint", rows, []).notes[-1]
    assert "at 64 samples exact, denoised (5.00%), at 256 samples exact (5.00%)" in note
