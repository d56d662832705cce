"""Bidirectional texture functions of the gantry: directions, rectified pictures, compression, what is shown."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.demo.roll import roll, sun_from
from measured_materials.addon.gantry.techniques import direction, frame_uv, pixels
from measured_materials.nodes import compat
from support.btf.btf import Btf, compressed, whole
from support.btf.figure_4 import CASES, DIRECTIONS, GROUPS, SUN, Rival, _kept, _told
from support.btf.photograph import photograph_btf, rectified
from support.btf.rings import Rings
from support.scenes import diffuse_material

RINGS = Rings(((0.0, 1), (30.0, 4), (60.0, 6)))


def towards(theta: float, phi: float) -> np.ndarray:
    return np.array(direction(90 - theta, phi))


def mixed(rings: Rings, theta: float, phi: float) -> dict[int, float]:
    """Weight by number of a direction, those of none left out."""
    found: dict[int, float] = {}
    for index, weight in rings.around(towards(theta, phi)):
        found[int(index)] = found.get(int(index), 0.0) + float(weight)
    return {index: weight for index, weight in found.items() if weight > 1e-9}


# --- directions -----------------------------------------------------------------------------------------


def test_a_direction_of_the_rings_is_itself() -> None:
    assert len(DIRECTIONS.angles) == 21
    for number, angles in enumerate(RINGS.angles):
        assert mixed(RINGS, *angles) == pytest.approx({number: 1.0})


def test_between_rings_and_within_one() -> None:
    # A third of the way from the ring at 30 degrees to the one at 60, at the azimuth of a direction on both.
    assert mixed(RINGS, 40, 0) == pytest.approx({1: 2 / 3, 5: 1 / 3})
    # Azimuth 345: past the last of six, a quarter of the way back from the first.
    assert mixed(RINGS, 60, 345) == pytest.approx({10: 0.25, 5: 0.75})
    assert mixed(RINGS, 15, 90) == pytest.approx({0: 0.5, 2: 0.5})
    assert mixed(RINGS, 80, 60) == pytest.approx({6: 1.0})


@pytest.mark.parametrize(
    "rings", [((0.0, 1),), ((10.0, 1), (30.0, 4)), ((0.0, 1), (60.0, 4), (30.0, 4)), ((0.0, 1), (90.0, 4))]
)
def test_rings_without_sense_are_refused(rings: tuple[tuple[float, int], ...]) -> None:
    with pytest.raises(ValueError, match="rings"):
        Rings(rings)


# --- pictures -------------------------------------------------------------------------------------------


def pattern(uv: np.ndarray) -> np.ndarray:
    """Smooth, periodic, alike in no two places."""
    u, v = 2 * np.pi * uv[..., 0], 2 * np.pi * uv[..., 1]
    return 2 + np.stack([np.sin(u), np.sin(v + 1), np.cos(u - 2 * v)], -1)


class Painted:
    """A gantry above a painted plane that is as bright as the cosine of the light, 1 + that of the view."""

    size = 24

    def set_view(self, theta: float, phi: float) -> None:
        self.view = theta, phi

    def set_light(self, theta: float, phi: float) -> None:
        self.light = theta, phi

    def render(self, seed: int = 0) -> np.ndarray:
        frame = pixels(pattern(frame_uv(self.size, self.view, 4)), 4) * lit(math.cos(self.light[0]), self.view[0])
        return frame.astype(np.float32)


def lit(cosine: float, theta: float) -> float:
    return cosine * (1 + math.cos(theta))


@pytest.mark.parametrize("view", [(0, 0), (25, 72), (50, 180), (72, 270), (72, 45), (60, 333), (60, 90)])
def test_oblique_frames_are_made_upright(view: tuple[float, float]) -> None:
    theta, phi = map(math.radians, view)
    upright = pattern(frame_uv(128))
    seen = rectified(pixels(pattern(frame_uv(128, (theta, phi), 4)), 4).astype(np.float32), (theta, phi))
    # At 72 degrees a pixel covers three texels, which takes 0.018 off the pattern's finer waves.
    np.testing.assert_allclose(seen, upright, atol=0.03)


def test_all_pairs_of_directions_are_photographed() -> None:
    told: list[float] = []
    btf = photograph_btf(Painted(), RINGS, DIRECTIONS, told.append)
    assert btf.pictures.shape == (11, 21, 24, 24, 3) and btf.bytes == 2 * btf.pictures.size
    assert told == sorted(told) and told[-1] == 1 and len(told) == 11 * 21
    upright = pattern(frame_uv(24))
    for (theta, _), row in zip(RINGS.angles, btf.pictures):
        for (light, _), picture in zip(DIRECTIONS.angles, row):
            wanted = upright * lit(math.cos(math.radians(light)), math.radians(theta))
            # At 60 degrees a pixel is a twelfth of the pattern: 0.28 of what is 4.6 at most.
            np.testing.assert_allclose(picture, wanted, atol=0.4)
            assert picture.mean() == pytest.approx(wanted.mean(), rel=0.01)


# --- between and compressed -----------------------------------------------------------------------------


def random_btf(rank: int = 99, size: int = 6) -> Btf:
    """Whose pictures are sums of so many; every one of its numbers above 0."""
    rng = np.random.default_rng(4)
    count = len(RINGS.angles)
    parts = min(rank, count * count)
    pictures = rng.uniform(0.1, 1, (count * count, parts)) @ rng.uniform(0.1, 1, (parts, size * size * 3)) / parts
    return whole(pictures.reshape(count, count, size, size, 3).astype(np.float32), RINGS, RINGS)


def test_a_btf_shows_its_own_pictures_and_what_lies_between() -> None:
    btf = random_btf()
    uv = frame_uv(6)
    for view, light in ((0, 0), (3, 7), (10, 1)):
        wi, wo = towards(*RINGS.angles[light]), towards(*RINGS.angles[view])
        np.testing.assert_allclose(btf.at(uv, wi, wo), btf.pictures[view, light], rtol=1e-6)
    # Half way between the texels of a row, the views of two rings and the lights of one.
    uv = uv + np.array([0.5 / 6, 0])
    rows = 0.5 * (btf.pictures + np.roll(btf.pictures, -1, 3))
    wanted = 0.25 * (rows[0, 5] + rows[0, 6] + rows[1, 5] + rows[1, 6])
    np.testing.assert_allclose(btf.at(uv, towards(60, 30), towards(15, 0)), wanted, rtol=1e-6)


def test_low_light_fades_by_its_cosine() -> None:
    btf = random_btf()
    uv, wo = frame_uv(6), towards(0, 0)
    low = btf.at(uv, towards(80, 0), wo)
    ratio = math.cos(math.radians(80)) / math.cos(math.radians(60))
    np.testing.assert_allclose(low, ratio * btf.pictures[0, 5], rtol=1e-6)
    assert not btf.at(uv, np.array([0.8, 0, -0.6]), wo).any()


@pytest.mark.parametrize("per_view", [False, True])
def test_compression_is_the_nearest_of_its_rank(per_view: bool) -> None:
    btf = random_btf(size=8)
    found = compressed(btf, 4, per_view=per_view)
    matrices = btf.pictures.reshape(11 if per_view else 1, -1, 8 * 8 * 3)
    for matrix, kept in zip(matrices, found.pictures.reshape(matrices.shape)):
        u, s, v = np.linalg.svd(matrix.astype(np.float64), full_matrices=False)
        np.testing.assert_allclose(kept, (u[:, :4] * s[:4]) @ v[:4], atol=2e-6)
        assert np.abs(kept - matrix).max() > 1e-3
    assert found.bytes == 2 * 4 * ((8 * 8 * 3 + 121) if not per_view else 11 * (8 * 8 * 3 + 11))


def test_what_has_the_rank_is_kept() -> None:
    btf = random_btf(rank=4)
    np.testing.assert_allclose(compressed(btf, 4).pictures, btf.pictures, rtol=2e-5)
    assert compressed(btf, 16, per_view=True).bytes == 2 * 11 * 11 * (6 * 6 * 3 + 11), "a view has 11 pictures only"


# --- shown ----------------------------------------------------------------------------------------------


def of_frames(uv: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """Uneven in place, light and view."""
    lamp = np.stack([wi[..., 2] + wi[..., 0] / 3, wi[..., 2] + wi[..., 1] / 3, wi[..., 2]], -1)
    return pattern(uv) * lamp * (1 + wo[..., :1])


def test_cases_are_of_five_kinds_and_the_held_out_ones_none_of_the_btf() -> None:
    assert len(GROUPS) == 5
    own = {(round(theta, 6), round(phi, 6)) for theta, phi in DIRECTIONS.angles}
    for case in CASES:
        ((elevation, azimuth, _),) = case.lights
        light, view = (round(90 - elevation, 6), round(azimuth, 6)), tuple(round(x, 6) for x in case.view)
        assert (light in own) is (case.group == GROUPS[0])
        assert (view in own) is (case.group == GROUPS[0] or "above" in case.group)


def test_a_flat_picture_is_of_the_gantry_s_frame() -> None:
    case = next(case for case in CASES if case.view[0] == 61)
    shown = Rival("any", 0, 0, of_frames).picture(case, 16)
    ((elevation, azimuth, _),) = case.lights
    uv = frame_uv(16, case.view_radians, 4)
    wanted = of_frames(uv, np.array(direction(elevation, azimuth)), towards(*case.view))
    np.testing.assert_allclose(shown, pixels(wanted, 4), rtol=1e-9)


def test_a_roll_is_the_one_that_cycles_shows() -> None:
    """By place: the texture coordinates, shown as they are; by light: a matte sheet."""
    size = 24
    material = compat.new_material("uv")
    tree = material.node_tree
    uv, emission, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "Emission", "OutputMaterial"))
    tree.links.new(uv.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    places = roll(material, size, 64, sun_from(SUN, 0.0))
    bpy.data.materials.remove(material)
    by_uv = Rival("uv", 0, 0, lambda uv, wi, wo: np.concatenate([uv % 1, 0 * uv[..., :1]], -1)).rolled(size)
    # The light's side alone: the other is black in numpy, and not in what emits. At seams of tiles a pixel sees both.
    lit = by_uv.any(-1)
    assert lit[3:-3].all(1).sum() > 10
    off = np.abs(places - by_uv)[lit]
    assert np.median(off) < 0.01 and (off > 0.1).mean() < 0.15

    matte = diffuse_material(0.5)
    seen = roll(matte, size, 64, sun_from(SUN, 0.0))
    bpy.data.materials.remove(matte)
    shown = Rival("matte", 0, 0, lambda uv, wi, wo: np.repeat(wi[..., 2:] * 0.5 / math.pi, 3, -1)).rolled(size)
    # Away from the rim; a roll of 288 flats is meant to be round.
    np.testing.assert_allclose(shown[4:-4], seen[4:-4], atol=0.004)
    assert shown[4:-4].max() - shown[4:-4].min() > 0.1


def test_photographs_that_are_kept_are_taken_of_the_same_only(tmp_path: Path) -> None:
    file = tmp_path / "fig4_cloth.npz"
    assert _kept(file, _told(64, 16)) is None
    np.savez(file, btf=np.ones(3), around=np.zeros(2), told=_told(64, 16))
    btf, around = _kept(file, _told(64, 16))
    assert btf.tolist() == [1, 1, 1] and around.tolist() == [0, 0]
    assert _kept(file, _told(64, 32)) is None
    np.savez(file, btf=np.ones(3), around=np.zeros(2))
    assert _kept(file, _told(64, 16)) is None
