"""Cycles' own closures against `bake.lobes.lobes`, under a sun of no size: no noise, and the radiance is f cos."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.nodes import compat, expr
from measured_materials.nodes.native_closure import native_closure
from support.clean_blend import clean_blend  # noqa: F401

VIEWS = np.radians([0, 40, 70, 85])
LIGHTS = [(np.radians(theta), np.radians(phi)) for theta in (2, 30, 55, 80, 88) for phi in (0, 65, 180)]
# Unequal channels, one above 1: a closure that is not linear in its colour shows here.
WEIGHT = np.array([0.25, 0.7, 1.6])
ROUNDING = 4 * 2.0**-24  # of the square of a cosine near 1, itself rounded twice
PIXELS = 4  # across a strip; the outer ones share their filter with the neighbour


class Strips:
    """One long strip of the plane z = 0 per material, side by side across the picture, under a sun of 1 W/m2."""

    def __init__(self, materials: list[bpy.types.Material]) -> None:
        compat.ensure_cycles()
        self.count = len(materials)
        self.scene = scene = bpy.data.scenes.new("strips")
        for k, material in enumerate(materials):
            mesh = bpy.data.meshes.new("strip")
            mesh.from_pydata([(k, -99, 0), (k + 1, -99, 0), (k + 1, 99, 0), (k, 99, 0)], [], [(0, 1, 2, 3)])
            mesh.materials.append(material)
            scene.collection.objects.link(bpy.data.objects.new("strip", mesh))
        light, camera = bpy.data.lights.new("sun", "SUN"), bpy.data.cameras.new("camera")
        light.energy, light.angle = 1.0, 0.0
        camera.type, camera.ortho_scale, camera.clip_end = "ORTHO", self.count, 1000
        self.sun, self.camera = bpy.data.objects.new("sun", light), bpy.data.objects.new("camera", camera)
        for placed in (self.sun, self.camera):
            scene.collection.objects.link(placed)
        scene.camera = self.camera
        scene.world, background = compat.new_world("dark")
        background.inputs["Strength"].default_value = 0
        scene.render.resolution_x, scene.render.resolution_y = PIXELS * self.count, PIXELS
        set_unbiased(scene, samples=1, seed=0)
        # Faint light would be rolled dice about, which is unbiased but noisy.
        scene.cycles.light_sampling_threshold = 0

    def radiance(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """(strips, 3) for local directions; x of the local frame is -y of the scene, and wo lies in the x-z plane."""
        view, light = (Vector((w[1], -w[0], w[2])) for w in (wo, wi))
        self.camera.matrix_world = Matrix.Translation(Vector((self.count / 2, 0, 0)) + 50 * view) @ facing(view)
        self.sun.matrix_world = facing(light)
        picture = studio.render_linear(self.scene).reshape(PIXELS, self.count, PIXELS, 3)
        inner = picture[1:-1, :, 1:-1]
        assert np.ptp(inner, axis=(0, 2)).max() <= 1e-5 * inner.max()
        return inner.mean((0, 2))

    def __enter__(self) -> Strips:
        return self

    def __exit__(self, *exception: object) -> None:
        studio.remove_studio(self.scene)


def facing(direction: Vector) -> Matrix:
    """Rotation of z to a direction, and of x to the scene's x for directions at right angles to it.

    `to_track_quat` would be off by up to 3e-4 radians close to its axis.
    """
    y = direction.cross(Vector((1, 0, 0))).normalized()
    return Matrix((y.cross(direction), y, direction)).transposed().to_4x4()


def material(closure: Callable[[Any, Any], Any], factor: float = 1.0) -> bpy.types.Material:
    """`closure` of a weight and a normal, as a material under factor WEIGHT."""
    made = compat.new_material("closure")
    with expr.building(made.node_tree) as tree:
        normal = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Normal"])
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        expr.feed(tree, output.inputs["Surface"], closure(weight(factor), normal))
    return made


def weight(factor: float) -> Any:
    """factor WEIGHT as a colour socket, as a texture would give it."""
    return expr.Vector(expr.node("ShaderNodeCombineXYZ", {}, dict(enumerate(factor * WEIGHT))).outputs[0])


def native(lobe: Lobe) -> Callable[[Any, Any], Any]:
    return lambda colour, normal: native_closure(lobe, colour, normal)


LOBES = [
    Lobe("lambert"),
    *(Lobe("oren_nayar", roughness) for roughness in (0.0, 0.1, 0.5, 1.0)),
    *(Lobe("ggx", alpha) for alpha in (0.01, 0.04, 0.2, 0.6, 1.0)),
    *(Lobe("sheen", sigma) for sigma in (0.1, 0.3, 0.6, 1.0)),
]


def measured_and_expected(
    lobes: list[Lobe], lights: Any = LIGHTS, views: Any = VIEWS, factor: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (pairs of directions, lobes, 3) in Cycles under factor WEIGHT, and factor WEIGHT f cos(theta_i)."""
    found, expected = [], []
    with Strips([material(native(lobe), factor) for lobe in lobes]) as strips:
        for theta_o in views:
            wo = spherical(theta_o, 0.0)
            for light in lights:
                wi = spherical(*light)
                found.append(strips.radiance(wi, wo))
                values = np.array([lobe.value(wi, wo) for lobe in lobes])
                expected.append(values[:, None] * (factor * WEIGHT * wi[2]))
    return np.array(found), np.array(expected)


