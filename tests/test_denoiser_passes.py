"""Albedo and normal of a measured material as the denoiser gets them, and what they are worth to it."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.studio.studio import render_rgba
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import LUMINANCE
from measured_materials.bake.sources import analytic
from measured_materials.bake.tables.albedo import directional_albedo
from measured_materials.nodes.feature_passes import (
    ALBEDO,
    NORMAL,
    albedo_polynomial,
    denoise_by_features,
    stop_denoising,
    with_feature_outputs,
)
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401
from support.scenes import TestScene, diffuse_material, lit_sphere

PAINT = analytic.MetallicPaint(diffuse=(0.05, 0.1, 0.3), flake=(0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.1)


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A metallic paint: a third of its light is the mirror's."""
    settings = BakeSettings(resolution=32, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=32, n_h=32, n_phi=16))
    return read_bundle(bake_source(PAINT, tmp_path_factory.mktemp("bundle") / "paint", settings).path)


@pytest.fixture(scope="module")
def truth(paint: Bundle) -> np.ndarray:
    """The sphere of `test_denoised_picture_is_closer` with a fifth of its pictures' noise."""
    with lit_sphere(build_material(paint, mode="exact", lamps=lamp_image()), 64, resolution=96) as scene:
        return scene.render(384, [50])[0]


def featured(bundle: Bundle, mode: str, tint: float = 1.0, saturation: float = 1.0) -> bpy.types.Material:
    """A material that writes the passes."""
    material = build_material(bundle, mode=mode, lamps=lamp_image())
    node = group_node(material)
    node.node_tree = with_feature_outputs(node.node_tree, albedo_polynomial(BrdfRecord.read(bundle)))
    node.inputs["Tint"].default_value, node.inputs["Saturation"].default_value = (*(tint,) * 3, 1), saturation
    return material


def group_node(material: bpy.types.Material) -> Any:
    return next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")


def denoiser_input(scene: TestScene, kind: str) -> np.ndarray:
    """What the denoiser is given as "Albedo" or "Normal", (H, W, 4)."""
    tree = denoise_by_features(scene.scene)
    denoise = next(n for n in tree.nodes if n.bl_idname == "CompositorNodeDenoise")
    tree.links.new(denoise.inputs[kind].links[0].from_socket, denoise.outputs[0].links[0].to_socket)
    return render_rgba(scene.scene)


@pytest.mark.parametrize("mode", ["exact", "reference"])
def test_passes_are_albedo_and_normal(paint: Bundle, mode: str) -> None:
    """In one sample a pixel, so that any noise would show; the matte ground stays as Cycles has it."""
    with lit_sphere(diffuse_material(0.5), 64) as scene:
        mask = scene.mask()
        scene.scene.cycles.samples = 1
        stock_albedo, stock_normal = (denoiser_input(scene, kind)[..., :3] for kind in ("Albedo", "Normal"))
        scene.show(featured(paint, mode, tint=0.8, saturation=0.25))
        albedo, normal = (denoiser_input(scene, kind)[..., :3] for kind in ("Albedo", "Normal"))
        camera = scene.scene.camera.data
        distance = camera.lens / camera.sensor_width
    # Cycles writes a Diffuse BSDF's normal without fail, and under one seed at the same place.
    assert np.abs(normal - stock_normal).max() < 1e-4
    ground = np.abs(stock_albedo - 0.5).max(-1) > 1e-3
    assert ground.any() and np.abs(albedo - stock_albedo)[ground].max() < 1e-4

    size = len(mask)
    across = (np.arange(size) + 0.5) / size - 0.5
    x, y = np.meshgrid(across, -across)
    rays = np.stack([x, y, np.full_like(x, distance)], -1)
    cosine = -(normal * rays).sum(-1) / np.linalg.norm(rays, axis=-1)
    seen = mask & (cosine > math.cos(math.radians(80)))
    truth = directional_albedo(PAINT, np.arccos(np.clip(cosine[seen], 0, 1)), 24)
    truth = 0.8 * (0.25 * truth + 0.75 * (truth @ LUMINANCE)[:, None])
    # The polynomial is within 0.03; where in its pixel a ray was is not known, which matters at the rim.
    assert np.abs(albedo[seen] - truth).max() < 0.04
    assert np.abs(albedo[seen] - truth).mean() < 0.015


