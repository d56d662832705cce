"""Cosine lobes as nodes and in OSL, against float64 numpy on render cards."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
import pytest
from measured_materials import addon
from measured_materials.addon.lights.light_tables import lamp_image
from measured_materials.addon.scene_check.check import check_scene
from measured_materials.addon.ui import add_cosine_lobe
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes.cosine_lobes import COSINE_LOBES, cosine_lobe, half_chord_square, lobe_norm
from measured_materials.nodes import compat, expr
from measured_materials.nodes.cosine_lobe_group import cosine_lobe_group, highlight_group
from measured_materials.nodes.group import HASH_KEY, call
from support.cards import card
from support.osl import header_card, shader_card, skip_without_osl
from support.svm_stack import aim_at_everything, fits_with

every_lobe = pytest.mark.parametrize("name", COSINE_LOBES)
# Absolute, of a peak of 1: a dozen float32 roundings; OSL's exponential is fast and wrong by 1e-5 in parts.
VALUE_ERROR, OSL_VALUE_ERROR = 1e-6, 1e-5
# Relative; the logarithm of Schlick's closed form counts up to ten times. OSL's sine and cosine are fast, and those of
# "cosine" are summed where they are smallest (seen: 1.2e-4).
NORM_ERROR, OSL_NORM_ERROR = 1e-5, 2e-4


def edge_grid() -> tuple[np.ndarray, np.ndarray]:
    """Float32 u and n: the peak, the join, 90 degrees, an ulp on either side of both, and the tail; n to 1e8."""
    exponents = np.concatenate([[0.01, 0.5, 0.999, 1, 1.001, 2, 4, 256, 1e4, 1e6, 1e8], 10 ** np.linspace(-2, 8, 60)])
    u, n = [], []
    for exponent in exponents.astype(np.float32):
        p = np.float32(-np.expm1(-np.log(2) / max(float(exponent), 1)))
        around = [np.nextafter(x, np.float32(y)) for x in (p, np.float32(1)) for y in (0, 2)]
        at = np.concatenate([[0, p, 1, 1.5, 2], around, np.geomspace(1e-3 * p, 1, 40), np.linspace(0, 2 * p, 20)])
        u.append(at.astype(np.float32))
        n.append(np.full(len(at), exponent, np.float32))
    return np.concatenate(u), np.concatenate(n)


def value_truth(name: str, u: np.ndarray, n: np.ndarray) -> np.ndarray:
    return np.asarray(cosine_lobe(xp_numpy, name, u.astype(float), n.astype(float)))


@every_lobe
def test_value_nodes(name: str) -> None:
    u, n = edge_grid()
    (found,) = card(lambda u, n: cosine_lobe(expr, name, u, n), u, n)
    assert np.isfinite(found).all() and found.min() >= 0
    assert np.abs(found - value_truth(name, u, n)).max() < VALUE_ERROR


@every_lobe
def test_norm_nodes(name: str) -> None:
    n = np.unique(edge_grid()[1])
    (found,) = card(lambda n: lobe_norm(expr, name, n), n)
    assert np.abs(found / lobe_norm(xp_numpy, name, n.astype(float)) - 1).max() < NORM_ERROR


@every_lobe
def test_osl(name: str) -> None:
    skip_without_osl()
    u, n = edge_grid()
    body = f'y = mm_cosine_lobe("{name}", x, n); f = mm_lobe_norm("{name}", n);'
    found, norm = header_card(body, {"y": "float", "f": "float"}, "measured_lobes.h", x=u, n=n)
    assert np.isfinite(found).all() and found.min() >= 0
    assert np.abs(found - value_truth(name, u, n)).max() < OSL_VALUE_ERROR
    assert np.abs(norm / lobe_norm(xp_numpy, name, n.astype(float)) - 1).max() < OSL_NORM_ERROR


def directions() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Float32 normals, other directions from 1e-4 rad to 180 degrees away and of any length, and exponents."""
    rng = np.random.default_rng(0)
    theta = np.concatenate([10 ** rng.uniform(-4, 0, 1000), rng.uniform(0, np.pi, 1000), [0, np.pi]])
    a = spherical(np.full(len(theta), 0.7), rng.uniform(-3, 3, len(theta)))
    across = np.cross(a, rng.normal(size=a.shape))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    b = np.cos(theta)[:, None] * a + np.sin(theta)[:, None] * across
    n = 10 ** rng.uniform(-1, 4, len(theta))
    return a.astype(np.float32), (b * rng.uniform(0.1, 10, (len(b), 1))).astype(np.float32), n.astype(np.float32)


@every_lobe
def test_group_and_shader_of_two_directions(name: str) -> None:
    """As artists use them."""
    skip_without_osl()
    a, b, n = directions()
    unit = [v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (a.astype(float), b.astype(float))]
    truth = cosine_lobe(xp_numpy, name, half_chord_square(xp_numpy, *unit), n.astype(float))
    factor = lobe_norm(xp_numpy, name, n.astype(float))
    nodes = card(lambda a, b, n: call(cosine_lobe_group(name), a, b, n), a, b, n)
    constants = {"Lobe": name}
    osl = shader_card("cosine_lobe.osl", ["Value", "Normalized"], constants, Normal=a, Direction=b, Exponent=n)
    # At 90 degrees lobes that do not vanish there jump.
    inside = np.abs(np.sum(unit[0] * unit[1], -1)) > 1e-6
    for value, normalized in (nodes, osl):
        # Unit vectors of float32 are 6e-8 off, which moves u by sqrt(2 u) times that: n times the slope, at most
        # 0.43 sqrt(n) 1.2e-7 of the peak, 5e-6 at n = 1e4.
        assert np.abs(value - truth)[inside].max() < 1e-5
        assert (np.abs(normalized / factor - truth))[inside].max() < 2e-5


