"""Figures in the sentences of the scene check, each with the scene that it is measured in."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from measured_materials.addon.lights.light_tables import lamp_image, update_scene
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.nodes.material import build_material

from support.light_paths import darken, light_of
from support.scene_check_cases import clear_blend, cycles, lamp, lamp_of, material_of
from support.scene_check_edges import MODULES
from support.scenes import TestScene, lit_sphere

Change = Callable[[TestScene], Any]
SEEDS = 4


@dataclass(frozen=True)
class Figure:
    """A share of the light, as stated and as measured.

    Parameters
    ----------
    words : as they stand in the sentence; their numbers in per cent are the figure
    sign : of the change
    kind : words of the scene, see `measured`
    spoil : what is reported
    samples : enough to know the change to a fifth
    """

    words: str
    sign: int
    kind: str
    spoil: Change
    samples: int = 16

    @property
    def told(self) -> tuple[float, float]:
        """Least and largest change, as shares."""
        numbers = [float(n) / 100 for n in re.findall(r"[\d.]+", NUMBERS.search(self.words).group())]  # type: ignore[union-attr]
        return min(numbers), max(numbers)


NUMBERS = re.compile(r"\d[\d.]*(?: (?:to|and) \d[\d.]*)? %")


def fast_gi(method: str) -> Change:
    def apply(scene: TestScene) -> None:
        scene.scene.cycles.use_fast_gi, scene.scene.cycles.fast_gi_method = True, method

    return apply


def hidden(owner: Callable[[TestScene], Any], name: str) -> Change:
    return lambda scene: setattr(owner(scene), name, False)


def world(scene: TestScene) -> Any:
    return scene.scene.world.cycles_visibility


def lamp_settings(scene: TestScene) -> Any:
    return lamp_of(scene).data.cycles


def nodes(kind: str, output: str) -> Change:
    """The scene's `kind` of light, the only one, becomes black where an output of Light Path is not 0."""

    def apply(scene: TestScene) -> None:
        tree, name = scene.scene.world.node_tree, "ShaderNodeBackground"
        if kind == "lamp":
            tree, name = lamp_of(scene).data.node_tree, "ShaderNodeEmission"
        elif kind == "emission":
            tree, name = bpy.data.objects["emitter"].data.materials[0].node_tree, "ShaderNodeEmission"
        strength = next(n for n in tree.nodes if n.bl_idname == name).inputs["Strength"]
        darken(tree, strength, output, 0.5)

    return apply


