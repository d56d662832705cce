"""The scene check's rules on both sides of what they report; no rule is without either."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

from functools import partial

import bpy
import pytest
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.addon.scene_check.check import mend
from measured_materials.addon.scene_check.findings import measured_trees
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.nodes.material import build_material
from support.checked_scenes import bundle, clean_blend, cloth, painted, sound, sound_sheet  # noqa: F401
from support.scene_check_cases import (
    CASES,
    clear_blend,
    lamp_of,
    material_of,
    rules,
)
from support.scene_check_changes import scaled
from support.scene_check_edges import EDGES, ELSEWHERE, SWITCHES, Edge, told_rules
from support.scenes import TestScene


def test_no_rule_lacks_a_side() -> None:
    told = told_rules()
    assert len(told) > 40
    edged = {edge.rule for edge in EDGES}
    assert edged | SWITCHES | set(ELSEWHERE) == told
    assert not edged & SWITCHES and not edged & set(ELSEWHERE)
    # What is a switch has a case that turns it.
    assert not SWITCHES - {case.rule for case in CASES}


@pytest.mark.parametrize("edge", EDGES, ids=[f"{edge.rule}-{k}" for k, edge in enumerate(EDGES)])
def test_edge(bundle: Bundle, cloth: Bundle, edge: Edge) -> None:
    make = partial(sound_sheet, cloth) if edge.sheet else partial(sound, bundle)
    with make() as scene:
        assert not rules(scene)
        edge.past(scene)
        assert edge.rule in rules(scene)
        if not edge.anew:
            edge.short(scene)
            assert edge.rule not in rules(scene)
            return
    clear_blend()
    with make() as scene:
        edge.short(scene)
        assert edge.rule not in rules(scene)


# --- what a lamp is given ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "shape, x, y", [("SQUARE", 0.1, 0.1), ("DISK", 4, 0.25), ("RECTANGLE", 4, 0.25), ("ELLIPSE", 1, 1)]
)
def test_a_mended_area_lamp_is_a_fiftieth_of_its_distance_wide(
    painted: TestScene, shape: str, x: float, y: float
) -> None:
    """In the world, whatever its object's scale, and as stated: half a degree of radius seen from the sphere."""
    scaled(x, y, shape=shape, size=0.0, size_y=0.0)(painted)
    lamp = bpy.data.objects["AREA"]
    finding = rules(painted)["lamp_size"]
    mend([finding])
    bpy.context.view_layer.update()
    wide = [lamp.data.size * x, (lamp.data.size_y if shape in ("RECTANGLE", "ELLIPSE") else lamp.data.size) * y]
    assert min(wide) == pytest.approx(0.02 * 4, rel=1e-3)
    if shape in ("RECTANGLE", "ELLIPSE"):
        assert max(wide) == pytest.approx(0.02 * 4, rel=1e-3)
    told = float(finding.wanted.split()[0])
    assert max(lamp.data.size, lamp.data.size_y if shape in ("RECTANGLE", "ELLIPSE") else 0) == pytest.approx(
        told, rel=0.05
    )


def test_a_mended_point_lamp_has_the_radius_that_is_told(painted: TestScene) -> None:
    data = lamp_of(painted).data
    data.size = 0.0
    distance = lamp_of(painted).matrix_world.translation.length
    finding = rules(painted)["lamp_size"]
    assert float(finding.wanted.split()[0]) == pytest.approx(0.02 * distance, rel=0.05)
    mend([finding])
    assert data.size == pytest.approx(0.02 * distance, rel=1e-3)


def test_a_lamp_scaled_to_nothing_is_left_to_a_person(painted: TestScene) -> None:
    scaled(0.0, 1.0, size=1.0)(painted)
    finding = rules(painted)["lamp_size"]
    assert "Scale" in finding.found and finding.mend is None


# --- every texture of every group ------------------------------------------------------------------------------------


def test_every_texture_of_every_measured_group_is_looked_at(painted: TestScene, bundle: Bundle) -> None:
    """Of a second material too, and of groups within groups."""
    second = build_material(bundle, mode="reference", lamps=lamp_image())
    painted.sphere.data.materials.append(second)
    update_scene(painted.scene)
    assert not rules(painted)
    trees = [tree for material in (material_of(painted), second) for tree in measured_trees(material)]
    nodes = [n for tree in trees for n in tree.nodes if n.bl_idname == "ShaderNodeTexImage"]
    images = dict.fromkeys(node.image for node in nodes)
    assert len(images) >= 4 and len({node.id_data for node in nodes}) > 3
    for image in images:
        image.alpha_mode = "STRAIGHT"
        found = rules(painted)
        assert set(found) == {"alpha_mode"} and found["alpha_mode"].where == f"texture {image.name}"
        image.alpha_mode = "CHANNEL_PACKED"
