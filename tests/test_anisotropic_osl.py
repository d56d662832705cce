"""The OSL twin of anisotropic materials: its functions on cards, and the whole material against that of nodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.directions import spherical
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.cell_sampler import build_sampler
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.slope_cells import SlopeLayout
from measured_materials.bake.source import Array
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.atlas import pack
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.bake.tables.table import FILTERS
from measured_materials.nodes.group import trees_below
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from support.coarse_bakes import coarse_bakes
from support.monte_carlo import assert_same
from support.osl import declared_table, header_card, skip_without_osl
from support.planes import SHAPES, plane_scene
from test_anisotropic_cards import BRUSHED, GRIDS, away_from_borders, directions, random_table


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


def lookup_body(file: Path, grid: Grid, filter: str, log: str = "vector(0), vector(0)") -> str:
    """Statements that look a table's file up; `log` are the range and gain of codes."""
    return declared_table(grid, file, filter, log) + "value = vector(mm_lookup(table, g, wi, wo, 0.5));"


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("filter", FILTERS)
def test_lookup(tmp_path: Path, name: str, filter: str) -> None:
    grid = GRIDS[name]
    table, file = random_table(grid), tmp_path / "atlas.exr"
    write_image(file, pack(grid, table.values), Storage.FLOAT32)
    wi, wo = directions(3000)
    (found,) = header_card(lookup_body(file, grid, filter), {"value": "vector"}, wi=wi, wo=wo)
    wi, wo = wi.astype(float), wo.astype(float)
    factor = np.broadcast_to(grid.factor(xp_numpy, wi, wo), len(wi))
    off = np.abs(found - table.evaluate(wi, wo, filter)).max(-1) * factor
    position = np.stack(grid.coordinates(xp_numpy, wi, wo), -1)
    if filter == "nearest":
        off = off[(np.abs(position - np.floor(position) - 0.5) > 1e-3).all(-1)]
    # As for the nodes, `test_anisotropic_cards.py`; OSL's arctangent, corrected, keeps 1e-7 of a turn.
    assert np.quantile(off, 0.99) < 3e-4 and np.median(off) < 3e-5


@pytest.mark.parametrize("folded", [False, True])
def test_sampler(tmp_path: Path, folded: bool) -> None:
    layout = SlopeLayout(6, 8, 14, 12, 0.1, 0.4, folded)
    sampler, file = build_sampler(BRUSHED, layout), tmp_path / "slopes.exr"
    write_image(file, sampler.texels, Storage.FLOAT32)
    facts = f'"{file}", 6, 8, 12, 14, 0, 0.1, 0.4, {int(folded)}, 0, 1'
    body = f"""
      MMSampler slopes = {{{facts}}};
      wi = mm_draw(slopes, wo, first[0], first[1], first[2], last, pdf);
      density = mm_density(slopes, wi, wo);"""
    rng = np.random.default_rng(5)
    count = 3000
    wo = spherical(np.arccos(rng.random(count)), rng.uniform(-np.pi, np.pi, count)).astype(np.float32)
    u = rng.random((count, 4)).astype(np.float32)
    keep = away_from_borders(sampler, wo, u)
    wo, u = wo[keep], u[keep]
    outputs = {"wi": "vector", "pdf": "float", "density": "float"}
    wi, pdf, density = header_card(body, outputs, wo=wo, first=u[:, :3], last=u[:, 3])
    expected, expected_pdf = sampler.sample(wo.astype(float), u.astype(float))
    assert np.quantile(np.abs(wi - expected).max(-1), 0.98) < 4e-6
    up = expected[:, 2] > 0.01
    for found in (pdf, density):
        off = np.abs(found / expected_pdf - 1)[up]
        # At the edge of a cell either of two is right.
        assert np.median(off) < 1e-6 and np.quantile(off, 0.98) < 1e-4


@pytest.fixture(scope="module")
def satin(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A coarse table, and few viewers: the twins share them."""
    source = analytic.Ward(alpha=0.2, alpha_y=0.5, diffuse=(0.3, 0.2, 0.1), specular=0.4)
    settings = BakeSettings(16, sampler=SamplerLayout(16, 16, 16), basis="half", viewers=(6, 3))
    out = tmp_path_factory.mktemp("satin") / "satin"
    with coarse_bakes():
        return read_bundle(bake_source(source, out, settings).path)


def both(bundle: Bundle, mode: str, samples: int, seeds: int) -> tuple[Array, Array, Array]:
    """Pictures (K, H, W, 3) of the material of nodes and of its twin, and the mask (H, W)."""
    pictures = []
    for build in (build_material, build_osl_material):
        with plane_scene(build(bundle, mode=mode), SHAPES["turned"], applied=False) as scene:
            if build is build_osl_material:
                use_osl(scene.scene)
            pictures.append(scene.render(samples, seeds))
            mask = scene.mask()
    return pictures[0], pictures[1], mask


@pytest.mark.slow
def test_material_equals_that_of_nodes(satin: Bundle) -> None:
    """With its mirror, whose random numbers are others; a planted 2 % is found."""
    assert_same(*both(satin, "exact", 448, 6), 0.0, 0.01)


def test_preview_is_the_same_picture(satin: Bundle) -> None:
    """Closures alone draw no random number of ours: only float32 and rare decisions on its last bits differ."""
    nodes, osl, mask = both(satin, "preview", 4, 1)
    off = np.abs(osl - nodes)[:, mask] > 1e-4 * np.maximum(nodes[:, mask], 1e-3)
    assert off.mean() < 1e-3 and nodes[:, mask].min() > 0


@pytest.mark.parametrize("mode", ["exact", "balanced", "reference"])
def test_a_material_that_aims_is_built(satin: Bundle, mode: str) -> None:
    """With every parameter that describes lamps, those that only an isotropic material reads included."""
    material = build_osl_material(satin, mode=mode, lamps=lamp_image())
    scripts = [n for tree in trees_below(material.node_tree) for n in tree.nodes if n.bl_idname == "ShaderNodeScript"]
    assert {script.script.name: script.outputs[0].name for script in scripts} == {
        "measured_world.osl": "Place",
        "measured_aim.osl": "Direction",
        "measured_material.osl": "BSDF",
    }
    assert {link.to_socket.identifier for link in scripts[0].id_data.links} >= {"Tangent", "Strongest", "Centre4"}
