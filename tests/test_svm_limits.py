"""Every kind of graph, at its largest, within the limits of Cycles' SVM; run under 4.5 and 5.0."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import bpy
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image
from measured_materials.addon.material.adjust.blend import blend_with
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.modes import MODES
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.record import read_record
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat, expr
from measured_materials.nodes.adjustments import SOCKETS
from measured_materials.nodes.aimed_light_group import aim_by, can_switch
from measured_materials.nodes.feature_passes import albedo_polynomial, with_feature_outputs
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import assemble
from measured_materials.nodes.second_group import MOST_LAMPS, mask_node
from measured_materials.nodes.shading_map_material import build_shading_map
from support.azimuth import clamped_basis, write_azimuth_bundle
from support.coarse_bakes import coarse_bakes
from support.gloss import link_socket
from support.sheet_scenes import GLAZED, SETTINGS
from support.svm_stack import CLOSURES, aim_at_everything, closures_in, fits_with, room_on_stack
from support.swatches import map_bundle, rough_map

# Floats left for what artists put before the material's inputs: nine nodes that hold a colour and a number each. Where
# all sockets of Adjust are linked their own values take some of it.
ROOM, LINKED = 36, 21
# A map over azimuth of as many curves as there may be leaves six of those nodes: each curve takes a float or two.
ROOM_AROUND = 24
PAINT = analytic.MetallicPaint(diffuse=(0.05, 0.1, 0.3), flake=(0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
BRDFS = {f"{mode}, {filter}": (mode, filter) for mode in MODES for filter in ("trilinear", "bspline")}
MAPS = {
    "lambert": (Lobe("lambert"), "none", "exact", "lookup"),
    "ggx": (Lobe("ggx", 0.4), "none", "exact", "lookup"),
    "oren_nayar": (Lobe("oren_nayar", 0.7), "none", "exact", "lookup"),
    "sheen": (Lobe("sheen", 0.5), "none", "exact", "lookup"),
    "phong": (Lobe("phong", 12.0, 0.4), "none", "exact", "lookup"),
    "phong, cubic": (Lobe("phong_cubic", 12.0, 0.4), "none", "exact", "lookup"),
    "phong, balanced": (Lobe("phong", 12.0, 0.4), "none", "balanced", "lookup"),
    "phong, reference": (Lobe("phong", 12.0, 0.4), "none", "reference", "lookup"),
    "phong, power law": (Lobe("phong", 12.0, 0.4), "power", "exact", "lookup"),
    "phong, basis": (Lobe("phong", 12.0, 0.4), "basis", "exact", "lookup"),
    "phong, angular": (Lobe("phong", 12.0, 0.4), "none", "reference", "angular"),
    "measured": (None, "none", "reference", "lookup"),
    "measured, angular": (None, "none", "reference", "angular"),
}


@pytest.fixture(autouse=True)
def clean_blend() -> Iterator[None]:
    """Materials of one test do not reach the next; most groups serve several."""
    yield
    for material in list(bpy.data.materials):
        bpy.data.materials.remove(material)


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A BRDF whose envelope takes three closures, and a B-spline across its slices, each of which is decoded.

    Its textures may be small.
    """
    settings = BakeSettings(
        resolution=8,
        alpha=(0.5, 0.4),
        storage="log",
        filter="bspline",
        spline="plain",
        sampler=HalfVectorWarp(4, 8, 8, 1e-3),
    )
    with coarse_bakes():
        bundle = read_bundle(bake_source(PAINT, tmp_path_factory.mktemp("svm") / "paint", settings).path)
    assert len(bundle.material["envelope"]["closures"]) == 3
    return bundle


@pytest.fixture(scope="module")
def half_paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """The same over the half vector, whose coordinates take more nodes."""
    sampler = HalfVectorWarp(4, 8, 8, 1e-3)  # of more nodes than alias tables
    settings = BakeSettings(8, "fitted", storage="log", filter="bspline", spline="plain", sampler=sampler, basis="half")
    with coarse_bakes():
        return read_bundle(bake_source(PAINT, tmp_path_factory.mktemp("svm") / "half paint", settings).path)


