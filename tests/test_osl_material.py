"""OSL materials in Cycles: against Diffuse BSDF, against the same material of nodes, and what building one refuses."""

from __future__ import annotations

import importlib
import shutil
import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes import compat, expr
from measured_materials.nodes.group import call, node_group
from measured_materials.nodes.local_frame_group import to_world, viewer_frame_group
from measured_materials.nodes.material import build_material
from measured_materials.nodes.native_closure import native_closure
from measured_materials.nodes.osl_material import build_osl_material
from measured_materials.nodes.osl_parts import sampler_constants, table_constants
from measured_materials.nodes.osl_script import output, script_node, shader_source, use_osl, with_headers
from measured_materials.nodes.stochastic_mirror_group import random_numbers_group
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_same
from support.osl import assert_preview_on_the_ground, assert_shows_nodes_in_eevee, closures_of_group, skip_without_osl
from support.scenes import TestScene, diffuse_material, furnace, lit_sphere
from support.swatches import identity_map, map_bundle

EFFECT = 0.01


@pytest.fixture(autouse=True, scope="module")
def osl() -> None:
    skip_without_osl()


@pytest.fixture(scope="module")
def grey(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Lambert of albedo 0.5: its envelope is Diffuse BSDF itself."""
    sampler = SamplerLayout(n_o=16, n_h=16, n_phi=16, warp_power=1)
    settings = BakeSettings(resolution=8, storage="float32", alpha=(0.5, 0.5), sampler=sampler)
    return read_bundle(bake_source(analytic.Lambert(), tmp_path_factory.mktemp("größer, grau") / "grey", settings).path)


@pytest.fixture(scope="module")
def paint(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Colour, gloss of two widths, and a residual that is a third of the light."""
    source = analytic.MetallicPaint((0.05, 0.1, 0.3), (0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
    sampler = SamplerLayout(n_o=32, n_h=32, n_phi=16)
    settings = BakeSettings(resolution=24, alpha=(0.5, 0.4), sampler=sampler)
    return read_bundle(bake_source(source, tmp_path_factory.mktemp("paint") / "paint", settings).path)


def show_osl(scene: TestScene, material: bpy.types.Material) -> None:
    use_osl(scene.scene)
    scene.show(material)


def tinted(material: bpy.types.Material) -> bpy.types.Material:
    """The same material, by its Tint."""
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    node.inputs["Tint"].default_value = (0.9, 1.0, 0.8, 1)
    return material


SLOW = [
    pytest.param(*case, marks=pytest.mark.slow)
    for case in (("reference", 32, True), ("exact", 16, True), ("exact", 16, False))
]


@pytest.mark.parametrize("mode, samples, aimed", [("reference", 32, False), *SLOW])
def test_grey_lambert_equals_diffuse(grey: Bundle, mode: str, samples: int, aimed: bool) -> None:
    """Sky, bounce light and, where it is aimed at, a lamp; a planted error of 2 % fails the same test."""
    # The envelope may exceed the measurement by 0.1 %, its budget.
    tolerance = 0.001 if mode == "exact" else 0.0
    with lit_sphere(diffuse_material(0.5), lamp=aimed, lamp_size=0.8, resolution=32) as scene:
        scene.leave_terminator()
        reference = scene.render(24, 6)
        # Built where the table of lamps is still empty: OSL reads it as it is when rendering.
        material = build_osl_material(grey, mode=mode, lamps=lamp_image() if aimed else None)
        show_osl(scene, material)
        assert_same(reference, scene.render(samples, range(30, 38)), scene.mask(), tolerance, EFFECT)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["exact", "reference", "balanced"])
def test_osl_is_the_material_of_nodes(paint: Bundle, mode: str) -> None:
    """Gloss, tinted, under sky and a small lamp that both aim at, with bounce light; a planted 2 % is found."""
    nodes = tinted(build_material(paint, mode=mode, lamps=lamp_image()))
    with lit_sphere(nodes, lamp_size=0.8, resolution=40) as scene:
        scene.leave_terminator()
        pictures = scene.render(64, 8)
        show_osl(scene, tinted(build_osl_material(paint, mode=mode, lamps=lamp_image())))
        assert_same(pictures, scene.render(64, range(30, 38)), scene.mask(), 0.0, EFFECT)


def test_balanced_is_exact_until_a_diffuse_bounce(paint: Bundle) -> None:
    """The same picture without other surfaces; on matte ground it is Preview's, its light having bounced there."""
    exact, balanced, preview = (build_osl_material(paint, mode=mode) for mode in ("exact", "balanced", "preview"))
    with lit_sphere(exact, ground=False, resolution=32) as scene:
        use_osl(scene.scene)
        seen = scene.render(4, 1)
        scene.show(balanced)
        assert (scene.render(4, 1) == seen).all()
    assert_preview_on_the_ground(exact, balanced, preview)


def test_preview_is_the_same_picture(paint: Bundle) -> None:
    """Closures alone draw no random number of ours: under equal seeds OSL and nodes differ by rounding."""
    with lit_sphere(tinted(build_material(paint, mode="preview")), resolution=40) as scene:
        picture = scene.render(4, 1)
        show_osl(scene, tinted(build_osl_material(paint, mode="preview")))
        found = scene.render(4, 1)
    # A path may take another turn where rounding decides.
    assert (np.abs(found - picture) > 1e-4 * np.maximum(picture, 1e-3)).mean() < 1e-3


CLOSURES = [Lobe("lambert"), Lobe("ggx", 0.04), Lobe("ggx", 0.5), Lobe("sheen", 0.4), Lobe("oren_nayar", 0.6)]


@pytest.mark.parametrize("lobe", CLOSURES, ids=lambda lobe: f"{lobe.name} {lobe.p1}")
def test_native_closures_are_those_of_nodes(lobe: Lobe) -> None:
    """One sample under equal seeds: no noise between the two."""
    nodes, script = compat.new_material("nodes"), compat.new_material("osl")
    text = f'shader one(output closure color BSDF = 0) {{ BSDF = color(0.2, 0.5, 0.8) * mm_native("{lobe.name}", '
    text = f'#include "measured_materials.h"\n{text} {lobe.p1}, {lobe.p1}, vector(0), N, 1); }}'
    with expr.building(nodes.node_tree) as tree:
        colour = expr.Vector(expr.node("ShaderNodeCombineXYZ", {}, {0: 0.2, 1: 0.5, 2: 0.8}).outputs[0])
        normal = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Normal"])
        feed_surface(tree, native_closure(lobe, colour, normal))
    with expr.building(script.node_tree) as tree:
        feed_surface(tree, output(script_node("one.osl", with_headers("one.osl", text), {}), "BSDF"))
    with lit_sphere(nodes, 24, lamp_size=0.1, ground=False, resolution=32) as scene:
        picture = scene.render(2, 1)
        show_osl(scene, script)
        found = scene.render(2, 1)
        # At the silhouette Cycles' own Sheen BSDF, too, differs between SVM and OSL.
        inside = scene.mask()
    # Oren-Nayar of nodes is a colour of 10 000 times 1 / 10 000.
    assert (np.abs(found - picture) <= 1e-4 * np.maximum(picture, 1e-3))[:, inside].all()
    assert picture[:, inside].mean() > 0.01


def feed_surface(tree: bpy.types.NodeTree, closure: Any) -> None:
    expr.feed(tree, tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"], closure)


def test_parts_make_a_material(grey: Bundle) -> None:
    """Sampler, lookup and mirror as three Script nodes between ordinary ones: in a furnace the albedo is seen."""
    baked = BrdfRecord.read(grey).baked()

    def build() -> Any:
        geometry = expr.node("ShaderNodeNewGeometry", {}, {}).outputs
        normal, incoming = expr.Vector(geometry["Normal"]), expr.Vector(geometry["Incoming"])
        wo, tangent, bitangent = call(viewer_frame_group(), normal, incoming)
        u = call(random_numbers_group())
        names = ("RandomCell", "RandomAlias", "RandomU", "RandomV")
        drawn = part("measured_sampler.osl", {"wo": wo, **dict(zip(names, u)), **sampler_constants(baked)})
        wi, pdf = output(drawn, "wi"), output(drawn, "pdf")
        lookup = part("measured_lookup.osl", {"wi": wi, "wo": wo, "Random": u[4], **table_constants(baked)})
        gain = expr.divide(expr.maximum(expr.components(wi)[2], 0.0), pdf)
        weight = expr.scale(output(lookup, "BRDF"), gain)
        world = to_world(wi, tangent, bitangent, normal)
        return output(part("measured_mirror.osl", {"Direction": world, "Weight": weight, "Random": u[5]}), "BSDF")

    material = compat.new_material("parts")
    with expr.building(material.node_tree) as tree:
        feed_surface(tree, call(node_group("parts", {}, {"BSDF": "shader"}, build)))
    material.cycles.use_bump_map_correction = False
    with furnace(material, resolution=40) as scene:
        use_osl(scene.scene)
        middle = scene.render(64, 2)[:, 12:28, 12:28].mean()
    # 256 pixels of 128 samples, whose weights vary by half: 0.3 % is one deviation of the mean.
    assert middle == pytest.approx(0.5, rel=0.012)


def part(name: str, inputs: dict[str, Any]) -> Any:
    return script_node(name, shader_source(name), inputs)


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_WORKBENCH"])
def test_the_blend_holds_the_compiled_shader_and_no_folder(
    grey: Bundle, engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shaders themselves are in the nodes, the compiler's temporary files and search paths are not."""
    monkeypatch.setattr(bpy.context.scene.render, "engine", engine)
    material = build_osl_material(grey, lamps=lamp_image())
    group = next(n.node_tree for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    shown = {}
    for script in (n for n in group.nodes if n.bl_idname == "ShaderNodeScript"):
        assert script.mode == "INTERNAL" and script.bytecode.startswith("OpenShadingLanguage")
        for text in (script.bytecode, script.script.as_string()):
            assert tempfile.gettempdir() + "/" not in text and str(Path(bpy.__file__).parent) not in text
        inputs = {socket.identifier for socket in script.inputs if not socket.hide and socket.is_linked}
        shown[script.script.name] = inputs
    assert set(shown) == {"measured_world.osl", "measured_aim.osl", "measured_material.osl"}
    assert {"Normal", "Sky", "Centre1", "Facts4", "Alias"} <= shown["measured_aim.osl"]
    seen = shown["measured_material.osl"]
    assert {"Normal", "Tint", "Sky", "Direction", "WorldTexel"} <= seen and "Table" not in seen


def test_building_again_keeps_links_and_leaves_nothing(grey: Bundle) -> None:
    """In place, from nodes to OSL and from mode to mode, for users and links of Normal; old groups and texts go."""
    material = build_material(grey)
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    bump = material.node_tree.nodes.new("ShaderNodeBump")
    material.node_tree.links.new(bump.outputs[0], node.inputs["Normal"])
    for mode in ("exact", "reference", "exact"):
        assert build_osl_material(grey, material, mode=mode) == material
        assert node.inputs["Normal"].links[0].from_node == bump
        assert [t.name for t in bpy.data.texts] == ["measured_material.osl"]
    scripted = [t for t in bpy.data.node_groups if any(n.bl_idname == "ShaderNodeScript" for n in t.nodes)]
    assert scripted == [node.node_tree]


def test_switched_to_osl_the_viewport_keeps_the_preview(grey: Bundle) -> None:
    """Built of nodes before, or fresh: EEVEE shows mode Preview of nodes, in all modes."""
    preview = build_material(grey, mode="preview")
    for material in (build_material(grey), None):
        for mode in ("exact", "reference", "preview"):
            material = build_osl_material(grey, material, mode=mode)
            assert_shows_nodes_in_eevee(material, closures_of_group(preview))


def test_two_nodes_of_one_shader_stay_two() -> None:
    """Each with inputs of its own, of one text."""
    text = "shader twice(float x = 0, output float y = 0) { y = 2 * x; }"
    with expr.building(compat.new_material("two").node_tree):
        first, second = (script_node("twice.osl", text, {"x": x}) for x in (1.0, 2.0))
    assert first != second and first.script == second.script
    assert [node.inputs[0].default_value for node in (first, second)] == [1.0, 2.0]


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_WORKBENCH"])
def test_compile_errors_name_the_line(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bpy.context.scene.render, "engine", engine)
    tree = compat.new_material("broken").node_tree
    text = '#include "measured_materials.h"\nshader broken(output color C = 0) {\n  C = missing(1); }'
    with expr.building(tree), pytest.raises(BakeError, match=r"broken\.osl:3: .*missing"):
        script_node("broken.osl", with_headers("broken.osl", text), {})
    assert not tree.nodes and not bpy.data.texts


def test_a_blender_without_osl_says_so(grey: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.import_module("_cycles"), "with_osl", False)
    with pytest.raises(BakeError, match="Open Shading Language: is not part of this Blender"):
        build_osl_material(grey)
    assert not bpy.data.node_groups and not bpy.data.materials


@pytest.mark.parametrize("choice", [{"mode": "fast"}, {"filter": "smooth"}])
def test_unknown_choices_are_refused(grey: Bundle, choice: dict[str, str]) -> None:
    with pytest.raises(BakeError, match="cannot be"):
        build_osl_material(grey, **choice)


def test_bundles_that_osl_cannot_show_are_refused(tmp_path: Path, grey: Bundle) -> None:
    """Shading maps, and folders whose name OpenImageIO would read as a pattern."""
    with pytest.raises(BakeError, match="only BRDFs"):
        build_osl_material(map_bundle(tmp_path / "map", identity_map(), RenderSettings(sigma=0.5)))
    odd = tmp_path / "odd%04d.mmat"
    shutil.copytree(grey.path, odd)
    with pytest.raises(BakeError, match="holds '%'"):
        build_osl_material(read_bundle(odd))