def largest_error(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Relative, per lobe; what is below 1e-7 of its largest value counts as nothing."""
    top = expected.max(0)
    assert (top > 0).all()
    return (np.abs(found - expected) / np.maximum(expected, 1e-7 * top)).max((0, 2))


def test_closures_equal_the_lobes() -> None:
    """60 pairs of directions to 88 degrees, each channel under its own weight."""
    found, expected = measured_and_expected(LOBES)
    # Seen: at most 2e-5, but Cycles forms 1 - cos^2 theta_h in float32, which leaves D of a narrow GGX uncertain.
    allowed = np.array([3e-5 + (2 * ROUNDING / lobe.p1**2 if lobe.name == "ggx" else 0) for lobe in LOBES])
    assert (largest_error(found, expected) < allowed).all()
    # The same comparison finds any parameter that is wrong by a hundredth.
    keep = [k for k, lobe in enumerate(LOBES) if lobe.p1]
    wrong = [Lobe(LOBES[k].name, LOBES[k].p1 * 0.99) for k in keep]
    pairs = [(spherical(*light), spherical(view, 0.0)) for view in VIEWS for light in LIGHTS]
    planted = np.array([[lobe.value(wi, wo) * wi[2] for lobe in wrong] for wi, wo in pairs])[..., None] * WEIGHT
    assert (largest_error(found[:, keep], planted) > allowed[keep]).all()


@pytest.mark.parametrize("alpha", [1e-3, 3e-3, 1e-2])
def test_narrow_gloss(alpha: float) -> None:
    """Node roughness is the root of alpha down to the narrowest lobe, up to Cycles' rounding of 1 - cos^2 theta_h."""
    theta = np.radians(40)
    offsets = np.radians([-0.5, -0.1, -0.03, 0.0, 0.03, 0.1, 0.5])
    found, expected = measured_and_expected([Lobe("ggx", alpha)], [(theta + d, np.pi) for d in offsets], [theta])
    # D is proportional to (alpha^2 + x)^-2 with x = sin^2 theta_h.
    spread = alpha**2 + np.sin(offsets / 2) ** 2
    ratio = (found / expected)[:, 0, 0]
    assert (ratio < (spread / np.maximum(spread - ROUNDING, 0.1 * spread)) ** 2 * 1.0001).all()
    assert (ratio > (spread / (spread + ROUNDING)) ** 2 * 0.9999).all()


@pytest.mark.parametrize("factor", [1e-3, 1e-4])
def test_faint_weights(factor: float) -> None:
    """Textures hold dark texels. Below a weight of 1e-4 Oren-Nayar falls short, below 1e-5 Cycles drops any closure."""
    rough = [lobe for lobe in LOBES if lobe.name == "oren_nayar"]
    found, expected = measured_and_expected(rough, factor=factor)
    # 1.6e-4 in the third channel, 0.25e-4 in the first: there only light scattered more than once goes missing.
    exact = slice(None) if factor > 4e-4 else slice(2, None)
    assert largest_error(found[..., exact], expected[..., exact]).max() < 1e-4
    assert (found < expected * (1 + 1e-4)).all()
    assert (found > 0.65 * expected).all()


def test_why_oren_nayar_needs_its_own_closure() -> None:
    """As the node's colour, 0.5 gives 0.4385 of white: an envelope m r would not be linear in its texture m."""

    def plain(colour: float) -> Callable[[Any, Any], Any]:
        inputs = {"Color": expr.vec(colour, colour, colour), "Roughness": 0.5}
        return lambda _, normal: expr.Scalar(expr.node("ShaderNodeBsdfDiffuse", {}, inputs).outputs[0])

    upright = spherical(0.0, 0.0)
    with Strips([material(plain(colour)) for colour in (0.5, 1.0, 2.0)]) as strips:
        half, white, bright = strips.radiance(upright, upright)[:, 0]
    assert white == pytest.approx(float(Lobe("oren_nayar", 0.5).value(upright, upright)), rel=1e-6)
    assert half / white == pytest.approx(0.4385, abs=1e-4)
    # Beyond 1 the colour only scales, which is what `oren_nayar_closure` lives on.
    assert bright == pytest.approx(2 * white, rel=1e-6)
