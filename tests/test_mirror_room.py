"""Balanced in a mirror, behind glass and behind what is transparent: Exact, sample by sample.

Only a diffuse bounce may turn it into Preview. A count of any other kind of bounce would do as well wherever a material
is seen directly, and show Preview in every mirror.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from measured_materials.nodes.shading_map_material import build_shading_map
from support.clean_blend import clean_blend  # noqa: F401
from support.osl import skip_without_osl
from support.scenes import Array, TestScene, diffuse_material, lit_sphere
from support.swatches import map_bundle, rough_map

# The pane that the camera looks at: its closure, and whether the sphere lies behind the camera.
PANES: dict[str, tuple[str, dict[str, Any], bool]] = {
    "mirror": ("ShaderNodeBsdfAnisotropic", {"Roughness": 0.0}, True),
    "glass": ("ShaderNodeBsdfGlass", {"Roughness": 0.0, "IOR": 1.45}, False),
    "transparent": ("ShaderNodeBsdfTransparent", {}, False),
}


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    paint = analytic.MetallicPaint((0.05, 0.1, 0.3), (0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
    settings = BakeSettings(resolution=12, alpha=(0.5, 0.3), sampler=SamplerLayout(n_o=16, n_h=16, n_phi=8))
    return read_bundle(bake_source(paint, tmp_path_factory.mktemp("mirrors") / "paint", settings).path)


def room(pane: str) -> TestScene:
    """The sphere seen by way of a pane, and of nothing else."""
    kind, inputs, turned = PANES[pane]
    scene = lit_sphere(diffuse_material(0.5), 48, lamp_size=0.6, ground=False, resolution=24)
    scene.leave_terminator()
    mesh = bpy.data.meshes.new("pane")
    mesh.from_pydata([(-9, 0, -9), (9, 0, -9), (9, 0, 9), (-9, 0, 9)], [], [(0, 1, 2, 3)])
    mesh.materials.append(compat.shader_material("pane", kind, inputs))
    obj = bpy.data.objects.new("pane", mesh)
    obj.matrix_world = Matrix.Translation((0, -5 if turned else -2, 0))
    scene.scene.collection.objects.link(obj)
    away = math.pi if turned else 0.0
    scene.scene.camera.matrix_world = Matrix.Translation((0, -3.6, 0)) @ Matrix.Rotation(away, 4, "Z")
    scene.scene.camera.matrix_world @= Matrix.Rotation(math.pi / 2, 4, "X")
    return scene


def assert_exact(scene: TestScene, exact: bpy.types.Material, balanced: bpy.types.Material, other: Any) -> None:
    """Balanced is Exact to the last bits, and `other`, Preview, is not."""
    pictures: list[Array] = []
    for material in (exact, balanced, other):
        scene.show(material)
        pictures.append(scene.render(4, 1)[0])
    assert pictures[0].any()
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=1e-5, atol=1e-7)
    shown = np.abs(pictures[2] - pictures[0]).max(-1) > 1e-3 * pictures[0].max()
    assert shown.mean() > 0.05, "the sphere is hardly seen, or Preview is Exact: this proves nothing"


@pytest.mark.parametrize("pane", PANES)
def test_balanced_is_exact_by_way_of(bundle: Bundle, pane: str) -> None:
    with room(pane) as scene:
        built = [build_material(bundle, mode=m, lamps=lamp_image()) for m in ("exact", "balanced", "preview")]
        assert_exact(scene, *built)


@pytest.mark.parametrize("pane", ["mirror", "glass"])
def test_osl_balanced_is_exact_by_way_of(bundle: Bundle, pane: str) -> None:
    skip_without_osl()
    with room(pane) as scene:
        use_osl(scene.scene)
        built = [build_osl_material(bundle, mode=m, lamps=lamp_image()) for m in ("exact", "balanced", "preview")]
        assert_exact(scene, *built)


def test_a_balanced_map_is_exact_by_way_of_a_mirror(tmp_path: Path) -> None:
    render = RenderSettings(Lobe("lambert"), sigma=0.8)
    maps = map_bundle(tmp_path / "rough", rough_map(), render)
    with room("mirror") as scene:
        built = [
            build_shading_map(maps, settings=RenderSettings(Lobe("lambert"), sigma=0.8, mode=mode), lamps=lamp_image())
            for mode in ("exact", "balanced", "preview")
        ]
        assert_exact(scene, *built)
