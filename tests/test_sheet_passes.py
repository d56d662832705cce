"""A sheet's passes for the denoiser, bakes of its normal and roughness, and its mirrors' probability beside a lamp."""

# ruff: noqa: F811  (fixtures of other modules, asked for by their names)

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.rendering.denoising import plan_denoising
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.envelope import ShareLayout, part_of_light, share_coordinates
from measured_materials.bake.source import Array
from measured_materials.bake.sources.analytic import Ggx, ThinCloth
from measured_materials.bake.xp_numpy import normalize
from measured_materials.nodes import sheet_group
from measured_materials.nodes.feature_passes import albedo_polynomial
from measured_materials.nodes.lamp_share_group import LampShares, lamp_probability, lamp_side
from measured_materials.nodes.material import build_material
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.scenes import add_lamp
from support.sheet_scenes import (
    BEHIND,
    BELOW,
    LINED,
    SETTINGS,
    TURNED,
    record_of,
    sheet_scene,
    upper_hemisphere,
    viewer,
)
from test_denoiser_passes import denoiser_input
from test_lamp_share import SCENES, random_shares, reordered, shading_points, tap
from test_sheet_material import baked  # noqa: F401
from test_surface_marker import baked as baked_onto
from test_surface_marker import degrees_off, plane  # noqa: F401


def leaving(theta: float) -> Array:
    """Albedo (3,) of the side that such a viewer sees, by quadrature: reflected and let through together."""
    wi, wo = upper_hemisphere(), viewer(theta)[None]
    if theta > 90:
        wi = wi * TURNED
        return np.pi * (LINED.reflected_behind(wi, wo) + LINED.transmitted(wi * BELOW, wo)).mean(0)
    return np.pi * (LINED.evaluate(wi, wo) + LINED.transmitted(wi * BELOW, wo)).mean(0)


@pytest.mark.parametrize("theta", [20.0, 65.0, 130.0])
def test_passes_are_what_leaves_the_side_that_is_seen(baked: dict[str, BakeResult], theta: float) -> None:
    """In one sample a pixel, so that any noise would show."""
    material = build_material(record_of(baked["lined"]), mode="exact", lamps=lamp_image(), features=True)
    with sheet_scene(material, theta) as scene:
        scene.scene.cycles.samples = 1
        albedo, normal = (denoiser_input(scene, kind)[..., :3] for kind in ("Albedo", "Normal"))
        towards = np.array(scene.scene.camera.matrix_world.inverted().to_3x3() @ _facing(theta))
        towards *= (1, 1, -1)  # Cycles' cameras look along +z
    assert np.abs(albedo - leaving(theta)).max() < 0.03
    assert np.abs(normal - towards).max() < 1e-4


def _facing(theta: float) -> Any:
    """The sheet's normal on the viewer's side."""
    return Vector((0, 0, 1 if theta < 90 else -1))


def test_sides_that_are_alike_have_one_albedo(baked: dict[str, BakeResult]) -> None:
    assert len(albedo_polynomial(record_of(baked["white"]))) == 1
    front, back = albedo_polynomial(record_of(baked["lined"]))
    np.testing.assert_allclose(front[-1], leaving(0.0), atol=0.02)
    np.testing.assert_allclose(back[-1], leaving(180.0), atol=0.02)


def test_passes_do_not_touch_a_sheet_s_picture(baked: dict[str, BakeResult]) -> None:
    pictures = []
    for features in (False, True):
        material = build_material(record_of(baked["lined"]), mode="exact", features=features)
        with sheet_scene(material, 60.0) as scene:
            add_lamp(scene, "AREA", BEHIND, energy=300, size=3.0)
            pictures.append(scene.render(4, [1]))
    assert np.array_equal(*pictures)


def test_a_sheet_s_picture_is_denoised_where_samples_are_few(baked: dict[str, BakeResult]) -> None:
    record = record_of(baked["lined"])
    assert plan_denoising("auto", 16, record).done and plan_denoising("always", 4096, record).done


