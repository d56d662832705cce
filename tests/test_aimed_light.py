"""Aimed sampling in Cycles: every kind of lamp against Diffuse BSDF, and the table of lamps that is kept current."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from measured_materials.addon.lights import light_tables as lamps
from measured_materials.addon.lights.light_tables import CAPACITY, TABLE, lamp_image, survey, update_scene
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.directions import spherical
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.lamps import (
    aim_numpy,
    aimed_part,
    density_towards,
    draw_towards,
    expected_light,
    lamp_table,
)
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes.aimed_light_group import SLOTS_KEY, aimed_light_group
from measured_materials.nodes.group import call
from measured_materials.nodes.material import build_material
from measured_materials.nodes.shading_map_material import build_shading_map
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.monte_carlo import assert_agree, assert_same, compare
from support.node_count import count_nodes
from support.scenes import add_lamp, diffuse_material, lit_sphere
from support.swatches import identity_map, map_bundle
from test_light_sampling import LAMPS

GREY = (1.0, 1.0, 1.0)


LIGHTING: dict[str, list[tuple[str, tuple[float, float, float], dict[str, Any]]]] = {
    "square": [("AREA", (2, -1.5, 3), {"energy": 100, "size": 0.4})],
    "ellipse": [("AREA", (2, -1.5, 2), {"energy": 100, "shape": "ELLIPSE", "size": 1.2, "size_y": 0.3})],
    "point": [("POINT", (1.5, -2, 2), {"energy": 150, "shadow_soft_size": 0.2})],
    "spot": [("SPOT", (1.5, -2, 2), {"energy": 400, "shadow_soft_size": 0.1, "spot_size": 0.8})],
    "sun": [("SUN", (1, -1.5, 2), {"energy": 2, "angle": math.radians(3)})],
    "default sun": [("SUN", (1, -1.5, 2), {"energy": 2, "angle": math.radians(0.526)})],
    "three": [
        ("AREA", (2, -1.5, 3), {"energy": 60, "shape": "DISK", "size": 0.6}),
        ("SUN", (-2, -1, 2), {"energy": 1, "angle": math.radians(10)}),
        ("POINT", (0.2, -2.5, 0.5), {"energy": 30, "shadow_soft_size": 0.1}),
    ],
}


# Those of which "three" has the kind take a minute each.
SLOW_LIGHTING = {"square", "ellipse", "point", "sun", "default sun"}


@pytest.mark.parametrize(
    "lighting", [pytest.param(k, marks=[pytest.mark.slow] if k in SLOW_LIGHTING else []) for k in LIGHTING]
)
def test_aimed_mirror_is_diffuse_under_every_lamp(tmp_path: Path, lighting: str) -> None:
    """Mirror only, so that nothing but the aimed samples can find a small lamp; with a planted 2 % that fails."""
    render = RenderSettings(sigma=0.5, mode="reference")
    bundle = map_bundle(tmp_path / "grey", identity_map(colour=GREY), render)
    with lit_sphere(diffuse_material(0.5), 64, lamp=False) as scene:
        scene.leave_terminator()
        for kind, place, settings in LIGHTING[lighting]:
            add_lamp(scene, kind, place, **settings)
        reference = scene.render(20, 6)
        scene.show(build_shading_map(bundle, lamps=lamp_image()))
        report = update_scene(scene.scene)
        assert len(report.lamps) == len(LIGHTING[lighting]) and not report.left_out
        assert_same(reference, scene.render(20, range(100, 108)), scene.mask(), 0.0, 0.01)


@pytest.mark.slow
def test_aimed_table_is_the_table(tmp_path: Path) -> None:
    """A measured BRDF, glossy, with the alias tables' density: aimed against not aimed under a lamp that both find."""
    source = analytic.Ggx(alpha=0.35, f0=(0.9, 0.6, 0.3))
    sampler = SamplerLayout(n_o=32, n_h=32, n_phi=16)
    settings = BakeSettings(resolution=32, alpha=(0.5, 0.3), sampler=sampler, envelope=False)
    bundle = read_bundle(bake_source(source, tmp_path / "gloss", settings).path)
    with lit_sphere(build_material(bundle), 64, lamp_size=3.0) as scene:
        reference = scene.render(128, 8)
        scene.show(build_material(bundle, lamps=lamp_image()))
        assert len(update_scene(scene.scene).lamps) == 1
        assert_agree(compare(reference, scene.render(128, range(100, 108)), scene.mask()), 0.015)


