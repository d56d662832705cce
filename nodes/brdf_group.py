"""Node group: a tabulated BRDF in the mode chosen (addon/docs/method.md, section 9)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy

from . import expr
from .adjustments import GLOSS, LIMITS, NEUTRAL, SOCKETS, Adjustments
from .exact_closure import exact_closure, reference_closure
from .gloss_group import held_gloss
from .group import node_group
from .lamp_light_groups import LightTables
from .lamp_share_group import LampShares
from .native_closure import choose_closure
from .sampled_closure import sampled_closure
from .surface_marker import mean_roughness, with_marker
from .table_groups import TableGroups
from .weighted_closures import WeightedClosures
from .world_picture import Surroundings


@dataclass(frozen=True)
class BrdfParts:
    """Parts that a material is built of; None for what its mode does not use or its bundle does not hold.

    Parameters
    ----------
    table : groups of the whole BRDF, or of the residual where there is an envelope
    envelope : native closures under the BRDF; without a table they are all there is
    preview : native closures close to it
    lamps : table of lamps to aim at
    shares : of a lamp's light that is the residual's, for its probability
    lights : what these lamps emit, where the shader is to sample them
    around : the world's picture, where it is to be sampled too
    anisotropic : the parts lie in the frame of a tangent, which the group then takes
    normals : a view layer shows the Normal pass, which mirrors would spoil
    scripted : a script of OSL asks what rays meet, in place of Cycles' Raycast node
    """

    table: TableGroups | None = None
    envelope: WeightedClosures | None = None
    preview: WeightedClosures | None = None
    lamps: bpy.types.Image | None = None
    shares: LampShares | None = None
    lights: bpy.types.Image | None = None
    around: Surroundings | None = None
    anisotropic: bool = False
    normals: bool = False
    scripted: bool = False

    def placed(self, gloss: Any, tangent: Any = None) -> BrdfParts:
        """The same parts under a gloss, and in the frame of this tangent, in world space."""
        return replace(
            self,
            table=None if self.table is None else replace(self.table, gloss=gloss, tangent=tangent),
            envelope=None if self.envelope is None else replace(self.envelope, gloss=gloss, tangent=tangent),
            preview=None if self.preview is None else replace(self.preview, gloss=gloss, tangent=tangent),
        )

    def traced(self, normal: Any, adjustments: Adjustments) -> Any:
        """Closure that is as good as the table."""
        if self.envelope is None:
            assert self.table is not None
            return reference_closure(self.table, normal, adjustments, self.lamps)
        if self.table is None:
            return self.envelope.alone(normal, adjustments)
        if self.lamps is not None and self.lights is not None:
            tables = LightTables(self.lamps, self.lights, self.around, self.scripted)
            return sampled_closure(self.envelope, self.table, normal, adjustments, tables)
        return exact_closure(self.envelope, self.table, normal, adjustments, self.lamps, self.shares)


def brdf_group(name: str, mode: str, parts: BrdfParts) -> bpy.types.ShaderNodeTree:
    """The inputs of `brdf_inputs` to a shader, and to one for EEVEE where there is a preview."""
    inputs = brdf_inputs(parts.anisotropic)

    def build(*values: Any) -> Any:
        named = dict(zip(inputs, values, strict=True))
        normal, adjustments = named["Normal"], Adjustments.among(named)
        placed = parts.placed(held_gloss(named[GLOSS]), named.get("Tangent"))
        preview = None if placed.preview is None else placed.preview.alone(normal, adjustments)
        if mode == "preview":
            return preview, preview
        traced = placed.traced(normal, adjustments)
        if mode == "balanced":
            traced = choose_closure(after_diffuse(), traced, preview)
        if placed.table is not None:
            roughness = mean_roughness(placed.preview or placed.envelope)
            traced = with_marker(traced, normal, roughness, always=placed.normals)
        return traced if preview is None else (traced, preview)

    outputs = {"BSDF": "shader"} | ({} if parts.preview is None else {"EEVEE": "shader"})
    return node_group(name, inputs, outputs, build, NEUTRAL, limits=LIMITS)


def brdf_inputs(anisotropic: bool) -> dict[str, str]:
    """Inputs of a measured BRDF's group and their kinds."""
    return {"Normal": "vector", **SOCKETS, GLOSS: "float"} | ({"Tangent": "vector"} if anisotropic else {})


def after_diffuse() -> Any:
    """1 where the path has met a diffuse surface, else 0: Cycles then skips the nodes of the closure not chosen."""
    return expr.Scalar(expr.node("ShaderNodeLightPath", {}, {}).outputs["Diffuse Depth"]) > 0.5