class Sateen:
    """A highlight in front, a duller back, and a little light through; grey."""

    name, isotropic, bilateral, alike = "sateen", True, True, False
    facts: dict[str, Any] = {}
    cloth = ThinCloth((0.0, 0.0, 0.0), (0.2, 0.2, 0.2), (0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
    shine = Ggx(0.3)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        return self.shine.evaluate(wi, wo) + 0.1 / np.pi

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        return self.cloth.reflected_behind(wi, wo)

    def transmitted(self, wi: Array, wo: Array) -> Array:
        return self.cloth.transmitted(wi, wo)


@pytest.fixture(scope="module")
def sateen(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    return record_of(bake_source(Sateen(), tmp_path_factory.mktemp("sateen") / "sateen", SETTINGS))


def test_bakes_of_normal_and_roughness(
    sateen: BrdfRecord, plane: bpy.types.Object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They see the sheet and not its mirrors, which a material without the marker shows."""
    up = np.array([0.0, 0.0, 1.0])
    wanted = baked_onto(plane, build_material(sateen, mode="preview"), "ROUGHNESS").mean()
    assert 0.3 < wanted < 0.8
    for mode in ("exact", "reference"):
        material = build_material(sateen, mode=mode, lamps=lamp_image())
        assert degrees_off(2 * baked_onto(plane, material, "NORMAL") - 1, up).max() < 0.5
        assert baked_onto(plane, material, "ROUGHNESS").mean() == pytest.approx(wanted, abs=0.1)
    monkeypatch.setattr(sheet_group, "with_marker", lambda closure, *_, **__: closure)
    plain = build_material(sateen, mode="reference", lamps=lamp_image())
    assert degrees_off(2 * baked_onto(plane, plain, "NORMAL") - 1, up).mean() > 1.5
    assert abs(baked_onto(plane, plain, "ROUGHNESS").mean() - wanted) > 0.2


# --- the mirrors' probability beside a lamp ------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("through", [False, True])
def test_shares_follow_a_lamp_on_its_own_side_only(name: str, through: bool) -> None:
    """Of light through the sheet the lamp's mirror image counts; from the other side the usual share is kept."""
    points = shading_points()
    image, table = random_shares(), SCENES[name]
    images = LampShares(data_image("shares", image), ShareLayout(), through), data_image("lamps", table)
    (found,) = card(lambda *inputs: lamp_probability(*images, *reordered(inputs)), *points)
    position, normal, incoming, wo, usual = (p.astype(float) for p in points)
    to_centre = table[0, 0, :3].astype(float) - position
    if through:
        to_centre = to_centre - 2 * (to_centre * normal).sum(-1, keepdims=True) * normal
    to_lamp, (sky, _, lamps, strength) = normalize(to_centre), table[0, 4].astype(float)
    seen, reflected, _ = tap(image, *share_coordinates(xp_numpy, to_lamp, incoming, normal, wo)).T
    height = (to_lamp * normal).sum(-1)
    part = part_of_light(xp_numpy, to_centre, reflected, strength, lamps, sky) * (height > 0)
    off = np.abs(found - (usual + part * (seen - usual)))
    chord = np.linalg.norm(wo - [0, 0, 1], axis=-1) / np.sqrt(2) * ShareLayout().n_o
    certain = (np.abs(chord - np.round(chord)) > 1e-3) & (np.abs(height) > 1e-4)  # where float32 cannot be beyond it
    assert off[certain].max() < 5e-3 and np.median(off[certain]) < 1e-4
    assert (height > 0.1).any() and (height < -0.1).any()


@pytest.mark.parametrize("name", SCENES)
def test_the_lamp_s_side_decides_between_the_mirrors(name: str) -> None:
    position, normal, _, _, usual = shading_points()
    table = SCENES[name]
    lamps = data_image("lamps", table)
    (found,) = card(lambda p, n, u: lamp_side(lamps, p, n, u, 0.1), position, normal, usual)
    to_centre = table[0, 0, :3].astype(float) - position
    sky, _, count, strength = table[0, 4].astype(float)
    part = part_of_light(xp_numpy, to_centre, 1.0, strength, count, sky)
    height = (normalize(to_centre) * normal).sum(-1)
    truth = np.clip(usual + part * ((height > 0) - usual), 0.1, 0.9)
    certain = np.abs(height) > 1e-4
    assert np.abs(found - truth)[certain].max() < 1e-3


def test_less_noise_where_a_lamp_is_alone(baked: dict[str, BakeResult]) -> None:
    """Behind and before the sheet; every part of the bundle holds its shares."""
    record = record_of(baked["lined"])
    assert record.has("residual_share") and record.sheet is not None
    assert all(part.has("residual_share") for part in record.sheet.parts.values())
    for place in (BEHIND, (1, 1, 3)):
        spread = []
        for share in (False, True):
            with sheet_scene(build_material(record, mode="reference"), 20.0) as scene:
                add_lamp(scene, "AREA", place, energy=300, size=0.3).visible_camera = True
                material = build_material(record, mode="reference", lamps=lamp_image(), lamp_share=share)
                scene.show(material)
                update_scene(scene.scene)
                pictures = scene.render(16, 12).astype(float)
                spread.append(float(pictures.var(0, ddof=1).mean() / pictures.mean() ** 2))
        print(place, spread)
        assert spread[1] < 0.8 * spread[0]
