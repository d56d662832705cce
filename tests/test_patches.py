"""Tables over the patches of a matrix: the matrix itself, in numpy, nodes, OSL and a bundle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.scene_fit import plan_filter
from measured_materials.addon.summary.brdf_rows import table_rows
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.directions import polar_angle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.patches import KLEMS, PatchBasis
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import SHEET_PARTS, Array, SheetSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.sources.lookup.lookup_source import LookupSource
from measured_materials.bake.tables.accuracy import direction_pairs
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.grids.patch_grid import PatchGrid
from measured_materials.bake.tables.search.grid_search import BASES, choose_grid
from measured_materials.bake.tables.sheet import sheet_views
from measured_materials.bake.tables.table import Table
from measured_materials.nodes.group import call
from measured_materials.nodes.osl_parts import table_constants
from measured_materials.nodes.table_groups import table_groups
from measured_materials.nodes.table_lookup_group import table_lookup_group
from support.cards import card, data_image
from support.coarse_bakes import coarse_bakes
from support.osl import declared_table, header_card, skip_without_osl
from support.sheet_files import write_klems_sheet
from test_anisotropic_cards import directions
from test_sheets import KLEMS as SIDES
from test_sheets import OneWay

FULL = KLEMS["klems full"]


def inside(patches: PatchBasis, *directions: Array) -> Array:
    """Which pairs (n, 3) keep clear of every border of patches by 1e-4 of a radian or of a patch."""
    clear = np.ones(len(directions[0]), bool)
    bounds = np.radians(patches.bounds[:-1])
    for w in directions:
        theta = polar_angle(w)
        number = np.array(patches.azimuths)[np.searchsorted(bounds, theta, side="right")]
        place = np.arctan2(w[:, 1], w[:, 0]) / (2 * np.pi) * number
        clear &= (np.abs(theta[:, None] - bounds) > 1e-4).all(-1)
        clear &= (number == 1) | (np.abs(place - np.floor(place) - 0.5) > 1e-4)
    return clear


def noise(name: str) -> Table:
    """White noise over the patches of this name."""
    grid = PatchGrid(name)
    return Table(grid, np.random.default_rng(3).random((*grid.shape, 3)).astype(np.float32), filter="nearest")


@pytest.mark.parametrize("name", KLEMS)
def test_patches_are_those_of_the_reader_in_every_frame_that_sheets_are_seen_in(name: str) -> None:
    patches, grid = KLEMS[name], PatchGrid(name)
    w, _ = directions(4000)
    w = w[inside(patches, w)].astype(float)
    bins = patches.bins(w)
    np.testing.assert_array_equal(patches.index(xp_numpy, w), bins)
    assert set(bins) == set(range(patches.count))
    # Along the axes, the signs of zero included, and straight on.
    theta = np.radians([0.0, 2.0, 20.0, 40.0])[:, None]
    axes = np.array([(1.0, 0.0), (-1.0, 0.0), (-1.0, -0.0), (0.0, 1.0), (-0.0, -1.0)])
    up = np.broadcast_to(np.cos(theta)[..., None], (4, 5, 1))
    straight = np.concatenate([np.sin(theta)[..., None] * axes, up], -1)
    straight = straight.reshape(-1, 3)
    np.testing.assert_array_equal(patches.index(xp_numpy, straight), patches.bins(straight))
    np.testing.assert_array_equal(patches.bins(patches.centres()), np.arange(patches.count))
    for turn in ([-1.0, -1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]):
        turned = patches.bins(w * turn)
        # A patch becomes a whole patch: one number goes to one number.
        assert len(set(zip(bins, turned, strict=True))) == patches.count
    wi, wo = grid.directions(*np.meshgrid(*map(np.arange, grid.shape), indexing="ij"))
    np.testing.assert_array_equal(patches.bins(wi.reshape(-1, 3))[: patches.count], np.arange(patches.count))
    np.testing.assert_array_equal(patches.bins(wo[0, :, 0, 0]), np.arange(patches.count))


@pytest.mark.parametrize("name", KLEMS)
@pytest.mark.parametrize("filter", ["nearest", "trilinear"])
def test_nodes_look_up_the_patch(name: str, filter: str) -> None:
    table, (wi, wo) = noise(name), directions(4000)
    clear = inside(KLEMS[name], wi, wo)
    image = data_image(f"patches {name}", pack(table.grid, table.values))
    group = table_lookup_group(f"patches {name} {filter}", image, table.grid, filter)
    (found,) = card(lambda a, b: call(group, a, b, 0.5), wi, wo)
    truth = table.evaluate(wi, wo)
    # Linear, a texture is read in the middle of a texel but for rounding: 2^-24 of up to 3000 texels.
    assert np.abs(found - truth)[clear].max() < (1e-6 if filter == "nearest" else 1e-3)


@pytest.mark.parametrize("name", KLEMS)
def test_the_osl_twin_looks_up_the_patch(name: str, tmp_path: Path) -> None:
    skip_without_osl()
    table, (wi, wo) = noise(name), directions(3000)
    clear = inside(KLEMS[name], wi, wo)
    write_image(tmp_path / "atlas.exr", pack(table.grid, table.values), Storage.FLOAT32)
    body = declared_table(table.grid, tmp_path / "atlas.exr", "nearest", "vector(0), vector(0)")
    (found,) = header_card(
        body + "value = vector(mm_lookup(table, g, wi, wo, 0.5));", {"value": "vector"}, wi=wi, wo=wo
    )
    assert np.abs(found - table.evaluate(wi, wo))[clear].max() < 1e-6


@pytest.fixture(scope="module")
def shade(tmp_path_factory: pytest.TempPathFactory) -> tuple[SheetSource, Bundle]:
    """A Klems file of which no two parts are alike, baked whole."""
    folder = tmp_path_factory.mktemp("shade")
    source = read_source(write_klems_sheet(folder / "shade.xml", OneWay(), SIDES))
    assert isinstance(source, SheetSource)
    settings = BakeSettings(8, sampler=SamplerLayout(16, 8, 16), viewers=(4, 4))
    with coarse_bakes():
        return source, read_bundle(bake_source(source, folder / "shade", settings).path)


def test_a_bundle_holds_the_matrix_of_every_part(shade: tuple[SheetSource, Bundle]) -> None:
    """Whatever the resolution: half floats are all that is lost, and what Cycles' closures leave is there too."""
    source, bundle = shade
    record = BrdfRecord.of(bundle)
    pairs = direction_pairs(3000, turned=True)
    clear = inside(FULL, pairs.wi, pairs.wo)
    views = {"front": source, **sheet_views(source)}
    for part in ("front", *SHEET_PARTS):
        found = record if part == "front" else record.part(part)
        assert found is not None and found.table.grid == PatchGrid("klems full")
        table = found.load_table()
        truth = views[part].evaluate(pairs.wi, pairs.wo)
        np.testing.assert_allclose(table.evaluate(pairs.wi, pairs.wo)[clear], truth[clear], rtol=1e-3)
        assert found.residual is not None and found.residual.grid == found.table.grid
    assert ("Table", "145 x 145 patches of the file, Klems Full") in table_rows(record)
    assert bundle.material["schema"] == 5


