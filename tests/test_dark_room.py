"""A dark room: one lamp, no world, a sphere above a white floor; every mode against Diffuse BSDF.

Nothing but the lamp shines here, so that a material could aim every draw at it and lose what the floor sends back: of
the light on the sphere's lower third that is most. No sky hides it, and no quadrature of direct light could know it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf import reflection
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.envelope import EnvelopeFit, fit_envelope, lamp_shares
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_script import use_osl
from measured_materials.nodes.shading_map_material import build_shading_map
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, compare
from support.osl import skip_without_osl
from support.scenes import Array, TestScene, diffuse_material, lit_sphere
from support.swatches import identity_map, map_bundle

COLOUR = (0.6, 0.4, 0.2)
# Of the envelope's weights: all of a Lambertian would leave no mirror in mode Exact.
CARRIED = 0.4
# Of the draws, those that the mirror gets, and another part than is left to it: any must give one picture, and where it
# is the same part a Lambertian would not show closures and mirror exchanged.
DECLARED = 0.45
SIZES = SamplerLayout(n_o=16, n_h=16, n_phi=8)
SETTINGS = BakeSettings(resolution=12, alpha=(0.5, 0.3), sampler=SIZES, storage=Storage.FLOAT32)
# The smallest change that is found on the sphere and in its lower third; what was planted there is well found.
FINDS, FINDS_BELOW = 0.02, 0.06
SEEDS = 8
# By mode. Reference finds the floor by the tenth of its draws that are not aimed.
SAMPLES = {"exact": 400, "balanced": 400, "reference": 192, "preview": 64, "map": 320}


def dark_room(material: bpy.types.Material) -> TestScene:
    """A small lamp, no world, and a white floor under the sphere."""
    room = lit_sphere(material, 48, lamp_size=0.4, resolution=32)
    room.scene.world = None
    room.leave_terminator()
    floor = next(obj for obj in room.scene.collection.objects if obj.type == "MESH" and obj != room.sphere)
    shown = floor.data.materials[0].node_tree.nodes
    next(n for n in shown if n.type == "BSDF_DIFFUSE").inputs["Color"].default_value = (0.9, 0.9, 0.9, 1)
    return room


@pytest.fixture(scope="module")
def diffuse() -> Array:
    """What Cycles' own closure shows; and that the floor gives at least a third of the light below."""
    with dark_room(diffuse_material(COLOUR)) as room:
        pictures = room.render(128, SEEDS)
        below = lower_third(room.mask())
        floor = next(obj for obj in room.scene.collection.objects if obj.type == "MESH" and obj != room.sphere)
        floor.hide_render = True
        assert room.render(32, 1)[0][below].mean() < 0.7 * pictures[:, below].mean()
    return pictures


@pytest.fixture(scope="module")
def lambert(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A Lambertian whose envelope carries a part, so that each mode has what makes it differ from the others."""
    patch = pytest.MonkeyPatch()

    def part(*arguments: Any, **options: Any) -> EnvelopeFit:
        fit = fit_envelope(*arguments, **options)
        share = np.full_like(fit.residual_share, DECLARED)
        return replace(fit, weights=fit.weights * CARRIED, residual_share=share)

    def declared(*arguments: Any, **options: Any) -> Array:
        shares = lamp_shares(*arguments, **options)
        shares[..., 0] = DECLARED
        return shares

    with patch.context() as patched:
        patched.setattr(reflection, "fit_envelope", part)
        patched.setattr(reflection, "lamp_shares", declared)
        folder = tmp_path_factory.mktemp("dark")
        return read_bundle(bake_source(analytic.Lambert(COLOUR), folder / "lambert", SETTINGS).path)


def lower_third(mask: np.ndarray) -> np.ndarray:
    """Of the pixels of a mask, those in the lower third of its rows."""
    rows = np.nonzero(mask.any(1))[0]
    lower = mask.copy()
    lower[: rows[0] + 2 * (rows[-1] - rows[0]) // 3] = False
    return lower


def assert_diffuse(diffuse: Array, kind: str, show: Callable[[TestScene], None]) -> None:
    """No difference anywhere on the sphere, nor in its lower third; a planted 8 % is found there."""
    with dark_room(diffuse_material(COLOUR)) as room:
        mask = room.mask()
        show(room)
        pictures = room.render(SAMPLES[kind], range(100, 100 + SEEDS))
    for part, finds in ((mask, FINDS), (lower_third(mask), FINDS_BELOW)):
        found = compare(diffuse, pictures, part, tolerance=1e-3)
        print(kind, found)
        assert_agree(found, finds)
    assert not compare(diffuse, 0.92 * pictures, lower_third(mask), tolerance=1e-3).passed


# What is the same closures as in Exact, or the same shader as in nodes, is looked at with --all.
@pytest.mark.parametrize(
    "mode", ["exact", "reference", *(pytest.param(m, marks=pytest.mark.slow) for m in ("balanced", "preview"))]
)
def test_nodes_in_a_dark_room(diffuse: Array, lambert: Bundle, mode: str) -> None:
    material = build_material(lambert, mode=mode, lamps=lamp_image(), lamp_share=True)
    assert_diffuse(diffuse, mode, lambda room: room.show(material))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["exact", "reference"])
def test_osl_in_a_dark_room(diffuse: Array, lambert: Bundle, mode: str) -> None:
    skip_without_osl()

    def show(room: TestScene) -> None:
        use_osl(room.scene)
        room.show(build_osl_material(lambert, mode=mode, lamps=lamp_image()))

    assert_diffuse(diffuse, mode, show)


def test_shading_map_in_a_dark_room(diffuse: Array, tmp_path: Path) -> None:
    """Its mirror alone; what it aims at is chosen by the same nodes, its draws are a lobe's."""
    mean = float(np.mean(COLOUR))
    render = RenderSettings(sigma=mean, mode="reference")
    colour = tuple(c / mean for c in COLOUR)
    bundle = map_bundle(tmp_path / "grey", identity_map(colour=colour), render)  # type: ignore[arg-type]
    assert_diffuse(diffuse, "map", lambda room: room.show(build_shading_map(bundle, lamps=lamp_image())))
