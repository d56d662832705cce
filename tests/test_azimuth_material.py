"""Materials of maps over azimuth in Cycles against quadrature, however the swatch lies; and what others stayed."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.gantry.techniques import direction, errors, frame_uv
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.addon.material.adjust.swatch import set_random_tiling, swatch_mapping
from measured_materials.addon.material.bake_photographs import swatch_from
from measured_materials.addon.material.facts import record_of
from measured_materials.addon.material.rebuild import effects_of, relight
from measured_materials.addon.material.scene_fit import plan_azimuth
from measured_materials.addon.scene_check.check import check_scene, mend
from measured_materials.addon.scene_check.findings import WRONG, Finding
from measured_materials.addon.summary.shading_map_rows import lighting_rows, map_rows
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.source import luminance
from measured_materials.nodes import compat
from measured_materials.nodes.aimed_light_group import SLOTS_KEY
from measured_materials.nodes.group import content_hash
from measured_materials.nodes.lamp_light_groups import SAMPLED_KEY
from measured_materials.nodes.material_tree import measured_nodes
from measured_materials.nodes.osl_script import use_osl
from measured_materials.nodes.shading_map_material import build_shading_map
from measured_materials.nodes.swatch_frame_group import ALONG_U, ALONG_V, is_swatch_frame
from support.azimuth import clamped_basis, write_azimuth_bundle
from support.azimuth_truth import LAYOUTS, LIGHT, VIEW, LaidOut, Texels, azimuth_in
from support.clean_blend import clean_blend  # noqa: F401
from support.eevee import eevee_pictures
from support.monte_carlo import assert_same
from support.osl import skip_without_osl
from support.scenes import TestScene, lit_sphere
from support.sharp_bounces import sharp_bounces  # noqa: F401
from support.swatches import map_bundle, rough_map
from test_addon import registered  # noqa: F401

FINDS = 0.01
LIT = RenderSettings(Lobe("lambert"), sigma=0.8, a_max=0.2)


def basis_of() -> AzimuthBasis:
    """Texels that are held at 0 from some sides, and others with a line under them."""
    basis = clamped_basis(4, 4)
    basis.coefficients[..., 0] += np.float32(0.8)
    return basis


def agrees(path: Path, settings: RenderSettings, layout: str, samples: int, **build: Any) -> None:
    """No difference to quadrature is found, and with a planted 2 % one is."""
    basis = basis_of()
    bundle = write_azimuth_bundle(path / "rough.mmat", basis, settings)
    material = build_shading_map(bundle, **build)
    laid = LaidOut(basis, settings, LAYOUTS[layout])
    expected = laid.picture(settings.a_max)
    with laid.gantry(material, samples) as gantry:
        if build.get("scripted"):
            use_osl(gantry.scene)
        update_scene(gantry.scene)
        sampled = [tree[SLOTS_KEY] for tree in bpy.data.node_groups if SAMPLED_KEY in tree]
        assert all(sampled) and bool(sampled) == ("lights" in build)
        found = np.stack([gantry.render(seed) for seed in range(8)])
    mask = np.ones(expected.shape[:2], bool)
    assert_same(np.stack([expected] * 3), found, mask, 0.0, FINDS)


@pytest.mark.parametrize(
    "layout, settings, samples",
    [
        ("mirrored and sheared", LIT, 256),
        pytest.param("straight", LIT, 256, marks=pytest.mark.slow),
        pytest.param("turned", replace(LIT, above="scale"), 256, marks=pytest.mark.slow),
        pytest.param("mirrored", replace(LIT, mode="reference"), 128, marks=pytest.mark.slow),
        pytest.param("sheared", replace(LIT, lobe=Lobe("phong", 6.0, 0.4)), 128, marks=pytest.mark.slow),
        pytest.param("sheared", replace(LIT, technique="angular"), 512, marks=pytest.mark.slow),
        pytest.param("turned", replace(LIT, technique="lit_texture"), 8, marks=pytest.mark.slow),
        pytest.param("turned", replace(LIT, mode="preview"), 8, marks=pytest.mark.slow),
    ],
)
def test_aimed_mirror_is_what_quadrature_says(
    tmp_path: Path, layout: str, settings: RenderSettings, samples: int
) -> None:
    agrees(tmp_path, settings, layout, samples, lamps=lamp_image())


@pytest.mark.slow
@pytest.mark.parametrize(
    "layout, settings",
    [
        ("mirrored", LIT),
        ("sheared", replace(LIT, lobe=Lobe("phong", 6.0, 0.4))),
        ("mirrored and sheared", replace(LIT, lobe=Lobe("ggx", 0.4))),
    ],
)
def test_sampled_lamps_are_what_quadrature_says(
    tmp_path: Path,
    sharp_bounces: None,  # noqa: F811
    layout: str,
    settings: RenderSettings,
) -> None:
    """By a script's rays, as nodes' of Blender 5.1; all else is nodes that Open Shading Language runs."""
    skip_without_osl()
    agrees(tmp_path, settings, layout, 160, lamps=lamp_image(), lights=lamp_light_image(), scripted=True, pack=True)


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["straight", "mirrored and sheared"])
def test_eevee_shows_the_shadows_of_where_light_comes_from(tmp_path: Path, layout: str) -> None:
    """The sun from above has no azimuth: what is left is that of the other."""
    settings, basis = replace(LIT, a_max=1.6), basis_of()
    bundle = write_azimuth_bundle(tmp_path / "rough.mmat", basis, settings)
    size, shape = 12, LAYOUTS[layout]
    pictures = eevee_pictures(bundle, tmp_path, ["final_radiance", "lit_texture"], VIEW, LIGHT, size, shape)
    wi = np.array(direction(90 - math.degrees(LIGHT[0]), math.degrees(LIGHT[1])))
    texels = Texels.at(basis, (frame_uv(size, VIEW) % 1 @ shape.T).reshape(-1, 2))
    radiance = (wi[2] + np.array([3.0, 2.1, 1.2])) / np.pi
    brightness = luminance(radiance)

    def final_radiance(phi: float) -> np.ndarray:
        x = brightness * settings.sigma / settings.a_max
        return texels.looked_up(x, phi, "scale") * radiance * (settings.a_max / brightness)

    def error(expected: np.ndarray) -> float:
        return errors(pictures["final_radiance"], expected.reshape(size, size, 3))["rms"]

    phi = azimuth_in(shape, wi)
    # EEVEE keeps radiance as half floats, of which the azimuth is a difference.
    assert error(final_radiance(phi)) < 0.01
    assert error(final_radiance(-phi)) > 0.1 and error(final_radiance(phi + 0.5)) > 0.05
    lit = texels.looked_up(1.0, 0.0, "clamp").reshape(size, size, 3)
    assert errors(pictures["lit_texture"], lit * radiance * settings.sigma)["rms"] < 0.01


def frame_of(material: bpy.types.Material) -> bpy.types.Node:
    (node,) = (node for node in material.node_tree.nodes if is_swatch_frame(node))
    return node


def group_of(material: bpy.types.Material) -> bpy.types.Node:
    ((_, node),) = measured_nodes(material.node_tree)
    return node


def test_a_swatch_becomes_one_over_azimuth_and_goes_back(tmp_path: Path) -> None:
    """By *Bake Again*: it gets its frame, of the coordinates that it had before they were tiled at random."""
    arc = map_bundle(tmp_path / "arc", rough_map(), LIT)
    dome = write_azimuth_bundle(tmp_path / "dome.mmat", basis_of(), LIT)
    material = build_shading_map(arc)
    assert ALONG_U not in group_of(material).inputs
    set_random_tiling(material, True)
    build_shading_map(dome, material)
    mapping = swatch_mapping(material)
    assert frame_of(material).inputs["UV"].links[0].from_node == mapping
    for name in (ALONG_U, ALONG_V):
        assert group_of(material).inputs[name].links[0].from_node == frame_of(material)
    set_random_tiling(material, False)
    set_random_tiling(material, True)
    assert frame_of(material).inputs["UV"].links[0].from_node == mapping
    build_shading_map(arc, material)
    assert ALONG_U not in group_of(material).inputs
    build_shading_map(dome, material)
    assert group_of(material).inputs[ALONG_V].links[0].from_node == frame_of(material)
    # What an artist has linked instead stays.
    own = material.node_tree.nodes.new("ShaderNodeTangent")
    material.node_tree.links.new(own.outputs[0], group_of(material).inputs[ALONG_U])
    build_shading_map(dome, material, settings=replace(LIT, mode="reference"))
    assert group_of(material).inputs[ALONG_U].links[0].from_node == own


def test_it_is_lit_anew_of_its_own_textures_when_the_bundle_is_gone(registered: None, tmp_path: Path) -> None:  # noqa: F811
    """In every mode, to the nodes that the bundle would have given."""
    bundle = write_azimuth_bundle(tmp_path / "dome.mmat", basis_of(), LIT)
    material = swatch_from(BakeResult(bundle.path, {}, 0.0), None, pack=True)
    kept = {effect.name: effect.kept for effect in effects_of(material)}
    assert kept["Light from every side"] and kept["Texels"]
    hashes = {}
    for gone in (False, True):
        if gone:
            shutil.rmtree(bundle.path)
        for mode in ("preview", "reference", "exact"):
            relight(material, replace(LIT, mode=mode))
            hashes.setdefault(mode, []).append(content_hash(group_of(material).node_tree))
            assert dict(lighting_rows(record_of(material)))["Technique"] == f"lookup, {mode}, repeat"
    assert all(before == after for before, after in hashes.values()) and len({h for h, _ in hashes.values()}) == 3
    assert dict(map_rows(record_of(material)))["Texels"].startswith(
        "light from every side, 16 azimuths, basis of rank 5"
    )


def found_in(scene: TestScene) -> dict[str, Finding]:
    return {finding.rule: finding for finding in check_scene(scene.scene) or () if "swatch" in finding.rule}


def test_the_check_tells_of_a_frame_that_is_gone_or_of_other_coordinates(tmp_path: Path) -> None:
    material = build_shading_map(write_azimuth_bundle(tmp_path / "dome.mmat", basis_of(), LIT))
    with lit_sphere(material, 16, resolution=16) as scene:
        tree, node = material.node_tree, group_of(material)
        set_random_tiling(material, True)
        assert not found_in(scene)
        tree.links.remove(node.inputs[ALONG_V].links[0])
        gone = found_in(scene)["swatch_frame"]
        assert gone.severity == WRONG and gone.found == "nothing is linked to Along V"
        assert mend([gone]) and not found_in(scene)
        # Straight from the tiling, whose patches jump.
        tree.links.new(node.inputs["UV"].links[0].from_socket, frame_of(material).inputs["UV"])
        apart = found_in(scene)["swatch_frame_apart"]
        assert apart.severity == WRONG and apart.wanted == "linked to Mapping"
        assert mend([apart]) and not found_in(scene)
        assert frame_of(material).inputs["UV"].links[0].from_node == swatch_mapping(material)
        own = tree.nodes.new("ShaderNodeTangent")
        for name in (ALONG_U, ALONG_V):
            tree.links.new(own.outputs[0], node.inputs[name])
        assert not found_in(scene)


@pytest.mark.parametrize(
    "settings, kept, words",
    [
        (LIT, True, "shadows turn with the lamps; 5 texels and 2 of its curves are read for a direction of light"),
        (replace(LIT, lobe=None), True, "5 texels and 6 of its curves are read for a direction of light"),
        (replace(LIT, mode="balanced"), True, "; after a diffuse bounce lit from all around"),
        (replace(LIT, technique="lit_texture"), False, "one picture for all light"),
        (replace(LIT, mode="preview"), False, "one picture for all light"),
    ],
    ids=["exact", "measured", "balanced", "lit texture", "preview"],
)
def test_the_account_tells_what_turning_takes(settings: RenderSettings, kept: bool, words: str) -> None:
    effect = plan_azimuth(settings, 5)
    assert effect.kept == kept and words in effect.why


# Hashes of the groups that were built of `rough_map` before there were maps over azimuth.
TREES = {
    "none, exact, lookup, aimed": "17063521fea80bc9",
    "none, exact, lookup, sampled": "a5d47fa8522fccaf",
    "none, balanced, lookup, aimed": "54d23e3d28bb1cf1",
    "power, exact, lookup, aimed": "78da2f00f7b4aadf",
    "basis, reference, lookup, aimed": "a0b9d042b5d130b3",
    "none, preview, lookup, aimed": "13540c7dea441331",
    "none, exact, lit_texture, aimed": "b9b789296c9b60a2",
    "none, exact, angular, aimed": "ebc4d7f9306e48f9",
}


@pytest.mark.skipif(compat.blender_version() != (4, 5), reason="hashed with the settings of nodes in Blender 4.5")
@pytest.mark.parametrize("name", TREES)
def test_a_swatch_of_one_arc_has_the_nodes_that_it_had(tmp_path: Path, name: str) -> None:
    """So its pictures are the same, bit for bit."""
    compression, mode, technique, sampled = name.split(", ")
    settings = RenderSettings(Lobe("phong", 12.0, 0.4), sigma=0.8, mode=mode, technique=technique, a_max=0.1)
    bundle = map_bundle(tmp_path / "rough", rough_map(), settings, compression=compression)
    lights = {"lights": lamp_light_image(), "scripted": True} if sampled == "sampled" else {}
    material = build_shading_map(bundle, lamps=lamp_image(), features=True, normals=True, **lights)
    assert content_hash(group_of(material).node_tree)[:16] == TREES[name]