def test_passes_do_not_touch_the_picture(paint: Bundle) -> None:
    """Bit by bit, without the passes in the layer and with them."""
    plain = build_material(paint, mode="exact", lamps=lamp_image())
    with lit_sphere(plain, 32) as scene:
        pictures = [scene.render(4, [1])]
        scene.show(featured(paint, "exact"))
        pictures.append(scene.render(4, [1]))
        denoise_by_features(scene.scene)
        stop_denoising(scene.scene)
        pictures.append(scene.render(4, [1]))
    assert np.array_equal(pictures[0], pictures[1]) and np.array_equal(pictures[0], pictures[2])


@pytest.mark.parametrize("mode", [pytest.param("exact", marks=pytest.mark.slow), "reference"])
def test_denoised_picture_is_closer(paint: Bundle, truth: np.ndarray, mode: str) -> None:
    """At 16 samples, by these passes and by Cycles' own, which need the best prefilter not to harm."""
    with lit_sphere(featured(paint, mode), 64, resolution=96) as scene:
        mask = scene.mask()

        def error() -> float:
            return float(np.sqrt(((scene.render(16, [1])[0] - truth)[mask] ** 2).mean()))

        noisy = error()
        denoise_by_features(scene.scene, prefilter="NONE")
        ours = error()
        stop_denoising(scene.scene)
        cycles = scene.scene.cycles
        cycles.use_denoising, cycles.denoising_input_passes = True, "RGB_ALBEDO_NORMAL"
        stock = {}
        for cycles.denoising_prefilter in ("NONE", "ACCURATE"):
            stock[cycles.denoising_prefilter] = error()
    # Found: 3.4 and 3.8 (a third of it the truth's own noise); 3.6 and 4.1; 1.05 and 1.08, which the prefilter does.
    assert noisy > 2.5 * ours
    assert stock["NONE"] > 2.0 * ours
    assert stock["ACCURATE"] > 0.97 * ours


def test_the_compositor_keeps_what_it_did(paint: Bundle) -> None:
    with lit_sphere(featured(paint, "exact"), 16, resolution=16) as scene:
        tree = denoise_by_features(scene.scene)
        source = next(n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers")
        output = source.outputs["Image"].links[0].to_node.outputs[0].links[0].to_socket
        stop_denoising(scene.scene)
        assert [link.to_socket for link in source.outputs["Image"].links] == [output]
        blur = tree.nodes.new("CompositorNodeBlur")
        tree.links.new(source.outputs["Image"], blur.inputs["Image"])
        tree.links.new(blur.outputs["Image"], output)
        for _ in range(2):
            assert denoise_by_features(scene.scene, prefilter="NONE") == tree
        kinds = [n.bl_idname for n in tree.nodes]
        assert kinds.count("CompositorNodeDenoise") == 1 and kinds.count("CompositorNodeRLayers") == 1
        assert blur.inputs["Image"].links[0].from_node.bl_idname == "CompositorNodeDenoise"
        assert [a.name for a in scene.scene.view_layers[0].aovs] == [ALBEDO, NORMAL]
        stop_denoising(scene.scene)
        assert blur.inputs["Image"].links[0].from_node == source
        assert output.links[0].from_node == blur and len(tree.nodes) == len(kinds) - 3


def test_groups_are_shared_where_they_are_equal(paint: Bundle) -> None:
    group = group_node(build_material(paint, mode="reference")).node_tree
    albedo = albedo_polynomial(BrdfRecord.read(paint))
    made = with_feature_outputs(group, albedo)
    assert with_feature_outputs(made, albedo) == made
    if made != group:
        assert with_feature_outputs(group, albedo) == made
        assert with_feature_outputs(group, albedo * 0.9) != made
    outer, inner = ([(i.name, i.in_out) for i in g.interface.items_tree] for g in (made, group))
    assert outer == inner


@pytest.mark.parametrize(
    "change",
    [
        {"directional": [[0.5, 0.5, 0.5]]},
        {"directional": [[0.5, 0.5, 0.5]] * 3, "theta_o_deg": [0, 30, 60]},
        {"directional": [["grey"] * 3] * 12},
        {"directional": [[0.5, 0.5]] * 12},
        {"theta_o_deg": ["straight"] * 12},
        {"theta_o_deg": [math.nan] * 12},
    ],
)
def test_albedo_that_is_none_is_told(paint: Bundle, change: dict[str, Any]) -> None:
    facts = {**paint.material, "albedo": {**paint.material["albedo"], **change}}
    with pytest.raises(BakeError, match="albedo"):
        albedo_polynomial(BrdfRecord.parse(facts, paint.path))