FIGURES = [
    Figure("1 lost 0.5 to 2 %", -1, "", cycles("blur_glossy", 1.0)),
    Figure("10 lost 13 %", -1, "mirror unaimed", cycles("sample_clamp_direct", 10.0), 128),
    Figure("that lost 2 %", -1, "", cycles("caustics_reflective", False)),
    Figure("Replace lost 2.6 %", -1, "", fast_gi("REPLACE")),
    Figure("Add gave 51 %", 1, "", fast_gi("ADD")),
    Figure("0 lost 8 %", -1, "room", cycles("glossy_bounces", 0)),
    Figure("41 %", -1, "sphere", hidden(world, "glossy")),
    Figure("17 %", -1, "sphere", hidden(world, "diffuse")),
    Figure("33 %", -1, "sphere", hidden(lamp_of, "visible_glossy")),
    Figure("8 %", -1, "sphere", hidden(lamp_of, "visible_diffuse")),
    Figure("a sphere lost 10 %", -1, "sphere", hidden(lamp_settings, "use_multiple_importance_sampling")),
    Figure("35 % in mode Reference", -1, "sphere mirror", hidden(lamp_settings, "use_multiple_importance_sampling")),
    Figure("got 39 % more light", 1, "sphere card", lamp("use_shadow", False)),
    Figure(
        "0.3 lost 10 to 16 %",
        -1,
        "sphere",
        lambda s: s.set_terminator(1, 0.3),
    ),
    Figure(
        "+0.4 % on a coarse sphere",
        1,
        "mirror coarse",
        lambda s: setattr(material_of(s).cycles, "use_bump_map_correction", True),
        32,
    ),
    Figure("64 % of a paint's light in mode Exact", -1, "sphere world", nodes("world", "Is Glossy Ray")),
    Figure("79 % in Reference", -1, "sphere world mirror", nodes("world", "Is Glossy Ray")),
    Figure("37 % less in mode Exact", -1, "sphere lamp", nodes("lamp", "Glossy Depth"), 32),
    Figure("34 % of a paint's light in mode Exact", -1, "sphere emission", nodes("emission", "Is Glossy Ray"), 64),
    Figure("90 % in Reference", -1, "sphere emission mirror", nodes("emission", "Is Glossy Ray"), 64),
]
UNMEASURED = {
    "7 %": "filter_glossy, the worst place of a picture",
    "9 %": "reflective_caustics, the worst place of a picture",
    "1.7 %": "clamp_indirect: a path of two bounces that ends in a small lamp is too rare for a test",
    "1.4 %": "adaptive_sampling: rare bright samples, of a longer render",
    "13 and 4 %": "bounces, corners of a larger room",
    "30 to 60 %": "path_guiding, processor time",
    "3 %": "pixel_jitter, Blender 5.2",
    "19 %": "light_tree, noise",
    "3 to 5 %": "texture_limit, of a table larger than this one",
    "10 to 16 %": "texture_limit, Blender 5.2; the shading offset's is measured",
    "0.5 %": "geometry_offset, at most",
    "20 %": "osl_files, at random",
    "13 %": "volumes, test_a_volume_takes_light_from_the_mirror_until_mended",
    "4 %": "volumes, the same of a paint",
    "37 %": "lamp_camera, tests/test_scene_check_sheets.py",
    "26 %": "sheet_rules, tests/test_scene_check_sheets.py",
    "43 %": "sheet_rules, tests/test_scene_check_sheets.py",
}
"""Figures that no scene here measures, with the reason."""


def sentences() -> str:
    """The source text of all rules."""
    return "\n".join(Path(str(module.__file__)).read_text() for module in MODULES)


def measured(bundle: Bundle, figure: Figure) -> np.ndarray:
    """Relative changes under each seed; the paths are the same before and after.

    A "mirror" is all there is of mode Reference and finds an "unaimed" lamp, which is small, by chance; "coarse" is a
    sphere of 12 segments; in a "room" the ground is of the paint too; "sphere" looks at its pixels only; a "card" of
    twice the lamp's width stands before it; "world", "lamp" and "emission" are the only light.
    """
    kind = figure.kind.split()
    unaimed = "unaimed" in kind
    mode = "reference" if "mirror" in kind else "exact"
    material = build_material(bundle, mode=mode, lamps=None if unaimed else lamp_image())
    segments, size = 12 if "coarse" in kind else 32, 0.2 if unaimed else 0.6
    with lit_sphere(material, segments, lamp_size=size, resolution=24) as scene:
        _arrange(scene, kind)
        if not unaimed:
            update_scene(scene.scene)
        mask = scene.mask() if "sphere" in kind else np.ones((24, 24), bool)
        before = scene.render(figure.samples, SEEDS)[:, mask].mean((1, 2))
        figure.spoil(scene)
        after = scene.render(figure.samples, SEEDS)[:, mask].mean((1, 2))
    clear_blend()
    return after / before - 1


def _arrange(scene: TestScene, kind: list[str]) -> None:
    scene.leave_terminator()
    for light in ("world", "lamp", "emission"):
        if light in kind:
            light_of(scene, light)
    if "room" in kind:
        ground = next(obj for obj in scene.scene.objects if obj.type == "MESH" and obj != scene.sphere)
        ground.data.materials[0] = material_of(scene)
    if "card" in kind:
        mesh = bpy.data.meshes.new("card")
        mesh.from_pydata([(-0.6, -0.6, 0), (0.6, -0.6, 0), (0.6, 0.6, 0), (-0.6, 0.6, 0)], [], [(0, 1, 2, 3)])
        card = bpy.data.objects.new("card", mesh)
        card.matrix_world = lamp_of(scene).matrix_world
        card.matrix_world.translation *= 0.7
        scene.scene.collection.objects.link(card)
