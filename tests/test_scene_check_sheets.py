"""The scene check's rules on sheets: what their sentences say of lost light, and which lamps lie behind a sheet."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

from pathlib import Path

import pytest
from measured_materials.addon.scene_check.check import mend
from measured_materials.addon.scene_check.findings import measured_trees, subject_of
from measured_materials.addon.scene_check.sheet_rules import sheets
from measured_materials.addon.studio.studio import render_rgba
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.sources.analytic import ThinCloth
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from support.checked_scenes import bundle, clean_blend, cloth, sound, sound_sheet  # noqa: F401
from support.scene_check_cases import lamp_of, material_of, rules
from support.scene_check_changes import card_only
from support.scenes import TestScene, add_lamp
from support.sheet_scenes import SETTINGS, record_of, sheet_scene

WHITE = ThinCloth((1e-4,) * 3, None, (0.999,) * 3, (0.0,) * 3)


@pytest.fixture(scope="module")
def white(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    """All but Lambertian transmission, of which a mirror is built in mode Reference alone."""
    return record_of(bake_source(WHITE, tmp_path_factory.mktemp("white") / "white", SETTINGS))


def left(scene: TestScene, channel: int) -> float:
    """A channel of the picture, in the mean: of light, or alpha, what the scene's settings leave of 1."""
    scene.scene.cycles.samples = 256
    return float(render_rgba(scene.scene)[..., channel].mean())


@pytest.mark.parametrize("theta, low, high", [(60.0, 0.24, 0.28), (80.0, 0.41, 0.45)])
def test_what_the_film_and_a_hidden_world_take(white: BrdfRecord, theta: float, low: float, high: float) -> None:
    """The 26 and 43 % of the sentences, each of colour, alpha and a shadow catcher's alpha."""
    with sheet_scene(build_material(white, mode="reference"), theta) as scene:
        scene.scene.world, background = compat.new_world("even")
        background.inputs["Color"].default_value = (1, 1, 1, 1)
        whole = left(scene, 0)
        assert whole == pytest.approx(1, abs=5e-3)
        scene.scene.world.cycles_visibility.camera = False
        assert low < 1 - left(scene, 0) < high
        scene.scene.world.cycles_visibility.camera = True
        scene.scene.render.film_transparent = True
        assert low < 1 - left(scene, 0) < high and low < 1 - left(scene, 3) < high
        scene.scene.cycles.film_transparent_glass = True
        assert left(scene, 0) < 0.01


@pytest.mark.parametrize("side, low, high", [(-1, -0.01, 0.01), (1, 0.35, 0.39)])
def test_what_a_lamp_that_the_camera_does_not_see_loses(white: BrdfRecord, side: int, low: float, high: float) -> None:
    """Leaning away from the viewer, and towards the viewer, as the sentence has it."""
    with sheet_scene(build_material(white, mode="reference"), 60.0) as scene:
        lamp = add_lamp(scene, "AREA", (side * 1.08, side * 0.91, -3), energy=300, size=3.0)
        lamp.visible_camera = True
        whole = scene.render(128, 6).mean()
        assert "lamp_camera" not in rules(scene)
        lamp.visible_camera = False
        found = rules(scene)["lamp_camera"]
        hidden = scene.render(128, 6).mean()
        assert low < 1 - hidden / whole < high
        assert mend([found]) and lamp.visible_camera


@pytest.mark.parametrize("lamp, behind", [("AREA", True), ("AREA", False), ("SUN", True), ("SUN", False)])
def test_only_lamps_behind_a_sheet_are_told(cloth: Bundle, lamp: str, behind: bool) -> None:
    with sound_sheet(cloth) as scene:
        card_only(scene)
        other = lamp_of(scene)
        if lamp == "SUN":
            other.hide_render = True
            other = add_lamp(scene, "SUN", tuple(lamp_of(scene).location), energy=1.0)
        if behind:
            other.matrix_world.translation *= -1
            turned = other.matrix_world.copy()
            turned.col[0], turned.col[2] = -turned.col[0], -turned.col[2]
            other.matrix_world = turned
        other.visible_camera = False
        assert ("lamp_camera" in rules(scene)) is behind


def test_faces_are_those_that_a_render_shows(cloth: Bundle) -> None:
    """As modifiers leave them; where these differ in a render, or no face is left, any lamp may lie behind one."""
    with sound_sheet(cloth) as scene:
        card_only(scene)
        lamp_of(scene).visible_camera = False
        assert "lamp_camera" not in rules(scene)
        thick = scene.sphere.modifiers.new("thick", "SOLIDIFY")
        thick.thickness = 0.5
        assert "lamp_camera" in rules(scene)
        thick.use_rim = False
        assert "lamp_camera" not in rules(scene)
        thick.show_viewport = False
        assert "lamp_camera" in rules(scene)
        scene.sphere.modifiers.clear()
        scene.sphere.data.clear_geometry()
        assert "lamp_camera" in rules(scene)


def test_what_sends_no_rays_through_portals_is_left_alone(cloth: Bundle, bundle: Bundle, tmp_path: Path) -> None:
    """An opaque paint, and a sheet of native closures alone."""
    for made, mode in ((bundle, "exact"), (cloth, "preview")):
        with sound(made) as scene:
            scene.show(build_material(made, mode=mode))
            assert lamp_of(scene).visible_camera is False
            scene.scene.render.film_transparent = True
            scene.scene.cycles.transparent_max_bounces = 0
            assert measured_trees(material_of(scene))
            assert not {"lamp_camera", "film_transparent", "transparent_max_bounces"} & set(rules(scene))


def test_portals_are_found_in_groups(cloth: Bundle) -> None:

    with sound_sheet(cloth) as scene:
        assert list(sheets(subject_of(scene.scene))) == [material_of(scene)]
