"""Preview, Balanced, Exact and Reference in Cycles, switched on a material without a bake."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.cli.main import main
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.material import bake_material, build_brdf, rebuild
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.facts import facts_of
from measured_materials.addon.material.kinds import BRDF
from measured_materials.addon.material.textures.kept import textures_of
from measured_materials.addon.scene_check.check import check_scene, mend
from measured_materials.addon.scene_check.findings import Finding, measured_trees
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes import brdf_group, compat, expr
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import trees_below
from measured_materials.nodes.material import build_material
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, compare
from support.scenes import furnace, lit_sphere
from test_addon import registered  # noqa: F401

PAINT = analytic.MetallicPaint(diffuse=(0.05, 0.1, 0.3), flake=(0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.2)
SETTINGS = BakeSettings(resolution=24, alpha=(0.5, 0.4), sampler=SamplerLayout(n_o=24, n_h=24, n_phi=12))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("modes")
    bake_source(PAINT, folder / "paint", SETTINGS)
    return folder


@pytest.fixture
def bundle(folder: Path) -> Bundle:
    return read_bundle(folder / "paint.mmat")


def tinted(material: bpy.types.Material) -> bpy.types.Material:
    """The same material, by its Tint."""
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
    node.inputs["Tint"].default_value = (0.9, 1.0, 0.8, 1)
    return material


def test_preview_has_the_measured_albedo(bundle: Bundle) -> None:
    """Under an even sky, from every elevation the sphere shows; a planted 3 % fails."""
    preview = build_material(bundle, mode="preview")
    with furnace(build_material(bundle, mode="reference"), resolution=48) as scene:
        pictures = scene.render(64, 6)
        scene.show(preview)
        # Preview has the measurement's own albedo, Reference that of its coarse table: 0.8 % apart at the rim.
        found, mask = scene.render(64, range(100, 106)), scene.mask()
        assert_agree(compare(pictures, found, mask, tolerance=0.012), 0.02)
        assert not compare(pictures, 1.03 * found, mask, tolerance=0.012).passed


def test_balanced_is_exact_where_it_is_seen(bundle: Bundle) -> None:
    """Without other surfaces, tinted: sample by sample, which says more than any test of means."""
    exact = tinted(build_material(bundle, mode="exact", lamps=lamp_image()))
    with lit_sphere(exact, lamp_size=0.6, ground=False) as scene:
        scene.leave_terminator()
        picture = scene.render(4, 1)
        scene.show(tinted(build_material(bundle, mode="balanced", lamps=lamp_image())))
        np.testing.assert_allclose(scene.render(4, 1), picture, rtol=1e-6)
        assert picture[:, scene.mask()].min() > 0


def test_balanced_is_preview_after_a_diffuse_bounce(bundle: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a black exact part, matte ground beside the sphere still gets Preview's light, and the sphere is black."""

    def black(self: Any, normal: Any, tint: Any) -> Any:
        made = expr.node("ShaderNodeBsdfDiffuse", {}, {"Color": expr.vec(0.0, 0.0, 0.0), "Normal": normal})
        return expr.Scalar(made.outputs[0])

    with lit_sphere(build_material(bundle, mode="preview"), lamp=False) as scene:
        scene.leave_terminator()
        sphere = scene.mask()
        ground = np.zeros_like(sphere)
        # The mask leaves the sphere's edge out, which is no ground either.
        around = np.any([np.roll(sphere, shift, axis) for shift in range(-4, 5) for axis in (0, 1)], axis=0)
        ground[-12:] = ~around[-12:]
        preview = scene.render(16, 6)
        monkeypatch.setattr(brdf_group.BrdfParts, "traced", black)
        scene.show(build_material(bundle, mode="balanced"))
        balanced = scene.render(16, range(100, 106))
        assert_agree(compare(preview, balanced, ground), 0.01)
        assert balanced[:, sphere].max() < 1e-6 < preview[:, sphere].min()
        # Did the ground not see the sphere, the comparison above would prove nothing.
        scene.sphere.hide_render = True
        assert not compare(preview, scene.render(16, range(200, 206)), ground).passed


