"""What a swatch of the gantry is, as a photometric stereo should find it: normals, height and albedo of its geometry.

Each is rendered as light that the surface emits, through the same camera and pixels as a photograph, and is a texel's
mean over what the camera sees of it.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...nodes import compat
from .scene import Gantry

# Rings of lights, as people place them: elevation in degrees, and how many.
DOME = ((25.0, 8), (50.0, 8), (75.0, 4))
# Emission is to stay above 0 where heights and normals do not.
_OFFSET = 2.0


@dataclass(frozen=True, eq=False)
class Truth:
    """Of one tile, from straight above, row 0 on top.

    normals : (H, W, 3) unit, x right, y up: of the mean over the texel
    height : (H, W) in tiles
    albedo : (H, W, 3), linear Rec.709, of the diffuse closure
    """

    normals: NDArray[np.float64]
    height: NDArray[np.float64]
    albedo: NDArray[np.float64]


def truth_of(gantry: Gantry) -> Truth:
    """Render it; view and light of the gantry are then others."""
    gantry.set_view(0, 0)
    gantry.set_light(0, 0)
    normals = _emitted(gantry, "ShaderNodeNewGeometry", "Normal")
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    height = _emitted(gantry, "ShaderNodeNewGeometry", "Position")[..., 2]
    albedo = _emitted(gantry, "ShaderNodeAttribute", "Color") * _diffuse_share(gantry)
    return Truth(normals / np.maximum(length, 1e-9), height / gantry.tile, albedo)


def photographed_around(
    gantry: Gantry,
    dome: Sequence[tuple[float, int]] = DOME,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Photographs (n, H, W, 3) in 1/sr from straight above under rings of lights, and the directions (n, 3)."""
    angles = [
        (math.radians(90 - elevation), 2 * math.pi * (k + 0.37 * ring) / count)
        for ring, (elevation, count) in enumerate(dome)
        for k in range(count)
    ]
    gantry.set_view(0, 0)
    images = []
    for k, (theta, phi) in enumerate(angles):
        gantry.set_light(theta, phi)
        images.append(gantry.render())
        progress((k + 1) / len(angles))
    ways = [(math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t)) for t, p in angles]
    return np.stack(images), np.array(ways)


def _emitted(gantry: Gantry, kind: str, output: str) -> NDArray[np.float64]:
    """A vector of the surface in every pixel."""
    with _override(gantry, kind, output):
        return gantry.render().astype(np.float64) - _OFFSET


@contextlib.contextmanager
def _override(gantry: Gantry, kind: str, output: str) -> Iterator[None]:
    """All surfaces emit this output of a node, raised by `_OFFSET`."""
    material = compat.new_material("Gantry truth")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    source, raised, emission, target = (
        nodes.new(name) for name in (kind, "ShaderNodeVectorMath", "ShaderNodeEmission", "ShaderNodeOutputMaterial")
    )
    if kind == "ShaderNodeAttribute":
        source.attribute_name = "Col"
    raised.inputs[1].default_value = (_OFFSET,) * 3
    links.new(source.outputs[output], raised.inputs[0])
    links.new(raised.outputs[0], emission.inputs["Color"])
    links.new(emission.outputs[0], target.inputs["Surface"])
    with all_of(gantry, material):
        yield


@contextlib.contextmanager
def all_of(gantry: Gantry, material: bpy.types.Material) -> Iterator[None]:
    """All surfaces have this material, which is removed afterwards."""
    layer = gantry.scene.view_layers[0]
    layer.material_override = material
    try:
        yield
    finally:
        layer.material_override = None
        bpy.data.materials.remove(material)


def _diffuse_share(gantry: Gantry) -> float:
    """What the swatch's own material mixes in of its diffuse closure."""
    material: Any = next(slot.material for obj in gantry.tile_objects for slot in obj.material_slots if slot.material)
    share = 1.0
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeMixShader":
            share *= 1 - node.inputs[0].default_value
    return share
