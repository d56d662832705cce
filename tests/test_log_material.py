"""Materials of 8-bit codes in Cycles, of nodes and OSL, against a quadrature of the table that their bundle holds.

The table is so coarse that interpolating its values instead of its codes is another material, which would be found.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.tables.table import Table
from measured_materials.nodes.material import build_material
from support.bundles import ANALYTIC
from support.osl import skip_without_osl
from support.scenes import furnace
from test_unbiased import FINDS, assert_unbiased, clean_blend, stage  # noqa: F401

SETTINGS = BakeSettings(
    resolution=5, basis="half", storage="log", parameterization="fitted", sampler=SamplerLayout(32, 32, 16)
)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    source = ANALYTIC["metallic paint"]
    return read_bundle(bake_source(source, tmp_path_factory.mktemp("log") / "paint", SETTINGS).path)


def values_alone(table: Table) -> Table:
    """The same samples, interpolated as values."""
    return Table(table.grid, table.values)


@pytest.mark.parametrize(
    ("mode", "osl"),
    [
        pytest.param("reference", False, marks=pytest.mark.slow),
        ("exact", False),
        pytest.param("reference", True, marks=pytest.mark.slow),
        ("exact", True),
    ],
)
def test_a_material_is_its_table(bundle: Bundle, mode: str, osl: bool) -> None:
    """Four modes have two kinds of lookup: the table's, one slice at random, and the residual's, two blended."""
    if osl:
        skip_without_osl()
    with stage("sky" if mode == "reference" else "small lamp") as lit:
        assert_unbiased(bundle, lit, mode, osl=osl)


def test_values_interpolated_would_be_found(bundle: Bundle) -> None:
    """The instrument distinguishes codes from values."""
    table = BrdfRecord.read(bundle).load_table()
    with stage("sky") as lit:
        right, wrong = (lit.truth(t.evaluate)[lit.mask] for t in (table, values_alone(table)))
    assert np.abs(wrong - right).mean() > 1.5 * FINDS * right.mean()


def test_black_stays_black(tmp_path: Path) -> None:
    """A channel without light in the table shows none, where half floats once made some of their own."""
    source = type(ANALYTIC["phenolic"])(diffuse=(0.4, 0.0, 0.2), specular=(0.05, 0.0, 0.05), alpha=0.2)
    settings = BakeSettings(resolution=12, storage="log", sampler=SamplerLayout(16, 16, 8))
    bundle = read_bundle(bake_source(source, tmp_path / "black", settings).path)
    with furnace(build_material(bundle, mode="reference"), resolution=16) as scene:
        for mode in ("reference", "exact"):
            scene.show(build_material(bundle, mode=mode))
            seen = scene.render(16, 1)[:, scene.mask()]
            assert (seen[..., 1] == 0).all() and seen[..., 0].mean() > 0.2


def test_four_modes_build(bundle: Bundle) -> None:
    """Also when the textures are packed; the atlas is bytes, its data untouched."""
    for mode in ("preview", "balanced", "exact", "reference"):
        material = build_material(bundle, mode=mode, pack=True)
        images = {i.name: i for i in bpy.data.images if "residual" in i.name or "table" in i.name}
        for image in images.values():
            assert image.colorspace_settings.name == "Non-Color" and image.alpha_mode == "CHANNEL_PACKED"
        assert material.node_tree is not None
    atlas = next(i for i in bpy.data.images if i.name.endswith("paint table"))
    pixels = np.empty(len(atlas.pixels), np.float32)
    atlas.pixels.foreach_get(pixels)
    stored = bundle.load("table")[::-1]
    assert not atlas.is_float and np.array_equal(pixels.reshape(*stored.shape[:2], 4)[..., :3], stored)


def test_from_bake_to_render(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Baked, reported by `inspect`, and rendered."""
    options = ["--resolution", "6", "--storage", "log", "--sampler", "16", "--parameterization", "uniform"]
    assert main(["bake", "brdf", "--analytic", "ggx", "alpha=0.4", "--out", str(tmp_path), *options]) == 0
    pictures = {p.stem.rsplit("_")[-1] for p in (tmp_path / "ggx.mmat").glob("*.png")}
    assert pictures == {"table", "residual", "preview"}
    capsys.readouterr()
    assert main(["inspect", str(tmp_path / "ggx.mmat")]) == 0
    told = capsys.readouterr().out
    assert "trilinear, log" in told and " byte" in told
    picture = tmp_path / "ggx.png"
    size = ["--samples", "1", "--resolution", "16"]
    assert main(["render", str(tmp_path / "ggx.mmat"), "--out", str(picture), *size]) == 0 and picture.is_file()