def test_a_filter_that_would_misread_fitted_coefficients_is_refused(
    registered: None,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """In the panel, which says why and goes back, and on the command line, of nodes and of OSL."""
    coarse = BakeSettings(8, "uniform", basis="normal", filter="bspline", spline="fitted", envelope=False)
    result = bake_source(PAINT, tmp_path / "paint", coarse)
    quality = bake_material.material_from(result, pack=True).measured_quality
    quality.filter = "nearest"
    assert quality.filter == "auto" and "fitted spline coefficients" in quality.problem
    render = ["render", str(result.path), "--out", str(tmp_path / "paint.png"), "--resolution", "16", "--samples", "1"]
    for options in ([], ["--osl"]):
        assert main([*render, "--filter", "trilinear", *options]) == 1
        assert "which trilinear would take for values" in capsys.readouterr().err
    assert not (tmp_path / "paint.png").exists()


@pytest.fixture
def no_lamps() -> Iterator[None]:
    """The factory scene's lamp cannot be met by a mirror."""
    lamps = [obj for obj in bpy.context.scene.objects if obj.type == "LIGHT"]
    for lamp in lamps:
        lamp.visible_glossy = False
    yield
    for lamp in lamps:
        lamp.visible_glossy = True


@pytest.fixture
def material(registered: None, no_lamps: None, folder: Path, tmp_path: Path) -> bpy.types.Material:  # noqa: F811
    """As imported, its textures packed, and its bundle gone."""
    shutil.copytree(folder / "paint.mmat", tmp_path / "paint.mmat")
    facts = read_bundle(tmp_path / "paint.mmat").material
    result = bake_material.BakeResult(tmp_path / "paint.mmat", facts, 0.0)
    made = bake_material.material_from(result, pack=True)
    shutil.rmtree(tmp_path / "paint.mmat")
    return made


def images_in(tree: bpy.types.NodeTree) -> set[str]:
    found = set()
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree:
            found |= images_in(node.node_tree)
        elif node.bl_idname == "ShaderNodeTexImage" and node.image:
            found.add(node.image.name)
    return found


def test_a_material_changes_its_mode_without_its_bundle(material: bpy.types.Material) -> None:
    """Each mode has the textures it needs and no others, and the first comes back as it was."""
    quality = material.measured_quality
    assert quality.mode == "exact" and BRDF.why_not_rebuildable(material) == ""
    exact = images_in(material.node_tree)
    assert {"residual", "envelope"} <= {name.split()[-1] for name in exact}
    quality.mode = "reference"
    assert not quality.problem
    reference = images_in(material.node_tree)
    assert {name.split()[-1] for name in reference} == {"table", "sampler", "weights", "Lamps", "World"}
    quality.mode = "preview"
    assert images_in(material.node_tree) == images_of_preview(exact)
    quality.mode = "balanced"
    assert images_in(material.node_tree) == exact
    quality.mode = "exact"
    assert images_in(material.node_tree) == exact
    assert set(textures_of(material)) == set(facts_of(material)["images"])
    assert not [image for image in bpy.data.images if not image.users and image.name.startswith("metallic-paint")]


def images_of_preview(names: set[str]) -> set[str]:
    return {name for name in names if name.endswith("preview weights")}


@pytest.mark.parametrize("name", ["residual", "residual_share"])
def test_a_lost_texture_is_read_again(
    registered: None,  # noqa: F811
    no_lamps: None,
    folder: Path,
    late_lamp: Callable[[], bpy.types.Object],
    name: str,
) -> None:
    """Of the bundle that is there still, also one that only a scene of lamps alone calls for."""
    path, scene = folder / "paint.mmat", bpy.context.scene
    made = bake_material.material_from(bake_material.BakeResult(path, read_bundle(path).material, 0.0), pack=True)
    bpy.data.images.remove(textures_of(made)[name])
    late_lamp()
    world, scene.world = scene.world, None
    try:
        rebuild.rebuild_brdf(made, scene=scene)
    finally:
        scene.world = world
    assert name in textures_of(made)
    assert any(tree.name.startswith("MM Mirror Probability") for tree in measured_trees(made))
    path.rename(away := folder / "away")
    try:
        bpy.data.images.remove(textures_of(made)[name])
        assert name in BRDF.why_not_rebuildable(made)
    finally:
        away.rename(path)


def test_the_account_says_what_was_left_out(material: bpy.types.Material) -> None:
    effects = {effect.name: effect for effect in rebuild.effects_of(material)}
    assert effects["Mirror part"].kept and not effects["Aimed light"].kept
    material.measured_quality.aim = "always"
    effects = {effect.name: effect for effect in rebuild.effects_of(material)}
    assert effects["Aimed light"].kept and any(name.startswith("MM Lamps") for name in images_in(material.node_tree))


def test_a_refused_choice_is_told_and_taken_back(material: bpy.types.Material) -> None:
    quality, before = material.measured_quality, images_in(material.node_tree)
    quality.residual = "never"
    assert "needs its mirror part" in quality.problem and quality.residual == "auto"
    assert images_in(material.node_tree) == before


def test_fit_to_scene_aims_once_there_is_a_lamp(material: bpy.types.Material) -> None:
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("card")
    mesh.materials.append(material)
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "AREA"))
    objects = [bpy.data.objects.new("card", mesh), lamp]
    try:
        for obj in objects:
            scene.collection.objects.link(obj)
        assert bpy.ops.measured_materials.fit_to_scene() == {"FINISHED"}
        assert {e.name: e.kept for e in rebuild.effects_of(material)}["Aimed light"]
        lamp.visible_glossy = False
        assert bpy.ops.measured_materials.fit_to_scene() == {"FINISHED"}
        assert not {e.name: e.kept for e in rebuild.effects_of(material)}["Aimed light"]
    finally:
        for obj in objects:
            bpy.data.objects.remove(obj)


