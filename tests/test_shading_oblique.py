"""Shading maps seen from every elevation: against a quadrature of the direct light, most of all with a measured f_r.

At the middle of a picture the viewer stands at the normal, where a lookup with light and viewer confused, or with the
viewer forgotten, is right. Here every pixel that the sphere fills counts, and the light comes from aside.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.shading_maps.shading_map import ShadingMap, linearise
from measured_materials.bake.sources import analytic
from measured_materials.nodes.shading_map_material import build_shading_map, lighting_of
from support.direct_light import Array, Brdf
from support.monte_carlo import assert_agree
from support.swatches import map_bundle
from test_unbiased import FINDS, clean_blend, stage  # noqa: F401

LEVELS = np.linspace(0, 1, 6)
# Of a swatch of one texel: red answers as the root, green in proportion, blue as the square.
RESPONSE = np.stack([LEVELS**0.5, LEVELS, LEVELS**2], -1) * [0.9, 1.0, 1.2]
PHOTOGRAPHS = np.broadcast_to(RESPONSE[1:, None, None], (5, 4, 4, 3)).astype(np.float32)
SAMPLER = SamplerLayout(n_o=24, n_h=24, n_phi=12)


def lit(f_r: Brdf, render: tuple[float, float, str], response: Array = RESPONSE) -> Brdf:
    """a_max S(sigma f_r cos / a_max) / cos, channel by channel, beyond the last slice held or in proportion.

    Parameters
    ----------
    render : sigma, a_max and "clamp" or "scale"
    response : (6, 3), S at `LEVELS`
    """
    sigma, a_max, above = render

    def brdf(wi: Array, wo: Array) -> Array:
        cosine = np.maximum(wi[..., 2:], 1e-6)
        x = sigma / a_max * np.broadcast_to(f_r(wi, wo), wi.shape) * cosine
        held = np.minimum(x, 1)
        value = np.stack([np.interp(held[..., c], LEVELS, response[:, c]) for c in range(3)], -1)
        return a_max / cosine * value * (np.maximum(x, 1) if above == "scale" else 1)

    return brdf


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """The swatch with a coloured, glossy f_r of a table."""
    folder = tmp_path_factory.mktemp("oblique")
    source = analytic.ModifiedPhong(diffuse=(0.3, 0.2, 0.1), specular=(0.1, 0.2, 0.4), exponent=12)
    settings = BakeSettings(resolution=24, alpha=(0.5, 0.3), envelope=False, sampler=SAMPLER, storage=Storage.FLOAT32)
    table = bake_source(source, folder / "f_r", settings)
    stack = PhotoStack(PHOTOGRAPHS, tuple("abcde"), None, False, ())
    render = RenderSettings(None, sigma=0.8, a_max=0.12, mode="reference")
    arc = ArcSettings(slices=6, storage=Storage.FLOAT32, brdf=table.path, render=render)
    return read_bundle(bake_stack(stack, folder / "both", arc).path)


@pytest.mark.parametrize("light", ["small lamp", "sky"])
def test_measured_f_r_from_every_elevation(measured: Bundle, light: str) -> None:
    record = ShadingMapRecord.read(measured)
    lighting = lighting_of(record, record.render)
    # A photograph's level is its mean over the channels: the slices of this stack lie elsewhere than its photographs.
    response = linearise(PHOTOGRAPHS, len(LEVELS)).map.slices[:, 0, 0]
    render = lighting.sigma, lighting.a_max, lighting.settings.above
    truth = lit(record.baked_lobe().load().evaluate, render, response)
    with stage(light) as shown:
        shown.scene.show(build_shading_map(measured, lamps=lamp_image()))
        found = shown.judged(shown.truth(truth))
    print(found)
    assert_agree(found, FINDS)


@pytest.mark.parametrize(
    "lobe, above",
    [
        pytest.param(Lobe("phong", 12.0, 0.4), "scale", id="phong"),
        pytest.param(Lobe("ggx", 0.4), "clamp", id="ggx", marks=pytest.mark.slow),
    ],
)
def test_formula_from_every_elevation(tmp_path: Path, lobe: Lobe, above: str) -> None:
    """Exact: envelope, closure and mirror together, beyond the brightest photograph too."""
    a_max = 0.6 * float(lobe.peak(np.array([0.0, 0.0, 1.0])))
    slices = np.broadcast_to(RESPONSE[:, None, None], (6, 2, 2, 3)).astype(np.float32)
    render = RenderSettings(lobe, sigma=0.8, a_max=a_max, above=above)
    bundle = map_bundle(tmp_path / "formula", ShadingMap(slices), render)
    truth = lit(lambda wi, wo: lobe.value(wi, wo)[..., None], (0.8, a_max, above))
    with stage("small lamp") as shown:
        shown.scene.show(build_shading_map(bundle, lamps=lamp_image()))
        found = shown.judged(shown.truth(truth))
    print(found)
    assert_agree(found, FINDS)
