"""Lobes in float32: in numpy, and as node groups on render cards, against float64."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from measured_materials.bake import xp_numpy
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes import lobe_sampling
from measured_materials.bake.lobes.lobe_sampling import lobe_pdf
from measured_materials.bake.lobes.lobes import LOBES, Lobe, lobe_value, mirror_distance
from measured_materials.nodes import compat, expr
from measured_materials.nodes.group import call
from measured_materials.nodes.lobe_group import lobe_group, lobe_peak_group, sample_lobe_group
from support.cards import card
from support.lobe_cases import NARROW, WIDE, identity, pairs
from support.svm_stack import room_on_stack

every_lobe = pytest.mark.parametrize("lobe", WIDE + NARROW, ids=identity)

# Largest relative error in float32. cos^n: n roundings of the base (2^-25 each). Sheen: the exponent reaches
# (1 / x - 1) / sigma^2 of some hundreds. All others: a handful of operations.
CARD_ERROR = {Lobe("phong", 1e4, 0.0): 5e-4, Lobe("phong", 60.0, 0.0): 5e-6, Lobe("phong", 60.0, 0.3): 5e-6}
CARD_ERROR |= {Lobe("sheen", 0.05): 1e-4, Lobe("sheen", 0.2): 3e-5, Lobe("sheen", 1.0): 1e-5}


@every_lobe
def test_float32_keeps_the_digits(lobe: Lobe) -> None:
    """In float32 the formula stays finite, and within rounding it is the one of float64."""
    wi, wo = (w.astype(np.float32) for w in pairs())
    single = lobe_value(xp_numpy, lobe.name, wi, wo, np.float32(lobe.p1), np.float32(lobe.p2))
    double = Lobe(lobe.name, float(np.float32(lobe.p1)), float(np.float32(lobe.p2))).value(
        wi.astype(float), wo.astype(float)
    )
    assert np.isfinite(single).all()
    assert np.abs(single - double).max() <= CARD_ERROR.get(lobe, 4e-6) * double.max()


def card_inputs() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Float32 wi, wo and random numbers: the pole, grazing views, both ends of the random numbers."""
    compat.ensure_cycles()
    wi, wo = pairs(3000, seed=4)
    wo[::7] = spherical(np.resize([0.0, 1e-4, 1.2, 1.5698], len(wo[::7])), 0.4)
    wi[::11] = spherical(np.resize([0.0, np.pi / 2 - 1e-4, 1.7], len(wi[::11])), 2.0)
    random = np.random.default_rng(5).random((len(wo), 3))
    random[:27] = np.stack(np.meshgrid(*[[0.0, 0.5, 1.0]] * 3), -1).reshape(-1, 3)
    return wi.astype(np.float32), wo.astype(np.float32), random.astype(np.float32)


def relative(found: np.ndarray, truth: np.ndarray) -> float:
    """Largest relative error; below 0.01 per steradian, a thirtieth of Lambert, it is the absolute one that counts."""
    return float((np.abs(found - truth) / np.maximum(truth, 0.01)).max())


@every_lobe
def test_value_and_peak_nodes(lobe: Lobe) -> None:
    """The groups against float64."""
    wi, wo, _ = card_inputs()
    error = CARD_ERROR.get(lobe, 5e-6)
    (value,) = card(lambda i, o: call(lobe_group(lobe.name), i, o, lobe.p1, lobe.p2), wi, wo)
    assert relative(value, lobe.value(wi.astype(float), wo.astype(float))) < error
    (peak,) = card(lambda o: call(lobe_peak_group(lobe.name), o, lobe.p1, lobe.p2), wo)
    assert relative(peak, lobe.peak(wo.astype(float))) < error


@every_lobe
def test_sample_nodes(lobe: Lobe) -> None:
    """Where the nodes send a draw its pdf and value are those of float64, and nearly all draws go where numpy's go."""
    _, wo, u = card_inputs()
    group = sample_lobe_group(lobe.name)
    wi, pdf, value = card(lambda o, r: call(group, o, *expr.components(r), lobe.p1, lobe.p2), wo, u)
    exact, _ = lobe_sampling.sample(lobe, wo.astype(float), u.astype(float))
    assert np.median(np.abs(wi - exact).max(-1)) < 1e-6
    # At u = 1 a visible normal of GGX is the sum of two vectors that may cancel; such a draw points down.
    above = exact[:, 2] > 1e-3
    # The density of a wide lobe ends at 90 degrees from the mirror direction, where random numbers of 1 lead.
    above &= np.abs(mirror_distance(xp_numpy, exact, wo.astype(float)) - 1) > 1e-6
    assert np.abs(wi - exact).max(-1)[above].max() < 5e-4
    wi, wo = wi.astype(float)[above], wo.astype(float)[above]
    truth = np.broadcast_to(lobe_pdf(xp_numpy, lobe.name, wi, wo, lobe.p1, lobe.p2), len(wi))
    assert relative(pdf[above], truth) < CARD_ERROR.get(lobe, 5e-6)
    assert relative(value[above], lobe.value(wi, wo)) < CARD_ERROR.get(lobe, 5e-6)


def test_groups_are_shared_and_small() -> None:
    """Equal groups are made once; the budget of a whole material is about 120 nodes (method.md, section 15)."""
    compat.ensure_cycles()
    for name in LOBES:
        assert lobe_group(name) == lobe_group(name)
        assert varying(sample_lobe_group(name)) <= 75
        assert varying(lobe_group(name)) <= 60
        assert varying(lobe_peak_group(name)) <= 50


def varying(group: bpy.types.ShaderNodeTree) -> int:
    """Nodes that depend on more than the parameters: Cycles computes the others once, when it compiles the material."""
    found = set()
    pending = [n for n in group.nodes if n.bl_idname in ("NodeGroupInput", "ShaderNodeNewGeometry")]
    while pending:
        node = pending.pop()
        for socket in node.outputs:
            if socket.name in ("P1", "P2") and node.bl_idname == "NodeGroupInput":
                continue
            for link in socket.links:
                if link.to_node.name not in found:
                    found.add(link.to_node.name)
                    pending.append(link.to_node)
    return len(found) - 1


def test_what_depends_on_the_exponent_alone_is_computed_once() -> None:
    """The factor of a lobe takes 60 nodes and more, and no place on SVM's stack while the exponent is a number."""
    compat.ensure_cycles()
    names = ("phong", "phong_cubic")
    counts = [len(lobe_group(name).nodes) for name in names]
    assert counts[1] > counts[0] + 60
    rooms = []
    for name in names:
        material = compat.new_material(name)
        tree = material.node_tree
        with expr.building(tree):
            normal = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Normal"])
            value = call(lobe_group(name), normal, expr.vec(0.0, 0.0, 1.0), 30.0, 0.0)
            made = expr.node("ShaderNodeBsdfDiffuse", {}, {"Color": expr.vec(value, value, value)})
            output = tree.nodes.new("ShaderNodeOutputMaterial")
            tree.links.new(made.outputs[0], output.inputs["Surface"])
        rooms.append(room_on_stack(material))
        bpy.data.materials.remove(material)
    assert rooms[1] >= rooms[0] - 6