@pytest.fixture
def card(material: bpy.types.Material) -> Iterator[bpy.types.Object]:
    """Wears the material, in the window's scene."""
    mesh = bpy.data.meshes.new("card")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [], [(0, 1, 2)])
    mesh.materials.append(material)
    card = bpy.data.objects.new("card", mesh)
    bpy.context.scene.collection.objects.link(card)
    bpy.context.view_layer.update()
    yield card
    bpy.data.objects.remove(card)


@pytest.fixture
def late_lamp() -> Iterator[Callable[[], bpy.types.Object]]:
    """Called, it puts a lamp into the window's scene."""
    made = []

    def add() -> bpy.types.Object:
        made.append(bpy.data.objects.new("late", bpy.data.lights.new("late", "AREA")))
        bpy.context.scene.collection.objects.link(made[0])
        bpy.context.view_layer.update()
        return made[0]

    yield add
    for lamp in made:
        bpy.data.objects.remove(lamp)


def slots(material: bpy.types.Material) -> list[int]:
    return [tree[SLOTS_KEY] for tree in measured_trees(material) if SLOTS_KEY in tree]


def test_lamps_may_come_after_the_material(
    material: bpy.types.Material, card: bpy.types.Object, late_lamp: Callable[[], bpy.types.Object]
) -> None:
    """The ordinary order of work: import, then light; in each mode, and as the artist changes it."""
    assert slots(material) == [0] and "10 %" in {e.name: e.why for e in rebuild.effects_of(material)}["Aimed light"]
    material.measured_quality.mode = "reference"
    assert slots(material) == [0]
    late_lamp()
    assert slots(material) == [1]
    material.measured_quality.mode = "exact"
    bpy.context.view_layer.update()
    assert slots(material) == [1]


def test_fitted_to_a_scene_without_lamps_the_next_lamp_is_told(
    material: bpy.types.Material, card: bpy.types.Object, late_lamp: Callable[[], bpy.types.Object]
) -> None:
    scene = bpy.context.scene
    world, scene.world = scene.world, None
    try:
        assert bpy.ops.measured_materials.fit_to_scene() == {"FINISHED"}
        assert slots(material) == []
        assert "not_aimed" not in {finding.rule for finding in check_scene(scene) or ()}
        late_lamp()
        (told,) = (finding for finding in check_scene(scene) or () if finding.rule == "not_aimed")
        assert told.severity == "slow" and mend([told]) == [told]
        bpy.context.view_layer.update()
        assert slots(material) == [1]
        assert "not_aimed" not in {finding.rule for finding in check_scene(scene) or ()}
        material.measured_quality.aim = "never"
        assert "not_aimed" not in {finding.rule for finding in check_scene(scene) or ()}
    finally:
        scene.world = world