@pytest.mark.parametrize("concentration", [0.0, 30.0])
@pytest.mark.parametrize("names", [["rectangle"], ["sun", "bulb"], ["ellipse", "sphere", "sharp sun", "around"]])
def test_aiming_as_in_numpy(names: list[str], concentration: float) -> None:
    rng = np.random.default_rng(0)
    lamps = [replace(LAMPS[name], power=k + 1.0) for k, name in enumerate(names)]
    table = lamp_table(lamps, 4, sky=0.6, largest_share=0.8)
    n = 3000
    position = rng.uniform(-0.3, 0.3, (n, 3)).astype(np.float32)
    normal, wi = (
        spherical(np.arccos(rng.uniform(-1, 1, n)), rng.uniform(0, 2 * np.pi, n)).astype(np.float32) for _ in range(2)
    )
    numbers = [rng.random(n).astype(np.float32) for _ in range(4)]
    for k, values in enumerate(numbers):
        values[2 * k : 2 * k + 2] = 0, 1
    group = aimed_light_group(data_image("lamps", table), len(lamps))
    found, aimed_density, rest = card(lambda *a: call(group, *a, concentration), position, normal, wi, *numbers)

    p, up, w, u_lamp, u_aim, u1, u2 = (values.astype(float) for values in (position, normal, wi, *numbers))
    aims = [aim_numpy(row, p) for row in table[: len(lamps)]]
    light = np.stack([expected_light(xp_numpy, aim, up, lamp.power) for aim, lamp in zip(aims, lamps)])
    total = light.sum(0)
    wanted = light * np.stack([aimed_part(xp_numpy, aim, concentration) for aim in aims])
    aiming = wanted.sum(0)
    part = np.divide(aiming, total, out=np.zeros(n), where=total > 0)
    share = np.minimum(np.divide(total, total + 0.6), 0.8 * part)
    index = np.minimum((u_lamp * aiming > np.cumsum(wanted, 0)).sum(0), len(lamps) - 1)
    aimed = u_aim < share
    towards = np.stack([draw_towards(xp_numpy, aim, u1, u2) for aim in aims])[index, np.arange(n)]
    truth = np.where(aimed[:, None], towards, w)
    # Where a condition holds only just, float32 may decide it the other way.
    same = np.abs(found - truth).max(-1) < 1e-5
    assert same.mean() > 0.998
    assert np.abs(rest - (1 - share))[same].max() < 1e-5
    density = sum(
        part * density_towards(xp_numpy, aim, truth, (aimed & (index == k)).astype(float))
        for k, (aim, part) in enumerate(zip(aims, wanted))
    )
    density = np.divide(density * share, aiming, out=np.zeros(n), where=aiming > 0)
    wrong = np.abs(aimed_density - density) > 2e-4 * np.maximum(density, 1e-3)
    assert wrong[same].mean() < 0.002


def test_lamps_that_no_mirror_meets_are_left_out_with_a_reason() -> None:
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        add_lamp(scene, "SUN", (0, 0, 1), energy=1, angle=0)
        add_lamp(scene, "POINT", (0, 0, 3), energy=10, shadow_soft_size=0)
        add_lamp(scene, "AREA", (0, 0, 3), energy=10, size=1).visible_glossy = False
        add_lamp(scene, "SPOT", (0, 1, 3), energy=10, shadow_soft_size=0.1).data.cycles[
            "use_multiple_importance_sampling"
        ] = False
        add_lamp(scene, "AREA", (1, 1, 3), energy=10, size=1).data.cycles.is_portal = True
        parent = bpy.data.objects.new("parent", None)
        parent.scale = (1, 4, 1)
        scene.scene.collection.objects.link(parent)
        sheared = add_lamp(scene, "AREA", (0, 0, 3), energy=10, size=1)
        sheared.parent, sheared.rotation_euler = parent, (0, 0, 0.8)
        report = update_scene(scene.scene)
        bpy.data.objects.remove(parent)
    assert not report.lamps
    words = " ".join(report.left_out)
    for reason in ("no angle", "no radius", "hidden from glossy", "Multiple Importance", "portal", "sheared"):
        assert reason in words


