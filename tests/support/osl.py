"""Render cards of OSL: shaders of `nodes/osl`, or a few lines that call what their headers hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.bake.errors import BakeError
from measured_materials.bake.tables.grids.grid import Grid
from measured_materials.nodes.group import active_output, trees_below
from measured_materials.nodes.material_tree import measured_nodes
from measured_materials.nodes.osl_parameters import grid_constants
from measured_materials.nodes.osl_script import (
    is_one_script,
    output,
    require_osl,
    script_node,
    shader_source,
    use_osl,
    with_headers,
)

from .cards import card
from .scenes import lit_sphere


def osl_grid(grid: Grid) -> str:
    """A grid of either kind as the initialiser of an `MMGrid`."""
    c = {"ShapeSlice": (0.0, 0.0, 0.0), **grid_constants(grid)}
    sizes = ", ".join(str(c[key]) for key in ("Azimuths", "Slices", "SliceRows", "SliceColumns"))
    shapes = ", ".join(
        f"vector({', '.join(f'{x:.9g}' for x in c.get(k, (0, 0, 0)))})" for k in ("ShapeSlice", "ShapeRow", "ShapePhi")
    )
    return f'{{"{c["Basis"]}", "{c["Parameterization"]}", {sizes}, {shapes}, {c["Reciprocal"]}, {c["Folded"]}}}'


def declared_table(grid: Grid, file: Path, filter: str, log: str = "vector(0), vector(0)") -> str:
    """Statements that declare `table` and its grid `g`; `log` are the range and gain of codes."""
    c = grid_constants(grid)
    return f"""MMGrid g = {osl_grid(grid)};
      MMTable table = {{"{file}", 1, 0, {log}, {c["Columns"]}, {c["Rows"]}, "{filter}", 0, 1}};"""


def skip_without_osl() -> None:
    """Skip the test, visibly, in a Blender that cannot compile OSL."""
    try:
        require_osl()
    except BakeError as error:
        pytest.skip(str(error))


def shader_card(
    name: str, outputs: Sequence[str], constants: Mapping[str, Any], **inputs: np.ndarray
) -> list[np.ndarray]:
    """Outputs of a shader of `nodes/osl` for inputs (P,) or (P, 3) by the names of its parameters."""
    return _card(name, shader_source(name), outputs, constants, inputs)


def header_card(
    body: str, outputs: Mapping[str, str], header: str = "measured_materials.h", **inputs: np.ndarray
) -> list[np.ndarray]:
    """Outputs, name to OSL type, of statements that may use a header and the inputs, (P,) or (P, 3), by name."""
    parameters = [f"{_kind(values)} {name} = 0" for name, values in inputs.items()]
    parameters += [f"output {kind} {name} = 0" for name, kind in outputs.items()]
    source = f'#include "{header}"\nshader card({", ".join(parameters)})\n{{\n{body}\n}}\n'
    return _card("card.osl", with_headers("card.osl", source), list(outputs), {}, inputs)


def _kind(values: np.ndarray) -> str:
    return "vector" if values.ndim == 2 else "float"


def _card(
    name: str, source: str, outputs: Sequence[str], constants: Mapping[str, Any], inputs: Mapping[str, np.ndarray]
) -> list[np.ndarray]:
    def function(*values: Any) -> tuple[Any, ...]:
        node = script_node(name, source, {**constants, **dict(zip(inputs, values, strict=True))})
        return tuple(output(node, o) for o in outputs)

    return card(function, *inputs.values(), osl=True)


def assert_shows_nodes_in_eevee(material: bpy.types.Material, closures: list[str]) -> None:
    """That the viewport's output shows the measured group by these closures of Blender's own."""
    surface = material.node_tree.get_output_node("EEVEE").inputs["Surface"]
    assert surface.is_linked and surface.links[0].from_socket.name == "EEVEE"
    group = surface.links[0].from_node.node_tree
    shown = active_output(group).inputs["EEVEE"].links[0].from_node
    assert is_one_script(material) and _closures_below(shown.node_tree) == closures


def closures_of_group(material: bpy.types.Material) -> list[str]:
    """Kinds of Blender's closures in a material's measured group, each as often as it is there."""
    (node,) = (node for _, node in measured_nodes(material.node_tree))
    return _closures_below(node.node_tree)


def _closures_below(tree: bpy.types.NodeTree) -> list[str]:
    nodes = (node for inner in trees_below(tree) for node in inner.nodes)
    return sorted(node.bl_idname for node in nodes if node.bl_idname.startswith("ShaderNodeBsdf"))


def assert_preview_on_the_ground(
    exact: bpy.types.Material, balanced: bpy.types.Material, preview: bpy.types.Material
) -> None:
    """On matte ground mode Balanced shows Preview's light, bit for bit, and not Exact's: it has bounced there."""
    with lit_sphere(preview, lamp=False, resolution=32) as scene:
        use_osl(scene.scene)
        outside = ~np.pad(scene.mask()[1:-1, 1:-1], 1) & (np.arange(32) > 20)[:, None]
        scene.sphere.visible_camera = False
        ground = scene.render(4, 1)[:, outside]
        scene.show(balanced)
        assert (scene.render(4, 1)[:, outside] == ground).all()
        scene.show(exact)
        assert (scene.render(4, 1)[:, outside] != ground).any()
