"""Scenes that strain float32 or turn surfaces about, against Cycles' own closures; and the random numbers in them."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.studio import studio
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.nodes import compat, expr
from measured_materials.nodes.adjustments import NEUTRAL
from measured_materials.nodes.group import call, node_group
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import assemble
from measured_materials.nodes.native_closure import add_closures, native_closure
from measured_materials.nodes.stochastic_mirror_group import more_random_numbers_group, random_numbers_group
from scipy import stats
from support.clean_blend import clean_blend  # noqa: F401
from support.hard_scenes import HARD, hard_scene, link_bump, link_normal_map
from support.monte_carlo import assert_agree, compare
from support.scenes import TestScene

# Of the table: 0.12 % of the energy where it was measured at the bake.
TABLE_ERROR = 0.002
EFFECT = 0.01
# Enough to find 1 % with Exact, and with Reference, which is noisier; where light bounces, noisier still.
SAMPLES, MORE_SAMPLES, MOST_SAMPLES = 80, 160, 256
DRESSED = {"bump": link_bump, "normal map": link_normal_map}
SCENES = (*HARD, *DRESSED)
# What the others have in common with these, or strain less, is left to the slow tests.
QUICK = {"as_usual", "far", "millimetre", "moving", "instanced", "sheared", "two_sided", "bump"}
QUICK_REFERENCE = {"far_orthographic"}
VIEWS = ("far", "far_narrow", "far_orthographic", "millimetre", "zoom", "zoom_orthographic", "moving", "instanced")
# Where rays are parallel float32 leaves some thousand positions to a pixel: of 16 000 samples a few are of one ray.
DISTINCT = {"far_orthographic": 0.998, "zoom_orthographic": 0.996}


def quick_first(quick: set[str]) -> list[Any]:
    """All scenes, those marked slow that are not among the quick ones."""
    return [pytest.param(name, marks=() if name in quick else pytest.mark.slow) for name in SCENES]


class TwoLobes:
    """A BRDF that Cycles has closures for, but not those of an envelope alone: a fifth of it is left to the mirror."""

    name, isotropic, bilateral = "two lobes", True, True
    facts: dict[str, Any] = {}
    parts = ((0.5, Lobe("oren_nayar", 1.0)), (0.4, Lobe("ggx", 0.5)))

    def evaluate(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """BRDF (..., 3) in 1/sr."""
        value = sum(weight * lobe.value(*np.broadcast_arrays(wi, wo)) for weight, lobe in self.parts)
        return np.repeat(value[..., None], 3, -1)

    def native(self) -> bpy.types.Material:
        """The same by Cycles' closures, in a material that is otherwise built alike."""

        def build(normal: Any, tint: Any) -> Any:
            return add_closures([native_closure(lobe, expr.scale(tint, w), normal) for w, lobe in self.parts])

        group = node_group("Native", {"Normal": "vector", "Tint": "color"}, {"BSDF": "shader"}, build, NEUTRAL)
        material = compat.new_material("native")
        assemble(material, group, (0.5, 0.5, 0.5))
        return material


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    layout = SamplerLayout(n_o=16, n_h=24, n_phi=12)
    settings = BakeSettings(resolution=20, alpha=(0.5, 0.5), sampler=layout)
    result = bake_source(TwoLobes(), tmp_path_factory.mktemp("hard") / "two", settings)
    assert 0.7 < result.facts["envelope"]["share"] < 0.9
    return read_bundle(result.path)


def built(bundle: Bundle, mode: str, name: str) -> bpy.types.Material:
    material = build_material(bundle, mode=mode, lamps=lamp_image())
    DRESSED.get(name, lambda _: None)(material)
    return material


def check(bundle: Bundle, name: str, mode: str, samples: int) -> None:
    """This mode against native closures, sky and an aimed lamp."""
    native = TwoLobes().native()
    DRESSED.get(name, lambda _: None)(native)
    with hard_scene(name if name in HARD else "as_usual", native) as scene:
        pictures, mask = scene.render(SAMPLES, 6), scene.mask()
        material = built(bundle, mode, name)
        scene.show(material)
        found = compare(pictures, scene.render(samples, range(100, 106)), mask, tolerance=TABLE_ERROR)
        assert_agree(found, EFFECT)
        if name == "as_usual":
            group = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
            group.inputs["Tint"].default_value = (*(1.02,) * 3, 1)
            found = compare(pictures, scene.render(samples, range(900, 906)), mask, tolerance=TABLE_ERROR)
            assert not found.passed, "planted 2 % were not found"


@pytest.mark.parametrize("name", quick_first(QUICK))
def test_exact_is_not_biased(bundle: Bundle, name: str) -> None:
    check(bundle, name, "exact", SAMPLES)


@pytest.mark.parametrize("name", quick_first(QUICK_REFERENCE))
def test_reference_is_not_biased(bundle: Bundle, name: str) -> None:
    check(bundle, name, "reference", MORE_SAMPLES if name in QUICK_REFERENCE else MOST_SAMPLES)


def numbers_material(which: int) -> bpy.types.Material:
    """Shines by three of the nine random numbers."""
    material = compat.new_material("numbers")
    with expr.building(material.node_tree) as tree:
        numbers = (*call(random_numbers_group()), *call(more_random_numbers_group()))
        emission = expr.node("ShaderNodeEmission", {}, {"Color": expr.vec(*numbers[3 * which : 3 * which + 3])})
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def random_numbers(scene: TestScene, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (samples, H, W, 9) as single samples of every pixel draw them, and where (samples, H, W) they do."""
    cycles = scene.scene.cycles
    cycles.samples, cycles.use_sample_subset, cycles.sample_subset_length = 4096, True, 1
    scene.scene.render.film_transparent = True
    found = []
    for which in range(3):
        scene.show(numbers_material(which))
        with scene.kept():
            for sample in range(samples):
                cycles.sample_offset = 1 + sample
                found.append(studio.render_rgba(scene.scene))
    stack = np.array(found).reshape(3, samples, *found[0].shape)
    return np.concatenate(stack[..., :3], -1), stack[0, ..., 3] == 1


@pytest.mark.parametrize("name", VIEWS)
def test_random_numbers(name: str) -> None:
    """Even, independent of each other, of the neighbouring pixel and of the pixel's next sample; and never repeated."""
    with hard_scene(name, TwoLobes().native(), resolution=64) as scene:
        numbers, seen = random_numbers(scene, 4)
    u = numbers[seen].astype(np.float64)
    assert len(u) > 4000 and u.min() >= 0 and u.max() <= 1
    for triple in np.split(numbers[seen], 3, axis=-1):
        distinct = len(np.unique(triple, axis=0)) / len(triple)
        assert distinct > DISTINCT.get(name, 0.9995)
    # 9 tests of evenness and 36 of pairs, at a level of 1e-6 each: an alarm in 20 000 runs.
    assert min(stats.kstest(column, "uniform").pvalue for column in u.T) > 1e-6
    cells = np.minimum((u * 8).astype(int), 7)
    for first in range(9):
        for second in range(first):
            counts = np.bincount(cells[:, first] * 8 + cells[:, second], minlength=64)
            assert stats.chisquare(counts).pvalue > 1e-6
    centred = np.where(seen[..., None], numbers - 0.5, 0)
    for axis in range(3):
        products = centred.take(range(1, centred.shape[axis]), axis) * centred.take(
            range(centred.shape[axis] - 1), axis
        )
        pairs = products[products.any(-1)]
        # A product of two even numbers about 0 has a deviation of 1/12.
        assert np.abs(pairs.mean(0)).max() < 5.5 / 12 / np.sqrt(len(pairs))
