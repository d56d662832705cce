"""Anisotropic graphs, at their largest, within the limits of Cycles' SVM; and the whole way from bundle to panel."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.material.build_brdf import build_brdf, usual_choices
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import MODES
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp
from measured_materials.bake.sources import analytic
from measured_materials.nodes.feature_passes import albedo_polynomial, with_feature_outputs
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import assemble
from support.coarse_bakes import coarse_bakes
from support.svm_stack import CLOSURES, aim_at_everything, closures_in, fits_with, room_on_stack

ROOM = 36  # see test_svm_limits.py
SATIN = analytic.Ward(alpha=0.2, alpha_y=0.5, diffuse=(0.3, 0.2, 0.1), specular=0.4)


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    """Materials of one test do not reach the next."""
    yield
    for material in list(bpy.data.materials):
        bpy.data.materials.remove(material)


@pytest.fixture(
    scope="module",
    params=["half auto", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("normal bezier", "normal fitted"))],
)
def satin(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    basis, kind = request.param.split()
    settings = BakeSettings(
        8, kind, storage="log", filter="bspline", sampler=HalfVectorWarp(8, 12, 12), basis=basis, viewers=(5, 3)
    )
    out = tmp_path_factory.mktemp(kind) / "satin"
    with coarse_bakes():
        bundle = read_bundle(bake_source(SATIN, out, settings).path)
    assert len(bundle.material["envelope"]["closures"]) >= 2
    return bundle


def largest(bundle: Bundle, mode: str, filter: str) -> bpy.types.Material:
    """Slices blended where they ever are, four lamps, their share and the world to aim at, a denoiser's passes."""
    material = build_material(bundle, mode=mode, filter=filter, stochastic=False, lamps=lamp_image(), lamp_share=True)
    aim_at_everything()
    node = next(n for n in material.node_tree.nodes if n.name.startswith("Group") and "Tint" in n.inputs)
    albedo = albedo_polynomial(BrdfRecord.read(bundle))
    assemble(material, with_feature_outputs(node.node_tree, albedo), (0.5, 0.5, 0.5))
    return material


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
@pytest.mark.parametrize("mode", ["exact", "balanced", "reference"])
def test_room_is_left(satin: Bundle, mode: str, filter: str) -> None:
    material = largest(satin, mode, filter)
    assert fits_with(material, ROOM)
    assert closures_in(material) <= CLOSURES // 4


@pytest.mark.slow
def test_figures(satin: Bundle, capsys: pytest.CaptureFixture[str]) -> None:
    """How much room each graph leaves, for the record; shown while the test runs."""
    for mode in ("exact", "balanced", "reference"):
        for filter in ("trilinear", "bspline"):
            room = room_on_stack(largest(satin, mode, filter))
            with capsys.disabled():
                print(f"{satin.material['table']['basis']:8s} {mode:10s} {filter:10s} {room}")


@pytest.mark.parametrize("mode", MODES)
def test_built_as_the_panel_does(satin: Bundle, mode: str) -> None:
    """In every mode, rebuilt in place; the tangent stays linked, by whatever an artist has linked to it."""
    material, plan = build_brdf(satin, choices=usual_choices(BrdfRecord.read(satin), mode))
    assert plan.mode == mode
    node = next(n for n in material.node_tree.nodes if "Tint" in n.inputs)
    assert node.inputs["Tangent"].is_linked
    vector = material.node_tree.nodes.new("ShaderNodeCombineXYZ")
    material.node_tree.links.new(vector.outputs[0], node.inputs["Tangent"])
    build_brdf(satin, material, choices=usual_choices(BrdfRecord.read(satin), "reference"))
    assert node.inputs["Tangent"].links[0].from_node == vector
