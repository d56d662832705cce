"""Nodes of a shading map over azimuth against float64 numpy, and the frame that azimuths are counted in."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis, mean_curves
from measured_materials.bake.shading_maps.azimuth.azimuth_envelope import azimuth_envelope
from measured_materials.bake.shading_maps.azimuth.curve_layout import CurveLayout, pack_curves
from measured_materials.bake.shading_maps.slice_atlas import SliceLayout, pack_slices
from measured_materials.nodes import compat, expr
from measured_materials.nodes.azimuth_group import AzimuthImages, azimuth_group, mean_group
from measured_materials.nodes.group import call
from measured_materials.nodes.slices_group import SliceOptions
from measured_materials.nodes.swatch_frame_group import swatch_frame_group
from support.azimuth import clamped_basis
from support.azimuth_truth import Texels, between
from support.cards import card, data_image
from support.clean_blend import clean_blend  # noqa: F401
from support.planes import SHAPES, plane_scene

HEIGHT, WIDTH, AZIMUTHS, LEVELS = 5, 7, 12, 6
# As of slices (`test_shading_cards`), times coefficients and curves of up to 2, and 5e-8 of the curves' rows.
TOLERANCE = 2e-4


def images_of(basis: AzimuthBasis) -> AzimuthImages:
    split = azimuth_envelope(basis)
    tiles = np.ascontiguousarray(np.moveaxis(basis.coefficients, -1, 0))
    return AzimuthImages(
        data_image("coefficients", pack_slices(tiles)),
        data_image("envelope", np.concatenate([split.envelope, split.share[..., None]], -1)),
        SliceLayout(basis.rank, HEIGHT, WIDTH),
        curves=data_image("curves", pack_curves(basis.curves)),
        curve_layout=CurveLayout(*basis.curves.shape),
    )


def probes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """UV inside, outside and at the seams; x at 0, levels, between, 1 and beyond; azimuths at nodes and the seam."""
    rng = np.random.default_rng(1)
    uv = rng.uniform(-2.5, 2.5, (600, 2))
    uv[:40] = rng.choice([0.0, 1.0, -1.0, 0.5 / WIDTH, 1 - 0.5 / WIDTH], (40, 2))
    x = rng.uniform(0, 1, 600)
    x[::7] = np.tile(np.linspace(0, 1, LEVELS), 15)[: len(x[::7])]
    x[3::11] = rng.uniform(1, 4, len(x[3::11]))
    phi = rng.uniform(-np.pi, np.pi, 600)
    phi[::5] = np.tile(2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS, 10)[: len(phi[::5])]
    phi[1::13] = np.tile([0.0, 1e-7, -1e-7, np.pi, -np.pi, -1e-3], 8)[: len(phi[1::13])]
    return uv.astype(np.float32), x.astype(np.float32), phi


def light(phi: np.ndarray) -> np.ndarray:
    """Parts of a direction along u and v, of any length; the third is of no matter."""
    length = np.linspace(0.02, 1, len(phi))
    return np.stack([length * np.cos(phi), length * np.sin(phi), 0.7 + 0 * phi], -1).astype(np.float32)


def looked_up(group: bpy.types.ShaderNodeTree, uv: np.ndarray, *rest: np.ndarray) -> list[np.ndarray]:
    uv3 = np.concatenate([uv, np.zeros((len(uv), 1))], -1).astype(np.float32)
    return card(lambda at, *more: call(group, at, *more), uv3, *rest)


@pytest.mark.parametrize(
    "rank, above, interpolation",
    [
        (5, "clamp", "Linear"),
        (5, "scale", "Fetched"),
        pytest.param(1, "clamp", "Linear", marks=pytest.mark.slow),
        pytest.param(4, "scale", "Linear", marks=pytest.mark.slow),
        pytest.param(23, "clamp", "Linear", marks=pytest.mark.slow),
    ],
)
def test_lookup_as_in_numpy(rank: int, above: str, interpolation: str) -> None:
    basis = clamped_basis(HEIGHT, WIDTH, AZIMUTHS, LEVELS, rank)
    uv, x, phi = probes()
    group = azimuth_group("test azimuth", images_of(basis), SliceOptions(above, interpolation=interpolation))
    reflected, residual, envelope, share = looked_up(group, uv, x, np.ones_like(x), x, light(phi))
    expected = Texels.at(basis, uv).looked_up(x, phi, above)
    assert np.abs(reflected - expected).max() < TOLERANCE * (4 if above == "scale" else 1)
    # Half of what is looked up is held by the envelope's line, and it does bend the rest.
    assert 0.02 < (reflected <= envelope * np.minimum(x, 1)[:, None] + 1e-6).mean()
    inside = x <= 1
    assert np.abs(residual + envelope * x[:, None] - reflected)[inside].max() < 1e-5
    assert residual.min() >= 0
    assert np.abs(share - between(azimuth_envelope(basis).share, uv)).max() < TOLERANCE
    # Another azimuth is another picture.
    assert np.abs(Texels.at(basis, uv).looked_up(x, phi + 0.05, above) - expected).max() > 10 * TOLERANCE or rank == 1


@pytest.mark.slow
@pytest.mark.parametrize("above", ["clamp", "scale"])
def test_coloured_levels_reach_their_own_curves(above: str) -> None:
    basis = clamped_basis(HEIGHT, WIDTH, AZIMUTHS, LEVELS)
    uv, x, phi = probes()
    colour = np.stack([x, x[::-1], np.roll(x, 5)], -1)
    group = azimuth_group("test azimuth", images_of(basis), SliceOptions(above, coloured=True))
    reflected = looked_up(group, uv, colour, np.ones_like(x), x, light(phi))[0]
    assert np.abs(reflected - Texels.at(basis, uv).looked_up(colour, phi, above)).max() < TOLERANCE * 4


def test_envelope_knows_no_azimuth_and_stays_below_as_far_as_f_r_reaches() -> None:
    """The closure carries it whatever the light: by one number of the texel and the viewer."""
    basis = clamped_basis(HEIGHT, WIDTH, AZIMUTHS, LEVELS)
    basis.coefficients[..., 0] += 2  # for envelopes above 0
    uv, x, phi = probes()
    peak = np.full_like(x, 4)
    group = azimuth_group("test azimuth", images_of(basis), SliceOptions(peak=True))
    reflected, residual, envelope, _ = looked_up(group, uv, x, peak, x, light(phi))
    assert np.abs(reflected - Texels.at(basis, uv).looked_up(x, phi, "clamp")).max() < TOLERANCE
    assert residual.min() > -1e-5
    assert np.abs(residual + envelope * x[:, None] - reflected).max() < 2e-5
    expected = between(azimuth_envelope(basis).envelope, uv) / 4
    assert expected.max() > 0.1
    assert np.abs(envelope - expected).max() < TOLERANCE


def test_extended_border_stays_in_the_swatch() -> None:
    basis = clamped_basis(HEIGHT, WIDTH, AZIMUTHS, LEVELS)
    uv, x, phi = probes()
    group = azimuth_group("test azimuth", images_of(basis), SliceOptions(tiling="extend"))
    reflected = looked_up(group, uv, x, np.ones_like(x), x, light(phi))[0]
    half = 0.5 / np.array([WIDTH, HEIGHT])
    assert (
        np.abs(reflected - Texels.at(basis, np.clip(uv, half, 1 - half)).looked_up(x, phi, "clamp")).max() < TOLERANCE
    )


def test_lit_from_all_around_is_the_mean_of_the_curves() -> None:
    basis = clamped_basis(HEIGHT, WIDTH, AZIMUTHS, LEVELS)
    uv, x, _ = probes()
    means = mean_curves(basis.curves)
    reflected = looked_up(mean_group("test mean", images_of(basis), means, SliceOptions()), uv, x, x, x)[0]
    texels = Texels.at(basis, uv)
    for k in range(0, len(x), 7):
        one = Texels(basis, texels.coefficients[k : k + 1], texels.envelope[k : k + 1])
        assert np.abs(reflected[k] - one.still(float(x[k]))[0]).max() < TOLERANCE


# --- the frame ------------------------------------------------------------------------------------------

# UVs of the planes by x and y; the Mapping node scales first, then turns.
PLANE = np.array([[0.8, 0.3], [-0.2, 0.9]])
LAID_OUT = {"as it is": (1.0, 1.0, 0.0), "turned, uneven": (6.0, 4.0, 0.9), "mirrored": (-3.0, 3.0, -2.0)}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("laid_out", LAID_OUT)
def test_frame_runs_with_the_swatch(shape: str, laid_out: str) -> None:
    """Along U leads where u grows and v stays, under any transform of the object and of the coordinates."""
    scale_u, scale_v, turn = LAID_OUT[laid_out]
    material = compat.new_material("frame")
    seen = []
    for which in range(2):
        tree = material.node_tree
        tree.nodes.clear()
        with expr.building(tree):
            uv = expr.Vector(expr.node("ShaderNodeUVMap", {}, {}).outputs[0])
            inputs = {"Vector": uv, "Scale": (scale_u, scale_v, 1.0), "Rotation": (0, 0, turn), "Location": (3, 0.2, 0)}
            mapped = expr.Vector(expr.node("ShaderNodeMapping", {}, inputs).outputs[0])
            along = call(swatch_frame_group(), mapped)[which]
            made = expr.node("ShaderNodeEmission", {}, {"Color": expr.scale(along, 0.25) + expr.vec(0.5, 0.5, 0.5)})
            tree.links.new(made.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
        with plane_scene(material, SHAPES[shape], applied=False) as scene:
            mask = scene.mask()
            scene.scene.render.filter_size = 0.01
            seen.append((scene.render(1, 1)[0][mask] - 0.5) / 0.25)
    cosine, sine = np.cos(turn), np.sin(turn)
    mapping = np.array([[cosine, -sine], [sine, cosine]]) @ np.diag([scale_u, scale_v])
    # Columns: how the position changes with u and with v.
    edges = np.array(SHAPES[shape])[:3, :2] @ np.linalg.inv(mapping @ PLANE)
    along_u = edges[:, 0] / np.linalg.norm(edges[:, 0])
    along_v = edges[:, 1] - along_u * (along_u @ edges[:, 1])
    along_v /= np.linalg.norm(along_v)
    # A pixel is a thirtieth of a unit of UVs up to 6, which float32 knows to 5e-7: 2e-5 of the difference.
    assert np.abs(seen[0] - along_u).max() < 3e-5
    assert np.abs(seen[1] - along_v).max() < 3e-5


def test_without_coordinates_the_frame_is_some_tangents() -> None:
    """Never a vector of length 0, of which azimuths would be none."""
    normal = (0.0, 0.0, 1.0)
    along_u, along_v = card(
        lambda at: call(swatch_frame_group(), expr.vec(0.3, 0.3, 0.0)), np.zeros((16, 3), np.float32)
    )
    assert np.allclose([np.linalg.norm(v, axis=-1) for v in (along_u, along_v)], 1, atol=1e-5)
    assert np.allclose(np.cross(along_u, along_v), normal, atol=1e-5)