def test_the_table_follows_edits_and_frames() -> None:
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        lamp = add_lamp(scene, "POINT", (0, 0, 3), energy=10, shadow_soft_size=0.1)
        update_scene(scene.scene)

        def first_centre() -> np.ndarray:
            pixels = np.empty(CAPACITY * 5 * 4, np.float32)
            bpy.data.images[TABLE].pixels.foreach_get(pixels)
            return pixels.reshape(CAPACITY, 5, 4)[-1, 0, :3]

        assert first_centre() == pytest.approx([0, 0, 3])
        lamp.location = (1, 2, 3)
        update_scene(scene.scene)
        assert first_centre() == pytest.approx([1, 2, 3])
        lamp.hide_render = True
        lamp.hide_viewport = True
        layer = scene.scene.view_layers[0]
        layer.update()
        assert not survey(layer.depsgraph).lamps


STRENGTHS: dict[str, tuple[str, dict[str, Any]]] = {
    "area": ("AREA", {"size": 0.4}),
    "area, per size": ("AREA", {"size": 0.4, "normalize": False}),
    "ellipse, per size": ("AREA", {"shape": "ELLIPSE", "size": 0.4, "size_y": 0.2, "normalize": False}),
    "beam": ("AREA", {"size": 0.1, "spread": 1.0}),
    "point, per size": ("POINT", {"shadow_soft_size": 0.2, "normalize": False}),
    "spot": ("SPOT", {"shadow_soft_size": 0.2}),
    "sun, per size": ("SUN", {"angle": 0.6, "normalize": False}),
    "warm and exposed": (
        "POINT",
        {"shadow_soft_size": 0.2, "use_temperature": True, "temperature": 3000, "exposure": 1},
    ),
    "coloured": ("POINT", {"shadow_soft_size": 0.2, "color": (1.0, 0.3, 0.1)}),
    "of nodes": ("POINT", {"shadow_soft_size": 0.2, "nodes": ((0.2, 1.0, 0.5), 3.0)}),
}


@pytest.mark.parametrize("name", STRENGTHS)
def test_a_lamp_has_the_strength_that_it_shows(name: str) -> None:
    """Irradiance of a card under it, rendered, against the table's power: all settings of a light that change it."""
    kind, settings = STRENGTHS[name]
    emission = settings.get("nodes")
    with lit_sphere(diffuse_material(1.0), lamp=False, ground=False, resolution=8) as scene:
        scene.scene.world = None
        card_mesh = bpy.data.meshes.new("card")
        card_mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
        card_mesh.materials.append(diffuse_material(1.0))
        scene.sphere.data, scene.sphere.scale = card_mesh, (0.1, 0.1, 0.1)
        scene.scene.camera.matrix_world, scene.scene.camera.data.lens = Matrix.Translation((0, 0, 0.3)), 200
        lamp = add_lamp(scene, kind, (0, 0, 5), energy=10, **{k: v for k, v in settings.items() if k != "nodes"})
        if emission:
            lamp.data.use_nodes = True
            node = lamp.data.node_tree.nodes["Emission"]
            node.inputs["Color"].default_value, node.inputs["Strength"].default_value = (*emission[0], 1), emission[1]
        (found,) = update_scene(scene.scene).lamps
        seen = math.pi * scene.render(64, 1)[0][2:6, 2:6].mean((0, 1)) @ (0.2126, 0.7152, 0.0722)
    power = found.power if kind == "SUN" else found.power / 25
    # The lamp's extent, which the power at a distance leaves out, takes off up to 1 %, in a beam's middle 3 %.
    assert power == pytest.approx(seen, rel=0.04)


def test_a_beam_that_misses_counts_for_little() -> None:
    with lit_sphere(diffuse_material(0.5), 16, lamp=False, ground=False) as scene:
        lamp = add_lamp(scene, "SPOT", (0, 0, 3), energy=10, shadow_soft_size=0.1, spot_size=0.5)
        hit = update_scene(scene.scene).lamps[0].power
        lamp.matrix_world = Matrix.Translation((0, 0, 3)) @ Matrix.Rotation(2.0, 4, "X")
        assert 0 < update_scene(scene.scene).lamps[0].power < 0.1 * hit