def test_normal_pass_is_fitted_by_the_scene_check(material: bpy.types.Material) -> None:
    """Told where a view layer shows it, mended by a build for it, and gone again with the pass."""
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("card")
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("card", mesh))

    def told() -> list[Finding]:
        return [finding for finding in check_scene(scene) or () if finding.rule == "normal_pass"]

    layer = scene.view_layers[0]
    assert not told()
    layer.use_pass_normal = True
    try:
        (finding,) = told()
        assert mend([finding]) == [finding] and not told()
        assert {e.name: e.kept for e in rebuild.effects_of(material)}["Normal pass"]
    finally:
        layer.use_pass_normal = False
    rebuild.rebuild_brdf(material)
    assert "Normal pass" not in {e.name for e in rebuild.effects_of(material)}


def test_denoising_by_materials_comes_and_goes(material: bpy.types.Material) -> None:
    """Passes, compositor and the nodes that write them; without them the material is as it was."""
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("card")
    mesh.materials.append(material)
    card = bpy.data.objects.new("card", mesh)
    scene.collection.objects.link(card)

    def writes() -> bool:
        # Not of the whole file: other tests leave groups there.
        return any(n.bl_idname == "ShaderNodeOutputAOV" for tree in trees_below(material.node_tree) for n in tree.nodes)

    scene.render.engine = "BLENDER_WORKBENCH"
    assert not bpy.ops.measured_materials.denoise.poll()
    scene.render.engine = "CYCLES"
    try:
        assert not writes() and not build_brdf.asks_for_passes(scene)
        assert bpy.ops.measured_materials.denoise() == {"FINISHED"}
        assert writes() and build_brdf.asks_for_passes(scene)
        assert {e.name: e.kept for e in rebuild.effects_of(material)}["Denoiser's passes"]
        assert bpy.ops.measured_materials.denoise(stop=True) == {"FINISHED"}
        assert not writes() and not build_brdf.asks_for_passes(scene)
    finally:
        bpy.data.objects.remove(card)


def test_a_bundle_without_native_closures_says_what_to_do(tmp_path: Path, registered: None) -> None:  # noqa: F811
    settings = BakeSettings(resolution=8, alpha=(0.5, 0.5), envelope=False)
    made = bake_material.material_from(bake_source(analytic.Ggx(), tmp_path / "plain", settings), pack=True)
    assert made.measured_quality.mode == "reference"
    with pytest.raises(BakeError, match="bake it again with Cycles' Own Shaders"):
        rebuild.rebuild_brdf(made, Choices(mode="balanced"))
    made.measured_quality.mode = "exact"
    assert "Cycles' Own Shaders" in made.measured_quality.problem and made.measured_quality.mode == "reference"
    made.measured_quality.mode = "preview"
    assert not made.measured_quality.problem


def test_fit_to_scene_looks_at_a_sky(material: bpy.types.Material) -> None:
    """A sky with a sun disc is aimed at once its nodes have been rendered; an even world is not."""
    scene, before = bpy.context.scene, bpy.context.scene.world
    mesh = bpy.data.meshes.new("card")
    mesh.materials.append(material)
    card = bpy.data.objects.new("card", mesh)
    scene.collection.objects.link(card)
    scene.world, background = compat.new_world("sky")
    try:
        assert bpy.ops.measured_materials.fit_to_scene() == {"FINISHED"}
        assert not {e.name: e.kept for e in rebuild.effects_of(material)}["Aimed light"]
        sky = scene.world.node_tree.nodes.new("ShaderNodeTexSky")
        scene.world.node_tree.links.new(sky.outputs[0], background.inputs["Color"])
        assert bpy.ops.measured_materials.fit_to_scene() == {"FINISHED"}
        aimed = {e.name: e for e in rebuild.effects_of(material)}["Aimed light"]
        assert aimed.kept and "the world" in aimed.why
    finally:
        bpy.data.objects.remove(card)
        bpy.data.worlds.remove(scene.world)
        scene.world = before
