"""What exporters see of a measured material: a Principled BSDF of its colour and gloss, under an output of its own.

glTF's exporter takes the first Principled BSDF, of the material's own tree before those of groups, that leads to the
active output; USD's takes the first Principled or Diffuse BSDF of the material's own tree, linked or not, and writes an
empty material where there is none. A measured material keeps its closures in a group, where there is none or only the
surface's marker, whose colour is computed: both wrote white. This one stands under an output for all engines, which
neither Cycles nor EEVEE looks at beside outputs of their own; `addon.exports.gltf` makes it the active one for as long
as glTF is written.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ..bake.brdf.common import Colour
from ..bake.brdf.record import BrdfRecord
from ..bake.directions import spherical
from ..bake.envelope.fitted import ClosureFit
from ..bake.errors import BakeError
from ..bake.lobes.lobes import PHONG
from ..bake.shading_maps.record import ShadingMapRecord
from ..bake.source import luminance
from .native_closure import highlight_roughness
from .surface_marker import MATTE, roughness_of

# On nodes made here, with what was last written: what an artist has set stays.
_KEY = "measured_materials_exported"
# Elevation of the viewer that gloss is weighed for, from the normal.
_VIEWER = np.radians(30)


@dataclass(frozen=True)
class Look:
    """A Principled BSDF that reflects as much: `metallic` is the share of its light that has a highlight."""

    colour: Colour
    metallic: float = 0.0
    roughness: float = MATTE

    def inputs(self) -> dict[str, Any]:
        """Values of the node's sockets. All light is in the base colour: nothing is added on top."""
        return {
            "Base Color": (*self.colour, 1.0),
            "Metallic": self.metallic,
            "Roughness": self.roughness,
            "Specular IOR Level": 0.0,
        }


def look_of(record: BrdfRecord | ShadingMapRecord) -> Look:
    """How a material looks to programs that know no measured one; matte where its closures are not to be read."""
    colour = record.albedo.under_sky
    if isinstance(record, ShadingMapRecord):
        lobe = record.render.lobe
        rough = None if lobe is None else roughness_of(lobe)
        if lobe is None or rough is None:
            return Look(colour)
        return Look(colour, 1 - lobe.native_share if lobe.name in PHONG else float(lobe.name == "ggx"), rough)
    with contextlib.suppress(BakeError):
        if record.has("preview_weights"):
            return _glossy(colour, record.load_preview())
    return Look(colour)


def _glossy(colour: Colour, fit: ClosureFit) -> Look:
    weights = luminance(fit.weights_at(spherical(_VIEWER, np.array(0.0))))
    rough = [_roughness(closure) for closure in fit.closures]
    shiny = [(float(w), r) for w, r in zip(weights, rough, strict=True) if r is not None and w > 0]
    gloss, total = sum(w for w, _ in shiny), float(weights.sum())
    if gloss <= 0:
        return Look(colour)
    return Look(colour, min(gloss / total, 1.0), min(sum(w * r for w, r in shiny) / gloss, 1.0))


def _roughness(closure: Any) -> float | None:
    if closure.name in PHONG:
        return highlight_roughness(closure)
    return roughness_of(closure) if closure.name == "ggx" else None


def show_to_exporters(tree: bpy.types.NodeTree, look: Look) -> None:
    """Make the node and its output in a material's tree, or bring its values in line where nobody has changed them.

    One that an artist has removed stays so.
    """
    closure = exported_closure(tree)
    if closure is None:
        if not tree.get(_KEY):
            tree[_KEY] = True
            _made(tree, look)
        return
    before = closure[_KEY]
    for name, value in look.inputs().items():
        socket = closure.inputs[name]
        if name in before and not socket.is_linked and np.allclose(_plain(socket), _flat(before[name]), atol=1e-6):
            socket.default_value = value
    closure[_KEY] = look.inputs()


def exported_closure(tree: bpy.types.NodeTree) -> Any:
    """The node that exporters are to see; None where there is none."""
    return _node(tree, "ShaderNodeBsdfPrincipled")


def exported_output(tree: bpy.types.NodeTree) -> Any:
    """Its output."""
    return _node(tree, "ShaderNodeOutputMaterial")


def _node(tree: bpy.types.NodeTree, kind: str) -> Any:
    return next((node for node in tree.nodes if _KEY in node and node.bl_idname == kind), None)


def _made(tree: bpy.types.NodeTree, look: Look) -> None:
    closure, output = tree.nodes.new("ShaderNodeBsdfPrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    closure.label = output.label = "For exports"
    closure.location, output.location = (0, -260), (340, -260)
    closure.hide = True
    for name, value in look.inputs().items():
        closure.inputs[name].default_value = value
    closure[_KEY], output[_KEY] = look.inputs(), True
    output.target = "ALL"
    tree.links.new(closure.outputs[0], output.inputs["Surface"])


def _plain(socket: Any) -> Any:
    return _flat(socket.default_value)


def _flat(value: Any) -> Any:
    return np.atleast_1d(np.array(list(value) if hasattr(value, "__len__") else value, float))
