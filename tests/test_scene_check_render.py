"""Renders that prove what the scene check says: the gravest settings do change the picture."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.scene_check.check import mend_scene
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.nodes.material import build_material
from support.checked_scenes import bundle, clean_blend, matte  # noqa: F401
from support.scene_check_cases import material_of, mixed_under_a_sun, rules, spoiler
from support.scenes import TestScene, diffuse_material, lit_sphere


def change(scene: TestScene, spoil: Callable[[TestScene], None], samples: int, seeds: int = 6) -> Any:
    """Relative change of the whole picture under each seed; the paths are the same before and after."""
    before = scene.render(samples, seeds).mean((1, 2, 3))
    spoil(scene)
    return scene.render(samples, seeds).mean((1, 2, 3)) / before - 1


# Material, place, and the change to be seen, where a scene this small shows less than the check states; the other
# figures are held closely by `test_scene_check_figures.py`. In a "room" the ground is of the paint too; the "mirror" is
# all there is of mode Reference and finds an "unaimed" lamp, which is small, by chance.
PROOFS: dict[str, tuple[str, float, float]] = {
    "clamp_indirect": ("mirror unaimed room", -0.2, -0.002),
    "texture_limit": ("mirror", -0.1, -0.0005),
}


@pytest.mark.parametrize("rule", PROOFS)
def test_it_does_change_the_picture(bundle: Bundle, rule: str) -> None:
    """By about as much as the check states.

    No seed changes in the other direction: with six of them that happens by chance once in 32 times where a setting
    does nothing on average, and with a mean change of this size far more rarely.
    """
    kind, low, high = PROOFS[rule]
    unaimed = "unaimed" in kind
    lamps = None if unaimed else lamp_image()
    material = build_material(bundle, mode="reference" if "mirror" in kind else None, lamps=lamps)
    with lit_sphere(material, 32, lamp_size=0.2 if unaimed else 0.6, resolution=24) as scene:
        scene.leave_terminator()
        for obj in scene.scene.objects if "room" in kind else ():
            if obj.type == "MESH":
                obj.data.materials.clear()
                obj.data.materials.append(material)
        # A path of two bounces that ends in a small lamp is rare.
        changes = change(scene, spoiler(rule), 96 if "unaimed room" in kind else 16)
    assert np.all(changes * np.sign(low) >= 0) and low < changes.mean() < high, changes


@pytest.mark.parametrize("mode", ["exact", "reference"])
@pytest.mark.parametrize("tint", [(1, 1, 1), (1, 0, 0)])
def test_a_mended_mix_keeps_the_sun(bundle: Bundle, mode: str, tint: tuple[float, ...]) -> None:
    """Aimed weights are of the sun's solid angle; mixed as they are, they fall under Cycles' cut-off or are noise."""
    with lit_sphere(
        build_material(bundle, mode=mode, lamps=lamp_image()), 32, lamp=False, ground=False, resolution=32
    ) as scene:
        scene.scene.world.node_tree.nodes.clear()
        mixed_under_a_sun(scene)
        scene.leave_terminator()
        tree, mask = material_of(scene).node_tree, scene.mask()
        mix = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeMixShader")
        next(n for n in tree.nodes if n.bl_idname == "ShaderNodeGroup").inputs["Tint"].default_value = (*tint, 1)
        assert "mixed_mirror" in rules(scene)
        mix.inputs[0].default_value = 0.0
        assert "mixed_mirror" not in rules(scene)
        whole = scene.render(32, 4)[:, mask].mean((0, 1))
        mix.inputs[0].default_value = 0.7
        plain = scene.render(32, 4)[:, mask]
        mend_scene(scene.scene)
        assert "mixed_mirror" not in rules(scene)
        mended = scene.render(32, 8)[:, mask]
        # A black shader takes the rest. The mean of so few samples is known to 1.7 %; what was lost before was a third
        # of the light or all of it.
        assert mended.mean((0, 1)) == pytest.approx(0.3 * whole, rel=0.06)
        assert tint[1] or plain[..., 0].mean() < 0.9 * 0.3 * whole[0]


@pytest.mark.parametrize("mode", ["exact", "reference"])
def test_a_mended_mix_is_what_cycles_own_closure_shows(matte: Bundle, mode: str) -> None:
    """A matte material under a sun, seven parts of it black: Diffuse of three tenths of its albedo.

    The truth shares nothing with what is fixed; noise is a percent.
    """
    material = build_material(matte, mode=mode, lamps=lamp_image())
    with lit_sphere(material, 32, lamp=False, ground=False, resolution=32) as scene:
        scene.scene.world.node_tree.nodes.clear()
        mixed_under_a_sun(scene)
        scene.leave_terminator()
        mask = scene.mask()
        next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeMixShader").inputs[0].default_value = 0.7
        mend_scene(scene.scene)
        assert "mixed_mirror" not in rules(scene)
        found = scene.render(64, 4)[:, mask].mean((0, 1))
        scene.show(diffuse_material((0.3 * 0.8,) * 3))
        truth = scene.render(4, 2)[:, mask].mean((0, 1))
    assert found == pytest.approx(truth, rel=0.03)


def test_a_mended_mix_is_quiet(bundle: Bundle) -> None:
    """Half of the material and half of a matte one under a small sun: Cycles hardly ever picks the mirror itself."""
    material = build_material(bundle, mode="reference", lamps=lamp_image())
    with lit_sphere(material, 32, lamp=False, ground=False, resolution=32) as scene:
        scene.scene.world.node_tree.nodes.clear()
        mixed_under_a_sun(scene)
        tree = material_of(scene).node_tree
        next(n for n in tree.nodes if n.bl_idname == "ShaderNodeMixShader").inputs[0].default_value = 0.5
        matte = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBsdfDiffuse")
        matte.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1)
        plain = scene.render(16, 4).var(0).mean() ** 0.5
        mend_scene(scene.scene)
        mended = scene.render(16, 4).var(0).mean() ** 0.5
    assert plain > 10 * mended, plain / mended
