"""Mode Balanced behind a perfect mirror, behind glass and after a diffuse bounce, sample by sample.

At equal seeds two modes that choose the same closure trace the same paths: pictures are then equal to the last digits,
and nothing statistical is left to tolerate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from measured_materials.addon.lamps import lamp_image, update_scene
from measured_materials.bake.bundle import Bundle
from measured_materials.nodes.material import build_material
from support.scene_check_cases import clear_blend, paint_bundle
from support.scenes import Array, TestScene, diffuse_material, lit_sphere

SAMPLES = 16
# Of a box whose corners count x, y, z as bits, z the last; seen from outside they turn against the clock.
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    return paint_bundle(tmp_path_factory.mktemp("mirror"))


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    yield
    clear_blend()


def smooth(kind: str) -> bpy.types.Material:
    """A perfect mirror ("ShaderNodeBsdfGlossy") or clear glass ("ShaderNodeBsdfGlass")."""
    material = bpy.data.materials.new(kind)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Roughness"].default_value = 0.0
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def box(scene: TestScene, size: tuple[float, float, float], matrix: Matrix, material: bpy.types.Material) -> None:
    mesh = bpy.data.meshes.new("box")
    corners = [tuple((b - 0.5) * s for b, s in zip(bits, size)) for bits in product((0, 1), repeat=3)]
    mesh.from_pydata(corners, [], FACES)
    mesh.materials.append(material)
    obj = bpy.data.objects.new("box", mesh)
    obj.matrix_world = matrix
    scene.scene.collection.objects.link(obj)


def look_from(scene: TestScene, eye: Vector, at: Vector) -> Matrix:
    """Turn the camera, and return a frame half way whose -z looks the same way."""
    turn = (at - eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    scene.scene.camera.matrix_world = Matrix.Translation(eye) @ turn
    return Matrix.Translation(eye.lerp(at, 0.5)) @ turn


def in_a_mirror(scene: TestScene) -> None:
    """The camera looks away from the sphere, into a mirror behind which it appears."""
    look_from(scene, Vector((0, -3, 0.6)), Vector((0, -6, 0.6)))
    box(scene, (8, 0.1, 8), Matrix.Translation((0, -5, 0)), smooth("ShaderNodeBsdfGlossy"))
    scene.scene.camera.data.lens = 80


def in_two_mirrors(scene: TestScene) -> None:
    """By way of one at 45 degrees, then of one beside it."""
    look_from(scene, Vector((6, -6, 0)), Vector((0, -6, 0)))
    turned = Matrix.Translation((0, -6, 0)) @ Matrix.Rotation(np.pi / 4, 4, "Z")
    box(scene, (0.1, 6, 6), turned, smooth("ShaderNodeBsdfGlossy"))
    scene.scene.camera.data.lens = 170


def behind_glass(scene: TestScene) -> None:
    frame = look_from(scene, Vector((0, -4.5, 0.5)), Vector((0, 0, 0)))
    box(scene, (6, 6, 0.1), frame, smooth("ShaderNodeBsdfGlass"))


def rendered(bundle: Bundle, mode: str, arrange: Callable[[TestScene], None]) -> Array:
    material = build_material(bundle, mode=mode, lamps=lamp_image())
    # Matte ground would bring diffuse bounces, after which the modes may differ.
    with lit_sphere(material, 32, lamp_size=0.6, ground=False, resolution=24) as scene:
        scene.sphere.shadow_terminator_geometry_offset = 0
        arrange(scene)
        update_scene(scene.scene)
        picture = scene.render(SAMPLES, 1)[0]
    clear_blend()
    return picture


def equal(a: Array, b: Array) -> np.ndarray:
    """Pixels that agree to float32's digits."""
    return np.all(np.abs(a - b) <= 2e-5 * np.maximum(np.abs(a), 1e-3), -1)


@pytest.mark.parametrize("arrange", [in_a_mirror, in_two_mirrors, behind_glass], ids=lambda f: f.__name__)
def test_balanced_is_exact_in_mirrors_and_behind_glass(bundle: Bundle, arrange: Callable[[TestScene], None]) -> None:
    """Every sample, whatever the number of such bounces; Preview there is told apart by a quarter of the picture.

    A path that leaves the sphere by a diffuse closure and meets it again by way of mirror or glass may differ.
    """
    exact, balanced, preview = (rendered(bundle, mode, arrange) for mode in ("exact", "balanced", "preview"))
    assert equal(exact, balanced).mean() > 0.97
    assert equal(exact, preview).mean() < 0.75
    assert balanced.mean() == pytest.approx(exact.mean(), rel=1e-3)


def only_its_light(scene: TestScene) -> None:
    """The camera sees the matte ground, which the sphere above lights, and not the sphere."""
    scene.sphere.visible_camera = False
    scene.scene.camera.matrix_world = Matrix.Translation((0, 0, 6))
    box(scene, (8, 8, 0.1), Matrix.Translation((0, 0, -1.1)), diffuse_material((0.8, 0.8, 0.8)))


def only_its_light_in_a_mirror(scene: TestScene) -> None:
    """As before, and the camera sees the ground in a mirror: the diffuse bounce is not the first."""
    only_its_light(scene)
    look_from(scene, Vector((0, -4, 1)), Vector((0, -6, 0.9)))
    box(scene, (8, 0.1, 8), Matrix.Translation((0, -6, 0)), smooth("ShaderNodeBsdfGlossy"))


@pytest.mark.parametrize("arrange", [only_its_light, only_its_light_in_a_mirror], ids=lambda f: f.__name__)
def test_balanced_is_preview_after_a_diffuse_bounce(bundle: Bundle, arrange: Callable[[TestScene], None]) -> None:
    """On ground that the material lights; Exact gives it other samples.

    The mirror shows the sphere itself too, on a tenth of the picture, where Balanced is Exact; at its edge, both.
    """
    exact, balanced, preview = (rendered(bundle, mode, arrange) for mode in ("exact", "balanced", "preview"))
    as_preview, as_exact = equal(preview, balanced), equal(exact, balanced)
    assert (as_preview | as_exact).mean() > 0.93
    assert as_preview.mean() > (0.97 if arrange is only_its_light else 0.8)
    assert as_exact.mean() < 0.85
