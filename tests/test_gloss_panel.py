"""Gloss as an artist has it: a socket with limits, kept by rebuilds, told where it brightens too much."""

# ruff: noqa: F811  (fixtures of another module, asked for by their names)

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from measured_materials.addon.material.adjust.energy import energy_of
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.facts import facts_of, keep_facts, record_of
from measured_materials.addon.material.rebuild import rebuild_brdf
from measured_materials.bake.brdf.common import RenderingRecord
from measured_materials.bake.sampling.gloss import LEAST, MOST
from measured_materials.nodes.compat import curves_of
from measured_materials.nodes.material_tree import measured_nodes
from support.coarse_bakes import coarse  # noqa: F401
from test_addon import known_bakes, lacquer, registered  # noqa: F401
from test_addon_arc import felt, stack  # noqa: F401


def gloss_of(material: Any) -> Any:
    return measured_nodes(material.node_tree)[0][1].inputs["Gloss"]


def test_gloss_is_a_socket_of_brdfs_alone(lacquer: Any, felt: Any) -> None:
    """Shading maps have a base reflection of their own choice, with its own width."""
    tree = measured_nodes(lacquer.node_tree)[0][1].node_tree
    item = next(item for item in tree.interface.items_tree if item.name == "Gloss")
    assert (item.default_value, item.min_value, item.max_value) == (1.0, LEAST, MOST)
    assert gloss_of(lacquer).default_value == 1
    assert "Gloss" not in measured_nodes(felt.node_tree)[0][1].inputs


@pytest.mark.parametrize("mode", ["preview", "reference"])
def test_a_rebuild_keeps_the_gloss(lacquer: Any, mode: str) -> None:
    gloss_of(lacquer).default_value = 2.5
    noise = lacquer.node_tree.nodes.new("ShaderNodeTexNoise")
    lacquer.node_tree.links.new(noise.outputs[0], gloss_of(lacquer))
    rebuild_brdf(lacquer, Choices(mode=mode))
    assert gloss_of(lacquer).default_value == 2.5
    assert gloss_of(lacquer).links[0].from_node == noise


def test_what_gloss_adds_is_told(lacquer: Any) -> None:
    """With what the closures gain by it; softer tells nothing, and of a link the most that it can be."""
    facts = facts_of(lacquer)
    rows = [[0.0, 0.0, 0.0]] * len(record_of(lacquer).albedo.theta_o_deg)
    lost = 1.2 - record_of(lacquer).albedo.largest
    gained = [[lost, lost, lost] for _ in rows]
    keep_facts(lacquer, {**facts, "rendering": {**facts["rendering"], "brightened": [[1.0, rows], [4.0, gained]]}})
    assert energy_of(lacquer) is None
    for gloss in (0.5, 1.01):
        gloss_of(lacquer).default_value = gloss
        assert energy_of(lacquer) is None or not energy_of(lacquer).gains
    gloss_of(lacquer).default_value = 4.0
    found = energy_of(lacquer)
    assert (
        found.gains
        and found.largest == pytest.approx(1.2, abs=1e-6)
        and "A Brightness of up to 0.8333 is safe" in found.words
    )
    noise = lacquer.node_tree.nodes.new("ShaderNodeTexNoise")
    lacquer.node_tree.links.new(noise.outputs[0], gloss_of(lacquer))
    assert energy_of(lacquer).unknown == ("Gloss",)
    keep_facts(lacquer, {**facts, "rendering": {**facts["rendering"], "brightened": []}})
    assert energy_of(lacquer) is None


def test_a_material_knows_what_its_closures_gain(lacquer: Any) -> None:
    """By mode; Reference, all of it the mirror, gains nothing."""
    rebuild_brdf(lacquer, Choices(mode="preview"))
    told = dict(record_of(lacquer).rendering.brightened)
    assert np.array(told[4.0]).shape == (len(record_of(lacquer).albedo.theta_o_deg), 3)
    assert 0 < np.max(told[2.0]) < np.max(told[4.0]) < 0.5 and not np.any(told[1.0])
    rebuild_brdf(lacquer, Choices(mode="reference"))
    assert record_of(lacquer).rendering.brightened == ()


@pytest.mark.parametrize("wrong", [7, [[1.0]], [["a", []]], [[1.0, [[1, 2]]]], [[1.0, 5]], {"a": 1}])
def test_what_is_no_account_is_left_out(wrong: Any) -> None:
    """Facts of a foreign file are only told."""
    assert RenderingRecord.parse({"brightened": wrong}).brightened == ()


def test_a_keyframed_gloss_survives_a_rebuild(lacquer: Any) -> None:
    gloss_of(lacquer).keyframe_insert("default_value", frame=1)
    rebuild_brdf(lacquer, Choices(mode="preview"))
    curves = curves_of(lacquer.node_tree.animation_data.action)
    number = list(measured_nodes(lacquer.node_tree)[0][1].inputs).index(gloss_of(lacquer))
    assert [curve.data_path for curve in curves] == [f'nodes["Group"].inputs[{number}].default_value']