@every_lobe
def test_any_exponent_gives_a_number(name: str) -> None:
    """Typed in, or of a texture: at 1e38 the factors of two lobes overflowed, and were negative."""
    skip_without_osl()
    angle, n = (g.ravel() for g in np.meshgrid(np.linspace(0, 1.6, 60), [-1e30, -1, 0, 1e9, 1e10, 1e20, 1e38]))
    a = np.broadcast_to(np.array([0, 0, 1], np.float32), (len(n), 3)).copy()
    b, n = spherical(angle, np.full(len(n), 0.3)).astype(np.float32), n.astype(np.float32)
    nodes = card(lambda a, b, n: call(cosine_lobe_group(name), a, b, n), a, b, n)
    constants = {"Lobe": name}
    osl = shader_card("cosine_lobe.osl", ["Value", "Normalized"], constants, Normal=a, Direction=b, Exponent=n)
    for value, normalized in (nodes, osl):
        assert np.isfinite(normalized).all() and normalized.min() >= 0
        assert np.isfinite(value).all() and value.min() >= 0 and value.max() <= 1 + VALUE_ERROR


def test_unlinked_inputs_are_the_surfaces_own() -> None:
    """A card seen from straight above: all directions agree, the lobe is 1."""
    group = cosine_lobe_group("cubic")
    zero = np.zeros((64, 3), np.float32)
    (value, _) = card(lambda v: call(group, v, v, 1e4), zero)
    assert value == pytest.approx(1, abs=1e-6)


@every_lobe
def test_highlight_leaves_room_on_the_stack(name: str) -> None:
    """With the exponent a texture's, and everything to aim at; ten nodes of a colour and a number each before it."""
    material = compat.new_material("highlight")
    tree = material.node_tree
    with expr.building(tree):
        n = expr.Scalar(expr.node("ShaderNodeTexWhiteNoise", {}, {}).outputs["Value"]) * 100
        closure, _ = call(highlight_group(name, lamp_image()), expr.vec(0.5, 0.5, 0.5), n, expr.vec(0.0, 0.0, 0.0))
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        expr.feed(tree, output.inputs["Surface"], closure)
    aim_at_everything()
    assert fits_with(material, 39)
    bpy.data.materials.remove(material)


@pytest.fixture
def registered() -> Iterator[None]:
    """The extension, switched on."""
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def active_material() -> Iterator[bpy.types.Material]:
    """On an active object."""
    compat.ensure_cycles()
    material = compat.new_material("plain")
    mesh = bpy.data.meshes.new("plain")
    mesh.materials.append(material)
    obj = bpy.data.objects.new("plain", mesh)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    yield material
    bpy.data.objects.remove(obj)
    bpy.data.materials.remove(material)


@pytest.mark.parametrize("kind", ["VALUE", "HIGHLIGHT"])
@every_lobe
def test_operator(registered: None, active_material: bpy.types.Material, name: str, kind: str) -> None:
    assert bpy.ops.measured_materials.add_cosine_lobe(lobe=name, kind=kind) == {"FINISHED"}
    (node,) = active_material.node_tree.nodes
    assert node == active_material.node_tree.nodes.active and HASH_KEY in node.node_tree
    sockets = [s.name for s in node.inputs]
    if kind == "HIGHLIGHT":
        assert sockets == ["Color", "Exponent", "Normal"] and [s.name for s in node.outputs] == ["BSDF", "EEVEE"]
        assert not active_material.cycles.use_bump_map_correction
    else:
        assert sockets == ["Normal", "Direction", "Exponent"]
        assert [s.name for s in node.outputs] == ["Lobe", "Normalized"]
    assert node.inputs["Exponent"].default_value == 50
    # Another lobe takes its place and keeps what is set and linked.
    node.inputs["Exponent"].default_value = 7
    other = add_cosine_lobe.add_cosine_lobe(active_material.node_tree, COSINE_LOBES[0], kind).node_tree
    node.node_tree = other
    assert node.inputs["Exponent"].default_value == 7


def test_scene_check_looks_at_highlights(registered: None, active_material: bpy.types.Material) -> None:
    """They are mirrors as measured materials are, though no bundle stands behind them."""
    bpy.ops.measured_materials.add_cosine_lobe(lobe="cubic", kind="HIGHLIGHT")
    tree = active_material.node_tree
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(tree.nodes.active.outputs["BSDF"], output.inputs["Surface"])
    active_material.cycles.use_bump_map_correction = True
    found = check_scene(bpy.context.scene)
    assert found and any("bump" in finding.key.lower() or "Bump" in finding.setting for finding in found)


def test_operator_needs_a_material(registered: None) -> None:
    bpy.context.view_layer.objects.active = None
    assert not bpy.ops.measured_materials.add_cosine_lobe.poll()


def test_menu_comes_and_goes() -> None:
    def entries() -> int:
        draws = getattr(bpy.types.NODE_MT_add.draw, "_draw_funcs", [])
        return sum(f.__module__.endswith("add_cosine_lobe") for f in draws)

    for _ in range(2):
        addon.register()
        assert entries() == 1
        addon.unregister()
        assert entries() == 0