def brdf_material(bundle: Bundle, name: str) -> bpy.types.Material:
    """Blended, not one slice at random; and with the denoiser's passes."""
    mode, filter = BRDFS[name]
    material = build_material(bundle, mode=mode, filter=filter, stochastic=False, lamps=lamp_image(), lamp_share=True)
    aim_at_everything()
    return with_passes(material, bundle)


def map_material(paint: Bundle, folder: Path, name: str) -> bpy.types.Material:
    """A map lit beyond its brightest photograph; "measured" by f_r from the table of the paint."""
    lobe, compression, mode, technique = MAPS[name]
    render = RenderSettings(lobe, sigma=0.8, mode=mode, technique=technique)
    if lobe is None:
        stack = PhotoStack(rough_map(size=1).slices[1:], tuple("abcde"), None, False, ())
        baked = bake_stack(
            stack, folder / "map", ArcSettings(slices=6, storage=Storage.FLOAT32, brdf=paint.path, render=render)
        )
        bundle = read_bundle(baked.path)
    else:
        render = replace(render, a_max=0.1, above="clamp")
        bundle = map_bundle(folder / "map", rough_map(), render, compression=compression)
    material = build_shading_map(bundle, lamps=lamp_image())
    aim_at_everything()
    return material if lobe is not None else with_passes(material, bundle)


def with_passes(material: bpy.types.Material, bundle: Bundle) -> bpy.types.Material:
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    albedo = albedo_polynomial(read_record(bundle))
    assemble(material, with_feature_outputs(node.node_tree, albedo), (0.5, 0.5, 0.5))
    return material


