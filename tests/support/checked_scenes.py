"""Fixtures of the scene check's tests, which a module takes up by importing them: materials, and a scene with one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.rendering.quiet_camera import quiet_camera
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes.material import build_material

from .scene_check_cases import clear_blend, paint_bundle
from .scenes import TestScene, lit_sphere

ALBEDO = 0.8


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A small paint with an envelope, baked once in a process."""
    return paint_bundle(tmp_path_factory.mktemp("check"))


@pytest.fixture(scope="module")
def matte(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A Lambertian that reflects `ALBEDO`."""
    settings = BakeSettings(8, sampler=SamplerLayout(n_o=8, n_h=8, n_phi=4))
    out = tmp_path_factory.mktemp("matte") / "matte.mmat"
    return read_bundle(bake_source(analytic.Lambert((ALBEDO,) * 3), out, settings).path)


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    """Nothing of one test's scenes reaches the next."""
    yield
    clear_blend()


def sound(bundle: Bundle) -> TestScene:
    """A scene that the check has nothing to say about."""
    scene = lit_sphere(build_material(bundle, lamps=lamp_image()), 16, resolution=32)
    scene.leave_terminator()
    quiet_camera(scene.scene, [scene.sphere])
    update_scene(scene.scene)
    return scene


@pytest.fixture(scope="module")
def cloth(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A sheet whose light straight on is its mirrors'."""
    settings = BakeSettings(8, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=8, n_h=8, n_phi=4), envelope=True)
    source = analytic.ThinCloth((0.3,) * 3, None, (0.1,) * 3, (0.5,) * 3, 8.0)
    return read_bundle(bake_source(source, tmp_path_factory.mktemp("cloth") / "cloth", settings).path)


def sound_sheet(bundle: Bundle) -> TestScene:
    """The same of a sheet, whose lamp the camera sees."""
    scene = sound(bundle)
    next(obj for obj in scene.scene.objects if obj.type == "LIGHT").visible_camera = True
    return scene


@pytest.fixture
def painted(bundle: Bundle) -> Iterator[TestScene]:
    """The same, removed in the end."""
    with sound(bundle) as scene:
        yield scene