def test_a_basis_that_is_named_is_taken(shade: tuple[SheetSource, Bundle]) -> None:
    """And a source whose parts have different patches is tabulated as any other."""
    source, _ = shade
    assert choose_grid(source, 8).grid == PatchGrid("klems full")
    assert choose_grid(source, 8, ("half",)).grid.basis == "half"
    assert choose_grid(source, 8, BASES, "uniform").grid.basis == "normal"
    plain = LookupSource("plain", source.lookup, {}, False, False)
    assert choose_grid(plain, 8).grid.basis in BASES


def test_a_bundle_of_unknown_patches_is_refused(shade: tuple[SheetSource, Bundle]) -> None:
    material = shade[1].material
    table = {**material["table"], "parameterization": "tregenza"}
    with pytest.raises(BakeError, match="parameterization"):
        BrdfRecord.of(replace(shade[1], material={**material, "table": table}))


def test_a_material_looks_patches_up_unblended(shade: tuple[SheetSource, Bundle]) -> None:
    """Whatever filter is asked for: between patches there is nothing to blend."""
    _, bundle = shade
    table = BrdfRecord.of(bundle).baked()
    images = {name: bpy.data.images.new(name, 8, 8) for name in ("table", "sampler")}
    groups = table_groups(table, "patches", images.__getitem__, "bspline", False, aimed=False)
    taps = [n for n in groups.lookup.nodes if n.bl_idname == "ShaderNodeTexImage"]
    assert [tap.interpolation for tap in taps] == ["Closest"]


def test_no_shader_blends_patches(shade: tuple[SheetSource, Bundle]) -> None:
    """Whatever is asked for: in OSL as in nodes, and the panel says so."""
    record = BrdfRecord.of(shade[1])
    assert table_constants(record.baked(), "bspline")["Filter"] == "nearest"
    for filter in ("auto", "trilinear"):
        name, effect = plan_filter(record, Choices(mode="exact", filter=filter))
        assert name is None and not effect.kept and "nothing to blend" in effect.why