def test_a_render_aims_at_the_lamps_that_it_shows() -> None:
    """Whatever the viewport hides; a collection that is not rendered takes its lamps along."""
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        off_in_renders = add_lamp(scene, "POINT", (0, 0, 3), energy=10, shadow_soft_size=0.1)
        off_in_renders.hide_render = True
        off_in_viewports = add_lamp(scene, "POINT", (1, 0, 3), energy=10, shadow_soft_size=0.2)
        off_in_viewports.hide_viewport = True
        off_in_viewports.location = (2, 0, 3)
        dropped = bpy.data.collections.new("dropped")
        scene.scene.collection.children.link(dropped)
        other = add_lamp(scene, "POINT", (0, 1, 3), energy=10, shadow_soft_size=0.3)
        scene.scene.collection.objects.unlink(other)
        dropped.objects.link(other)
        dropped.hide_render = True
        shown = update_scene(scene.scene).lamps
        rendered = update_scene(scene.scene, for_render=True).lamps
        assert sorted(lamp.extent for lamp in shown) == pytest.approx([0.1, 0.3])
        assert [lamp.extent for lamp in rendered] == pytest.approx([0.2])
        assert rendered[0].centre == pytest.approx((2, 0, 3))
        bpy.data.collections.remove(dropped)


def test_lamps_of_a_linked_collection_are_aimed_at(tmp_path: Path) -> None:
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        kept = bpy.data.collections.new("kept")
        lamp = add_lamp(scene, "POINT", (0, 0, 3), energy=10, shadow_soft_size=0.1)
        scene.scene.collection.objects.unlink(lamp)
        kept.objects.link(lamp)
        file = str(tmp_path / "library.blend")
        bpy.data.libraries.write(file, {kept})
        bpy.data.collections.remove(kept)
        bpy.data.objects.remove(lamp)
        with bpy.data.libraries.load(file, link=True) as (_, wanted):
            wanted.collections = ["kept"]
        instance = bpy.data.objects.new("instance", None)
        instance.instance_type, instance.instance_collection = "COLLECTION", wanted.collections[0]
        instance.location = (1, 0, 0)
        scene.scene.collection.objects.link(instance)
        for for_render in (False, True):
            (found,) = update_scene(scene.scene, for_render=for_render).lamps
            assert found.centre == pytest.approx((1, 0, 3))
        instance.hide_render = True
        assert not update_scene(scene.scene, for_render=True).lamps
        bpy.data.libraries.remove(wanted.collections[0].library)


def test_the_table_follows_a_render(tmp_path: Path) -> None:
    """By the handlers alone: slots for a lamp that only the render shows, and its place in every frame."""
    bundle = map_bundle(tmp_path / "grey", identity_map(), RenderSettings(sigma=0.5, mode="reference"))
    with lit_sphere(diffuse_material(0.5), 16, lamp=False, resolution=8) as scene:
        scene.show(build_shading_map(bundle, lamps=lamp_image()))
        lamp = add_lamp(scene, "POINT", (0, 0, 3), energy=10, shadow_soft_size=0.1)
        lamp.hide_viewport = True
        for frame in (1, 2):
            lamp.location = (frame, 0, 3)
            lamp.keyframe_insert("location", frame=frame)
        scene.scene.frame_end, scene.scene.cycles.samples = 2, 1
        scene.scene.render.filepath = str(tmp_path / "frame")
        seen = []

        def look(*_: Any) -> None:
            pixels = np.empty(CAPACITY * 5 * 4, np.float32)
            bpy.data.images[TABLE].pixels.foreach_get(pixels)
            slots = {t[SLOTS_KEY] for t in bpy.data.node_groups if t.name.startswith("MM Aim")}
            seen.append((float(pixels.reshape(CAPACITY, 5, 4)[-1, 0, 0]), slots))

        lamps.register()
        bpy.app.handlers.render_post.append(look)
        try:
            bpy.ops.render.render(animation=True, scene=scene.scene.name)
        finally:
            bpy.app.handlers.render_post.remove(look)
            lamps.unregister()
    assert seen == [(1.0, {1}), (2.0, {1})]


def test_materials_aim_at_as_many_lamps_as_there_are(tmp_path: Path) -> None:
    """Without a lamp the group lets the direction pass; the picture under a sky alone is the same either way."""
    bundle = map_bundle(tmp_path / "grey", identity_map(), RenderSettings(sigma=0.5, mode="reference"))
    with lit_sphere(diffuse_material(0.5), 16, lamp=False) as scene:
        material = build_shading_map(bundle, lamps=lamp_image())
        scene.show(material)

        def sizes() -> set[int]:
            return {count_nodes(t) for t in bpy.data.node_groups if t.name.startswith("MM Aim")}

        counts = []
        for k in range(3):
            update_scene(scene.scene)
            assert len(sizes()) == 1
            counts.append(sizes().pop())
            add_lamp(scene, "POINT", (k, 0, 3), energy=10, shadow_soft_size=0.1)
        assert counts[0] < 10 < counts[1] < counts[2]
