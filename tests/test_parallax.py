"""Parallax under a shading map: the formula by tracing rays, the node group by the formula, in and out of materials."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.cli import render
from measured_materials.addon.cli.main import main
from measured_materials.addon.gantry.photograph_arc import gantry_scene
from measured_materials.addon.gantry.techniques import direction, frame_uv
from measured_materials.addon.material.adjust.parallax import (
    add_parallax,
    keeps_textures,
    parallax_node,
    remove_parallax,
    without_unfit_parallax,
)
from measured_materials.addon.material.adjust.swatch import random_tiling_node, set_random_tiling
from measured_materials.addon.material.facts import keep_facts
from measured_materials.addon.scene_check.swatch_rules import _swatches
from measured_materials.bake import xp_numpy
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.bilinear import texels_around
from measured_materials.bake.images.image_io import read_image
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.maps.folder import read_maps_folder
from measured_materials.bake.maps.parallax import LAYERS, LEAST_COSINE, seen_at
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.nodes import compat, expr
from measured_materials.nodes.group import HASH_KEY, call, content_hash
from measured_materials.nodes.material_tree import measured_nodes
from measured_materials.nodes.parallax_group import PARALLAX
from measured_materials.nodes.shading_map_material import build_shading_map
from measured_materials.nodes.surface_inputs import coordinates_before_tiling, frame_before, source_of
from measured_materials.nodes.swatch_frame_group import ALONG_U, is_swatch_frame, swatch_frame_group
from support.azimuth_truth import LAYOUTS
from support.cards import card
from support.known_maps import N, relief, write_folder
from support.stacks import write_stack
from support.swatches import identity_map, map_bundle, rough_map
from test_addon import registered  # noqa: F401

STEP = np.array([0.9, -0.6, 0.0])
PLACES = np.random.default_rng(2).uniform(-1, 2, (500, 3)) * np.array([1.0, 1.0, 0.0])


def waves(place: np.ndarray) -> np.ndarray:
    """Smooth, from -0.05 to 0.05."""
    return 0.03 * np.sin(2 * np.pi * place[..., 0]) + 0.02 * np.cos(4 * np.pi * place[..., 1])


def traced(height: Any, place: np.ndarray, step: np.ndarray, low: float, high: float) -> np.ndarray:
    """Height of the first point of the ray below the relief, in 20,000 steps."""
    found = np.full(len(place), low)
    open_ = np.ones(len(place), bool)
    for level in np.linspace(high, low, 20_000):
        hit = open_ & (height(place + level * step) >= level)
        found[hit] = level
        open_ &= ~hit
    return found


# --- formula ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [(0.6, 0.0, 0.0), (-0.8, 1.1, 0.0), (1.5, -1.5, 0.0)])
def test_a_ray_meets_the_relief_where_tracing_finds_it(step: tuple[float, float, float]) -> None:
    step_ = np.array(step)
    found = seen_at(xp_numpy, waves, PLACES, step_, -0.05, 0.05, 32)
    truth = PLACES + traced(waves, PLACES, step_, -0.05, 0.05)[:, None] * step_
    assert np.abs(found - truth).max() < 2e-4
    # In as many layers as the shader has; the relief's own effect is hundreds of times that.
    few = seen_at(xp_numpy, waves, PLACES, step_, -0.05, 0.05)
    assert np.abs(few - truth).max() < 2e-3 and np.abs(PLACES - truth).max() > 0.025


def test_a_plateau_moves_what_lies_on_it_and_hides_what_is_behind() -> None:
    def wall(place: np.ndarray) -> np.ndarray:
        return np.where((place[..., 0] > 0.4) & (place[..., 0] < 0.6), 0.1, 0.0)

    x = np.linspace(0, 1, 201) + 1e-3
    place = np.stack([x, 0 * x, 0 * x], -1)
    # The viewer stands at larger x: rays run down towards smaller x.
    seen = seen_at(xp_numpy, wall, place, np.array([1.0, 0.0, 0.0]), 0.0, 0.1)[:, 0]
    # Closer to its edge than a layer is thick, a ray may pass it by.
    on_top, hidden = (x > 0.32) & (x < 0.49), (x > 0.51) & (x < 0.59)
    np.testing.assert_allclose(seen[on_top], x[on_top] + 0.1, atol=1e-9)
    free = (x < 0.29) | (x > 0.61)
    np.testing.assert_allclose(seen[free], x[free], atol=1e-9)
    # Of the wall's side, within the thickness of a layer of where a ray meets it.
    assert np.abs(seen[hidden] - 0.6).max() < 0.1 / LAYERS


def test_a_flat_swatch_stays_where_it_is() -> None:
    def flat(place: np.ndarray) -> np.ndarray:
        return np.zeros(place.shape[:-1])

    step = np.array([3.0, -2.0, 0.0])
    assert np.array_equal(seen_at(xp_numpy, flat, PLACES, step, 0.0, 0.0), PLACES)
    # At its own height, wherever that is within the range.
    raised = seen_at(xp_numpy, lambda place: flat(place) + 0.03, PLACES, step, -0.1, 0.2)
    np.testing.assert_allclose(raised, PLACES + 0.03 * step, atol=1e-12)


# --- node group ---------------------------------------------------------------------------------------------


def emitting(group: bpy.types.ShaderNodeTree, depth: float, turn: np.ndarray) -> bpy.types.Material:
    """Shows the moved coordinates, of UVs that are laid out by this matrix, raised by 2."""
    material = compat.new_material("coordinates")
    with expr.building(material.node_tree) as tree:
        u, v, _ = expr.components(expr.Vector(expr.node("ShaderNodeUVMap", {}, {}).outputs["UV"]))
        uv = expr.vec(u * float(turn[0, 0]) + v * float(turn[0, 1]), u * float(turn[1, 0]) + v * float(turn[1, 1]), 0.0)
        moved = call(group, uv, *call(swatch_frame_group(), uv), depth)
        emission = expr.node("ShaderNodeEmission", {}, {"Color": moved + expr.vec(2.0, 2.0, 2.0)})
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


@pytest.mark.parametrize("layout, kind", [("straight", "png16"), ("turned", "exr")])
def test_the_group_is_the_formula(swatch: Any, tmp_path: Path, layout: str, kind: Any) -> None:
    """Seen obliquely, by a Cycles that averages over each pixel: whatever way the swatch lies, whatever file holds the
    heights, whose unit is the width of the picture."""
    size, view, turn = 12, (math.radians(50), math.radians(30)), LAYOUTS[layout]
    height = relief()[0] / N
    low, high = float(height.min()), float(height.max())
    made = add_parallax(*swatch, read_maps_folder(write_folder(tmp_path / "maps", kind=kind)))
    material = emitting(made.node_tree, 0.7, turn)
    with gantry_scene(material, size=size, samples=256) as gantry:
        gantry.set_view(*view)
        gantry.set_light(0, 0)
        seen = gantry.render() - 2
    bpy.data.materials.remove(material)

    def tapped(place: np.ndarray) -> np.ndarray:
        return np.sum([w * 0.7 * height[index] for index, w in texels_around((N, N), place[..., :2])], axis=0)

    over = 16
    # Beside the tile lie others, each with its own coordinates from 0 to 1.
    uv = (frame_uv(size, view, over) % 1) @ turn.T
    wo = np.array(direction(90 - 50, 30))
    step = np.append(turn @ wo[:2], 0.0) / max(wo[2], LEAST_COSINE)
    place = np.concatenate([uv, np.zeros_like(uv[..., :1])], -1)
    wanted = seen_at(xp_numpy, tapped, place, step, 0.7 * low, 0.7 * high)
    mean = wanted.reshape(size, over, size, over, 3).mean((1, 3))
    flat = place.reshape(size, over, size, over, 3).mean((1, 3))
    # 256 points of a pixel, as far from the tile's border as not to see coordinates jump.
    inside = ((frame_uv(size, view) > 0.06) & (frame_uv(size, view) < 0.94)).all(-1)
    off, moved = np.abs(seen - mean)[inside], np.abs(flat - mean)[inside]
    assert off.max() < 0.012 and off.mean() < 0.1 * moved.mean() and moved.max() > 0.03


def test_relief_goes_on_beyond_the_border_as_the_swatch_does(tmp_path: Path) -> None:
    """Also in a material that is set to the other way: what is linked, the depth and the heights stay."""
    bundle = map_bundle(tmp_path / "felt.mmat", identity_map(size=8), RenderSettings(Lobe("lambert"), 0.5))
    record = ShadingMapRecord.read(bundle)
    material, maps = build_shading_map(bundle), read_maps_folder(write_folder(tmp_path / "maps", kind="exr"))
    made = add_parallax(material, record, maps, tiling="extend")
    made.inputs["Depth"].default_value = 0.7
    sources = [source_of(socket) for socket in made.inputs if socket.is_linked]
    height = relief()[0] / N
    for tiling in ("extend", "repeat", "extend"):
        build_shading_map(bundle, material, settings=replace(record.render, tiling=tiling))
        assert parallax_node(material) == made and made.inputs["Depth"].default_value == pytest.approx(0.7)
        assert [source_of(socket) for socket in made.inputs if socket.is_linked] == sources

        def tapped(place: np.ndarray, tiling: str = tiling) -> np.ndarray:
            half = 0.5 / N
            uv = place[..., :2] % 1 if tiling == "repeat" else np.clip(place[..., :2], half, 1 - half)
            return np.sum([w * height[index] for index, w in texels_around((N, N), uv)], axis=0)

        u, v = np.meshgrid(*(np.linspace(-0.45, 1.45, 16),) * 2)
        place = np.stack([u, v, np.zeros_like(u)], -1).reshape(-1, 3).astype(np.float32)
        wanted = seen_at(xp_numpy, tapped, place, STEP, float(height.min()), float(height.max()))
        # On a card the viewer looks along z: what counts of the frame's axes is theirs.
        (found,) = card(lambda uv: call(made.node_tree, uv, *((0.0, 0.0, float(x)) for x in STEP[:2]), 1.0), place)
        assert np.abs(found - wanted)[:, :2].max() < 2e-4
        assert made.node_tree[HASH_KEY] == content_hash(made.node_tree)


def test_relief_follows_the_border_whose_heights_are_lost(swatch: Any, tmp_path: Path) -> None:
    """A change of the tiling succeeds, and leaves behind no group that nothing uses."""
    material, record = swatch
    folder = write_folder(tmp_path / "maps", kind="exr")
    made = add_parallax(material, record, read_maps_folder(folder))
    (image,) = {node.image for node in made.node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"}
    (folder / Path(image.filepath).name).unlink()
    image.reload()
    assert tuple(image.size) == (0, 0)
    groups = sum(tree.name.startswith(PARALLAX) for tree in bpy.data.node_groups)
    for tiling in ("extend", "repeat", "extend"):
        build_shading_map(record, material, settings=replace(record.render, tiling=tiling))
        taps = [node for node in made.node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"]
        assert taps and {tap.extension for tap in taps} == {tiling.upper()} and {tap.image for tap in taps} == {image}
        assert sum(tree.name.startswith(PARALLAX) for tree in bpy.data.node_groups) == groups


# --- materials ----------------------------------------------------------------------------------------------


@pytest.fixture()
def swatch(tmp_path: Path) -> tuple[bpy.types.Material, ShadingMapRecord]:
    bundle = map_bundle(tmp_path / "felt.mmat", identity_map(size=8), RenderSettings(Lobe("lambert"), 0.5))
    return build_shading_map(bundle), ShadingMapRecord.read(bundle)


def test_parallax_goes_in_and_out(swatch: Any, tmp_path: Path) -> None:
    material, record = swatch
    ((tree, node),) = measured_nodes(material.node_tree)
    before, count = source_of(node.inputs["UV"]), len(tree.nodes)
    maps = read_maps_folder(write_folder(tmp_path / "maps"))
    made = add_parallax(material, record, maps)
    assert parallax_node(material) == made and made.inputs["Depth"].default_value == 1
    assert source_of(made.inputs["UV"]) == before == coordinates_before_tiling(node)
    frame = frame_before(made)
    assert frame is not None and source_of(frame.inputs["UV"]) == before
    with pytest.raises(BakeError, match="already has parallax"):
        add_parallax(material, record, maps)
    remove_parallax(material)
    assert parallax_node(material) is None and source_of(node.inputs["UV"]) == before and len(tree.nodes) == count
    remove_parallax(material)


@pytest.mark.parametrize(
    ("changed", "others", "why"),
    [
        ({}, False, ""),
        ({}, True, "its heights are those of other photographs"),
        ({"tiling": object()}, False, "the swatch was made to tile"),
        ({"width": 11}, False, "its heights are of another part of the photographs"),
    ],
)
def test_relief_that_no_longer_fits_is_switched_off(
    swatch: Any, tmp_path: Path, changed: dict[str, Any], others: bool, why: str
) -> None:
    material, record = swatch
    assert without_unfit_parallax(material, record, others=others) == ""
    add_parallax(material, record, read_maps_folder(write_folder(tmp_path / "maps")))
    if "width" in changed:
        layout = replace(record.map.layout, width=changed["width"])
        baked = replace(record, map=replace(record.map, layout=layout))
    else:
        baked = replace(record, **changed)
    found = without_unfit_parallax(material, baked, others=others)
    assert why in found and bool(found) == bool(why)
    assert (parallax_node(material) is None) == bool(why)


@contextmanager
def shown(material: bpy.types.Material, record: ShadingMapRecord) -> Iterator[None]:
    """The material on the object that operators are for."""
    keep_facts(material, record.document)
    mesh = bpy.data.meshes.new("tile")
    mesh.materials.append(material)
    obj = bpy.data.objects.new("tile", mesh)
    bpy.context.scene.collection.objects.link(obj)
    with bpy.context.temp_override(object=obj, active_object=obj, material=material):
        yield
    bpy.data.batch_remove([obj, mesh])


def test_a_bake_of_other_photographs_switches_it_off(swatch: Any, tmp_path: Path, registered: None) -> None:
    material, record = swatch
    add_parallax(material, record, read_maps_folder(write_folder(tmp_path / "maps")))
    folder = str(write_stack(tmp_path / "others"))
    material.measured_arc.align = "off"
    with shown(material, record):
        assert bpy.ops.measured_materials.bake_again(filepath=folder) == {"FINISHED"}
    assert parallax_node(material) is None


@pytest.mark.parametrize("first", ["tiling", "parallax"])
def test_heights_are_looked_for_in_the_patch_that_is_shown(swatch: Any, tmp_path: Path, first: str) -> None:
    """Tiled at random before or after, coordinates jump first and are moved then; the frame is of those before both."""
    material, record = swatch
    ((_, node),) = measured_nodes(material.node_tree)
    before = source_of(node.inputs["UV"])
    maps = read_maps_folder(write_folder(tmp_path / "maps"))
    if first == "tiling":
        set_random_tiling(material, True)
    moves = add_parallax(material, record, maps)
    if first == "parallax":
        set_random_tiling(material, True)
    tiling = random_tiling_node(material)
    assert tiling is not None and source_of(moves.inputs["UV"]).node == tiling
    assert source_of(tiling.inputs["UV"]) == before == coordinates_before_tiling(node)
    frame = source_of(moves.inputs[ALONG_U]).node
    assert is_swatch_frame(frame) and source_of(frame.inputs["UV"]) == before
    set_random_tiling(material, False)
    assert parallax_node(material) == moves and source_of(moves.inputs["UV"]) == before
    remove_parallax(material)
    assert source_of(node.inputs["UV"]) == before


def test_what_cannot_be_moved_is_said(swatch: Any, tmp_path: Path) -> None:
    material, record = swatch
    maps = read_maps_folder(write_folder(tmp_path / "maps"))
    images = set(bpy.data.images)
    wide = replace(record, map=replace(record.map, layout=replace(record.map.layout, width=16)))
    with pytest.raises(BakeError, match="is of 48 x 48 texels, and the swatch of 16 x 8"):
        add_parallax(material, wide, maps)
    with pytest.raises(BakeError, match="was made to tile"):
        add_parallax(material, replace(record, tiling=object()), maps)
    maps.files["height"].about["scale"] = "wide"
    with pytest.raises(BakeError, match=r"gives no scale for height\.png"):
        add_parallax(material, record, maps)
    assert set(bpy.data.images) == images and parallax_node(material) is None
    ((tree, node),) = measured_nodes(material.node_tree)
    tree.links.remove(node.inputs["UV"].links[0])
    with pytest.raises(BakeError, match="nothing is linked to the UV"):
        add_parallax(material, record, maps)


def test_the_command_line_renders_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []
    monkeypatch.setattr(render, "read_maps_folder", lambda folder: read.append(folder) or read_maps_folder(folder))
    bundle = map_bundle(tmp_path / "felt.mmat", rough_map(), RenderSettings(Lobe("lambert"), 0.5))
    maps = write_folder(tmp_path / "maps")
    size = ["--resolution", "32", "--samples", "4", "--denoise", "never", "--exr", "--repeat", "1"]
    pictures = []
    for name, options in (("flat", []), ("again", []), ("moved", ["--parallax", str(maps)])):
        out = tmp_path / f"{name}.png"
        assert main(["render", str(bundle.path), "--out", str(out), *size, *options]) == 0
        pictures.append(read_image(out.with_suffix(".exr")))
    assert read == [maps]
    flat, again, moved = pictures
    assert np.array_equal(flat, again)
    assert (np.abs(moved - flat).max(-1) > 1e-3).mean() > 0.05 and moved.mean() == pytest.approx(flat.mean(), rel=0.02)
    capsys.readouterr()
    assert main(["render", str(bundle.path), "--out", str(tmp_path / "none.png"), "--parallax", str(tmp_path)]) == 1
    assert "holds no maps.json" in capsys.readouterr().err and not (tmp_path / "none.png").exists()


def test_a_click_in_the_panel_moves_it_and_another_does_not(swatch: Any, tmp_path: Path, registered: None) -> None:
    material, record = swatch
    folder = str(write_folder(tmp_path / "maps"))
    with shown(material, record):
        assert bpy.ops.measured_materials.parallax(directory=folder) == {"FINISHED"}
        assert parallax_node(material) is not None
        assert bpy.ops.measured_materials.parallax() == {"FINISHED"}
        assert parallax_node(material) is None
        with pytest.raises(RuntimeError, match="holds no maps"):
            bpy.ops.measured_materials.parallax(directory=str(tmp_path))


def test_heights_are_packed_where_the_textures_are(swatch: Any, tmp_path: Path) -> None:
    material, record = swatch
    maps = read_maps_folder(write_folder(tmp_path / "maps"))
    assert not keeps_textures(material)
    packed = build_shading_map(record, pack=True)
    assert keeps_textures(packed)
    node = add_parallax(packed, record, maps, pack=True)
    heights = {n.image for n in node.node_tree.nodes if n.bl_idname == "ShaderNodeTexImage"}
    assert len(heights) == 1 and heights.pop().packed_file is not None


def test_a_frame_that_parallax_has_lost_is_found(swatch: Any, tmp_path: Path) -> None:
    """Without it nothing would tell which way the relief is to be moved."""
    material, record = swatch
    keep_facts(material, record.document)
    made = add_parallax(material, record, read_maps_folder(write_folder(tmp_path / "maps")))
    found = list(_swatches(material.node_tree))
    assert [node for _, node in found] == [made]
