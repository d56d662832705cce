"""Each random number decides one thing: a walk over the nodes, the OSL text, and a picture that shows a second use.

Two decisions by one number are not independent, and no density knows of it: where the Russian roulette shared its
number with the choice to aim, a material with a black channel was 11 % too bright under Blender's default sun.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sampling.half_vector_warp import HalfVectorWarp
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes import expr
from measured_materials.nodes.group import call, node_group
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_script import SHADERS
from measured_materials.nodes.shading_map_material import build_shading_map
from measured_materials.nodes.stochastic_mirror_group import more_random_numbers_group, random_numbers_group
from support.cards import card
from support.monte_carlo import assert_agree, compare
from support.random_walk import Walk
from support.scenes import add_lamp, diffuse_material, lit_sphere
from support.svm_stack import aim_at_everything
from support.swatches import map_bundle, rough_map

Bundles = Callable[[str], Bundle]
Build = Callable[[Bundles, Path], bpy.types.Material]

# What a number may decide beside one thing, and why that is no second decision; with the number of nodes.
AN_AIMED_DRAW_OR_THE_MATERIALS = "a draw takes the light's direction or the material's, and only one of them is placed"
LAMP_OR_WORLD = ("Lamp: Random 1 x3 + World: Random 1", "Lamp: Random 2 x2 + World: Random 2")
CELL, ALIAS = f"Random Cell + {LAMP_OR_WORLD[0]}", f"Random Alias + {LAMP_OR_WORLD[1]}"
AZIMUTH, POLAR = f"Random Azimuth + {LAMP_OR_WORLD[0]}", f"Random Polar + {LAMP_OR_WORLD[1]}"
OF_PHONG, SHARE = f"Random Polar x2 + {LAMP_OR_WORLD[1]}", "Aim: Random Aim + World: Random Aim"
WARP_U, WARP_SLOPE = f"Random U x3 + {LAMP_OR_WORLD[0]}", f"Random V x3 + {LAMP_OR_WORLD[1]}"
WARP_AZIMUTH = f"Random V x2 + {LAMP_OR_WORLD[1]}"
STRETCHED = "what choosing between cosine and table leaves of it is even again, and places the draw"
DELIBERATE: dict[str, str] = {
    WARP_U: f"{AN_AIMED_DRAW_OR_THE_MATERIALS}; {STRETCHED}",
    WARP_SLOPE: f"{AN_AIMED_DRAW_OR_THE_MATERIALS}; of the cosine's azimuth and the table's place one is taken",
    WARP_AZIMUTH: "the same, and it runs around both sides of the viewer: side and azimuth of one direction",
    CELL: AN_AIMED_DRAW_OR_THE_MATERIALS,
    ALIAS: AN_AIMED_DRAW_OR_THE_MATERIALS,
    AZIMUTH: AN_AIMED_DRAW_OR_THE_MATERIALS,
    POLAR: AN_AIMED_DRAW_OR_THE_MATERIALS,
    OF_PHONG: "the same, and a draw follows Phong's lobe or its diffuse part",
    SHARE: "below the share it is even from 0 to the share, and decides about the world's alias",
    "Random V x2": "its half chooses the side, and within a half it is even: the place",
    "Slices: Random x3": "three channels, each unbiased by itself; they enter the picture one by one",
    "Lookup: Random x3": "one choice among four slices, by three comparisons with running sums",
    "Lookup: Random x2": "what choosing along one axis leaves of it is even again, and chooses along the other",
}
# What groups are for, by the beginning of their names.
KINDS = {
    "MM Towards": "Aim",
    "MM Draw Towards Lamp": "Lamp",
    "MM Draw Towards World": "World",
    "MM Lookup": "Lookup",
    "MM Slices": "Slices",
}
TABLE = [
    CELL,
    ALIAS,
    "Random U",
    "Random V x2",
]
SLOPES = [CELL, ALIAS, "Random U", "Random V"]
WARP_SLOPES = [WARP_U, WARP_SLOPE]
WARP = [WARP_U, WARP_AZIMUTH]
AIM = [
    "Aim: Random Lamp",
    SHARE,
    "LESS_THAN",
]  # the last is the roulette of faint mirrors
LOBE = [AZIMUTH, POLAR]
PHONG = [LOBE[0], OF_PHONG]
THIRD = ["Random Choice"]
CHOICE = ["LESS_THAN"]  # between native closures and the mirror


@pytest.fixture(scope="module", autouse=True)
def clean_blend_at_last() -> Iterator[None]:
    """One group that aims at everything serves all materials here: it takes three seconds to build."""
    yield
    for collection in (bpy.data.materials, bpy.data.node_groups, bpy.data.images, bpy.data.lights):
        for block in list(collection):
            collection.remove(block)


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> Bundles:
    """Materials as coarse as they can be: only their nodes are looked at."""
    folder = tmp_path_factory.mktemp("numbers")

    @functools.cache
    def baked(name: str) -> Bundle:
        if name in ("isotropic", "warp"):
            ward = analytic.Ward(diffuse=(0.45, 0.3, 0.04), specular=(0.06, 0.06, 0.06), alpha=0.3)
            sampler = SamplerLayout(8, 8, 4) if name == "isotropic" else HalfVectorWarp(4, 8, 4, 1e-2)
            settings = BakeSettings(resolution=8, alpha=(0.5, 0.3), sampler=sampler, storage=Storage.FLOAT32)
            return read_bundle(bake_source(ward, folder / name, settings).path)
        sampler = HalfVectorWarp() if name == "brushed warp" else SamplerLayout()
        settings = BakeSettings(
            8, envelope=name == "brushed with envelope", basis="half", viewers=(8, 4), sampler=sampler
        )
        ggx = analytic.Ggx(alpha=0.2, alpha_y=0.4)
        return read_bundle(bake_source(ggx, folder / name, settings).path)

    return baked


def of_table(name: str, mode: str, **options: Any) -> Build:
    return lambda bundles, _: build_material(bundles(name), mode=mode, lamps=lamp_image(), **options)


def of_map(lobe: Lobe, **settings: Any) -> Build:
    def build(_: Bundles, folder: Path) -> bpy.types.Material:
        bundle = map_bundle(folder / "material", rough_map(), RenderSettings(lobe, sigma=0.8, **settings))
        return build_shading_map(bundle, lamps=lamp_image())

    return build


MATERIALS: dict[str, tuple[Build, list[str]]] = {
    "exact": (of_table("isotropic", "exact", lamp_share=True), [*TABLE, *CHOICE, *AIM]),
    "balanced": (of_table("isotropic", "balanced"), [*TABLE, *CHOICE, *AIM]),
    "reference": (of_table("isotropic", "reference"), [*TABLE, "Lookup: Random", *AIM]),
    "warp": (of_table("warp", "reference"), [*WARP, "Lookup: Random", *AIM]),
    "spline": (of_table("isotropic", "reference", filter="bspline"), [*TABLE, "Lookup: Random x3", *AIM]),
    "anisotropic exact": (of_table("brushed with envelope", "exact", lamp_share=True), [*SLOPES, *CHOICE, *AIM]),
    "anisotropic reference": (of_table("brushed", "reference"), [*SLOPES, "Lookup: Random x2", *AIM]),
    "anisotropic warp": (of_table("brushed warp", "reference"), [*WARP_SLOPES, "Lookup: Random x2", *AIM]),
    "map exact": (of_map(Lobe("lambert")), [*LOBE, "Slices: Random", *CHOICE, *AIM]),
    "map reference": (of_map(Lobe("ggx", 0.4), mode="reference"), [*LOBE, *THIRD, "Slices: Random", *AIM]),
    "map of Phong": (of_map(Lobe("phong", 12.0, 0.4)), [*PHONG, *THIRD, "Slices: Random", *CHOICE, *AIM]),
    "map by angle": (of_map(Lobe("lambert"), technique="angular"), [*LOBE, "Slices: Random", *AIM]),
}


def decisions(walk: Walk) -> list[str]:
    """What each number decides, named without the material; numbers that only seed others, or nothing, left out."""
    found = []
    for uses in walk.uses.values():
        words = []
        for use, count in uses.items():
            group, _, how = use.partition(": ")
            kind = next((kind for name, kind in KINDS.items() if group.startswith(name)), "")
            words.append(": ".join([*([kind] if kind else []), how]) + (f" x{count}" if count > 1 else ""))
        if words and words != ["ShaderNodeTexWhiteNoise"]:
            found.append(" + ".join(sorted(words, key=lambda word: (word.startswith(("Lamp:", "World:")), word))))
    return found


SLOW = {"anisotropic exact", "anisotropic warp"}  # whose bakes alone take a quarter of a minute


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in SLOW)) for n in MATERIALS])
def test_every_number_decides_one_thing(bundles: Bundles, tmp_path: Path, name: str) -> None:
    build, expected = MATERIALS[name]
    material = build(bundles, tmp_path)
    aim_at_everything()
    found = decisions(Walk.of(material.node_tree))
    undeclared = [words for words in found if ("+" in words or " x" in words) and words not in DELIBERATE]
    assert not undeclared, "one random number decides several things: give each its own, or say why not"
    # The lens decides what the first two do, in their place: where a direction goes.
    assert sorted(found) == sorted([*expected, *expected[:2]])


def test_the_walk_tells_numbers_by_what_they_are_computed_from() -> None:
    """Two groups of other names that compute alike draw the same numbers, which no node shows."""

    def twice() -> tuple[object, ...]:
        first, second = call(random_numbers_group()), call(copied)
        return first[0] < 0.5, second[0] < 0.25

    copied = random_numbers_group().copy()
    tree = node_group("test twice", {}, {"A": "float", "B": "float"}, twice)
    assert "LESS_THAN x2" in decisions(Walk.of(tree))


# Of xi in the shaders of `nodes/osl`: twins of the lists above.
OSL_DELIBERATE = {0: AN_AIMED_DRAW_OR_THE_MATERIALS, 1: AN_AIMED_DRAW_OR_THE_MATERIALS}


def test_every_number_of_the_osl_twin_is_taken_once() -> None:
    text, aim, place = (
        (SHADERS / f"measured_{name}.osl").read_text(encoding="utf-8") for name in ("material", "aim", "world")
    )
    # Where lamps are sampled the shader ends; it draws the mirror and takes one choice as elsewhere.
    start, stop = text.index("    if (Points > 0) {"), text.index("    if (Lamps > 0 && Shares")
    # 4 thrice: what the table gives of lamps, world and mirror is added. 6 and 7 twice: they may be the lens' numbers.
    assert "mm_by_lens(Lens, xi[6], xi[7]);" in text[start:stop]
    # 5 twice, for one choice or the other: of a mirror that is aimed, or of one that meets a lamp and is not.
    assert "if (followed >= 0 && !aims) {" in text[start:stop]
    assert _taken(text[start:stop]) == [0, 1, 2, 3, 4, 4, 4, 5, 5, 6, 6, 7, 7, 8]
    text = text[:start] + text[stop:]
    # Where the lens is known the first chooses closures or mirror, not the sixth: what that leaves of it is even. Where
    # lamps are aimed at, `measured_aim.osl` has placed the direction by it already.
    chosen = "    if (Lens[2] > 0 && Lamps <= 0)\n      mm_choose_by_first(chance, xi[0], xi[5]);\n"
    assert f"{chosen}    if (xi[5] >= chance)" in text
    assert _taken(text) == [0, 0, 0, 1, 1, 2, 3, 4, 5, 5, 8]
    # The other draw of a mirror, or one towards a light; beside it one towards the world, which is added.
    middle = aim.index("  if (Lit > 0) {")
    other = aim.index("  else {", middle)
    drawn = _taken(aim[:middle]) + _taken(aim[other:])
    assert sorted(drawn) == sorted([*range(4), 6, 7, *OSL_DELIBERATE, 0, 1])
    assert _taken(aim[middle:other]) == [0, 1, 7] and _taken(place) == [0, 0, 1, 1]
    for whole in (text, aim, place):
        assert whole.count("mm_by_lens(") == 1 and "mm_by_lens(Lens, xi[0], xi[1]);" in whole
        # And never as a whole but where they are drawn.
        assert re.findall(r"\bxi\b(?!\[)", whole) == ["xi"]


def _taken(text: str) -> list[int]:
    """Which of `xi` a text names, in order."""
    return sorted(int(index) for index in re.findall(r"xi\[(\d)\](?!;)", text.replace("float xi[9];", "")))


def test_three_keys_make_the_nine_numbers_of_osl() -> None:
    text = (SHADERS / "measured_materials.h").read_text(encoding="utf-8")
    body = text[text.index("void mm_random(") :].partition("\n}\n")[0]
    assert [int(k) for k in re.findall(r"numbers\[3 \* k(?: \+ (?:1|2))?\] = three\[(\d)\]", body)] == [0, 1, 2]
    assert 'noise("hash", position, ray[k])' in body


def test_a_black_channel_under_the_default_sun(tmp_path: Path) -> None:
    """Where no metal can carry a mirror's faint weight, roulette does; with a planted 4 % that fails."""
    colour = (0.5, 0.0, 0.25)
    settings = BakeSettings(resolution=8, alpha=(0.5, 0.3), storage=Storage.FLOAT32, envelope=False)
    bundle = read_bundle(bake_source(analytic.Lambert(colour), tmp_path / "lambert", settings).path)
    with lit_sphere(diffuse_material(colour), 48, lamp=False, ground=False, resolution=32) as scene:
        scene.leave_terminator()
        scene.scene.world = None
        add_lamp(scene, "SUN", (1, -1.5, 2), energy=2, angle=math.radians(0.526))
        mask = scene.mask()
        expected = scene.render(24, 6)
        # The sun's own edge of night is too uneven for tiles.
        mask &= expected.mean((0, 3)) > 0.1 * expected[:, mask].mean()
        scene.show(build_material(bundle, mode="reference", lamps=lamp_image()))
        pictures = scene.render(96, range(100, 108))
        assert not pictures[..., 1].any()
        lit = [0, 2, 2]  # a channel of nothing has no difference in parts of it
        found = compare(expected[..., lit], pictures[..., lit], mask)
        print(found)
        assert_agree(found, 0.03)
        assert not compare(expected[..., lit], 1.04 * pictures[..., lit], mask).passed


def test_numbers_of_one_sample_are_independent() -> None:
    """The six and the three, over many rays: no pair is correlated, none is uneven."""
    side = 96
    at = np.zeros((side * side, 3), np.float32)

    def drawn(_: object) -> tuple[object, ...]:
        numbers = (*call(random_numbers_group()), *call(more_random_numbers_group()))
        return tuple(expr.vec(*numbers[k : k + 3]) for k in (0, 3, 6))

    values = np.concatenate(card(drawn, at), 1).astype(float)
    assert np.abs(values.mean(0) - 0.5).max() < 4 * math.sqrt(1 / 12 / len(values))
    assert np.abs((values**2).mean(0) - 1 / 3).max() < 4 * math.sqrt(4 / 45 / len(values))
    correlation = np.corrcoef(values.T) - np.eye(9)
    # 36 pairs: one of them passes four standard deviations once in 400 sets of numbers; these are always the same.
    assert np.abs(correlation).max() < 4 / math.sqrt(len(values))