@pytest.mark.parametrize("floats", [0, 30, 150])
def test_room_is_measured(floats: int) -> None:
    """Of a material that holds so many floats at once, and three that hold what they are made of, the rest is left."""
    material = compat.new_material("known")
    tree = material.node_tree
    with expr.building(tree):
        normal = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Normal"])
        vectors = [expr.scale(normal, k + 2.5) for k in range(floats // 3)]
        total = normal
        for vector in vectors:
            total = total + vector
        for vector in reversed(vectors):
            total = expr.vector_node("MAXIMUM", total, vector)
        made = expr.node("ShaderNodeBsdfDiffuse", {}, {"Color": total})
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(made.outputs[0], output.inputs["Surface"])
    room = room_on_stack(material)
    # Besides: the sum, the normal, the closure's own inputs, and the end of the chain that is measured by.
    assert 255 - 15 - floats <= room <= 255 - floats
    assert closures_in(material) == 1


def test_a_material_that_does_not_compile_is_noticed() -> None:
    material = compat.new_material("too large")
    tree = material.node_tree
    with expr.building(tree):
        normal = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Normal"])
        vectors = [expr.scale(normal, k + 2.5) for k in range(86)]
        total = normal
        for vector in vectors + vectors[::-1]:
            total = expr.vector_node("MAXIMUM", total, vector) + normal
        made = expr.node("ShaderNodeBsdfDiffuse", {}, {"Color": total})
        tree.links.new(made.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    assert not fits_with(material, 0)


@pytest.mark.parametrize("name", BRDFS)
def test_measured_brdfs_leave_room(paint: Bundle, name: str) -> None:
    """Four lamps and the world to aim at, every slice blended, a denoiser's passes."""
    material = brdf_material(paint, name)
    assert fits_with(material, ROOM)
    assert closures_in(material) <= CLOSURES // 4  # a material may be mixed with three others


def test_adjusted_and_blended_brdfs_fit(paint: Bundle, half_paint: Bundle) -> None:
    """All that an artist can link is linked; and a blend, in which fewer lamps are aimed at."""
    material = brdf_material(paint, "balanced, bspline")
    blended = brdf_material(paint, "balanced, bspline")
    blend_with(blended, brdf_material(half_paint, "balanced, bspline"))
    link_socket(blended, mask_node(blended.node_tree).inputs["Mask"], 0.2, 0.8)
    inputs = next(node.inputs for node in material.node_tree.nodes if "Gloss" in node.inputs)
    for name in (*SOCKETS, "Gloss"):
        link_socket(material, inputs[name], 0.5, 1.5)
    assert fits_with(material, LINKED)
    for group in filter(can_switch, bpy.data.node_groups):
        aim_by(group, MOST_LAMPS, world=True)
    assert fits_with(blended, ROOM // 3)
    assert closures_in(blended) <= CLOSURES // 2


@pytest.mark.parametrize("name", BRDFS)
def test_half_vector_brdfs_leave_room(half_paint: Bundle, name: str) -> None:
    material = brdf_material(half_paint, name)
    assert fits_with(material, ROOM)


@pytest.mark.parametrize("name", MAPS)
def test_shading_maps_leave_room(paint: Bundle, tmp_path: Path, name: str) -> None:
    material = map_material(paint, tmp_path, name)
    assert fits_with(material, ROOM)
    assert closures_in(material) <= CLOSURES // 4


@pytest.mark.parametrize("sides, room", [pytest.param("alike", ROOM, marks=pytest.mark.slow), ("differ", 15)])
def test_aimed_sheets_leave_room(tmp_path: Path, sides: str, room: int) -> None:
    """Two mirrors of each side, B-splines, as many lamps as a sheet aims at and the world; and Gloss linked.

    Of sides that differ little is left; with four lamps, or two that are asked how wide they are, they were black.
    """
    sheet = GLAZED if sides == "alike" else type(GLAZED)((0.3, 0.2, 0.1), (0.1,) * 3, (0.1,) * 3, (0.15,) * 3, 8.0)
    with coarse_bakes():
        bundle = read_bundle(bake_source(sheet, tmp_path / sides, replace(SETTINGS, filter="bspline")).path)
    material = build_material(
        bundle, mode="balanced", filter="bspline", lamps=lamp_image(), features=True, normals=True, lamp_share=True
    )
    aim_at_everything()
    assert fits_with(material, room)
    assert closures_in(material) <= CLOSURES // 2
    inputs = next(node.inputs for node in material.node_tree.nodes if "Gloss" in node.inputs)
    link_socket(material, inputs["Gloss"], 0.5, 1.5)
    assert fits_with(material, 3)


@pytest.mark.parametrize(
    "mode, technique, sampled",
    [
        ("balanced", "lookup", False),
        pytest.param("exact", "lookup", True, marks=pytest.mark.slow),
        pytest.param("exact", "angular", False, marks=pytest.mark.slow),
    ],
)
def test_maps_over_azimuth_leave_room(tmp_path: Path, mode: str, technique: str, sampled: bool) -> None:
    """As many curves as there may be, all of which are read for each direction, with levels of detail."""
    settings = RenderSettings(Lobe("phong", 12.0, 0.4), sigma=0.8, mode=mode, technique=technique, a_max=0.1)
    bundle = write_azimuth_bundle(tmp_path / "turned.mmat", clamped_basis(128, 128, rank=23), settings)
    lights = {"lights": lamp_light_image(), "scripted": True} if sampled else {}
    material = build_shading_map(bundle, lamps=lamp_image(), features=not sampled, texels=1.0, **lights)
    aim_at_everything()
    assert fits_with(material, ROOM_AROUND)
    assert closures_in(material) <= CLOSURES // 4


@pytest.mark.slow
def test_figures(paint: Bundle, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """How much room each kind leaves, for the record; shown while the test runs."""
    lines = {}
    for name in BRDFS:
        lines[f"BRDF {name}"] = room_on_stack(brdf_material(paint, name))
    for k, name in enumerate(MAPS):
        folder = tmp_path / str(k)
        folder.mkdir()
        lines[f"map {name}"] = room_on_stack(map_material(paint, folder, name))
    with capsys.disabled():
        print(f"\nBlender {bpy.app.version_string}: floats of SVM stack left, of 255")
        for name, room in lines.items():
            print(f"  {name:30s} {room}")
    assert min(lines.values()) >= ROOM
