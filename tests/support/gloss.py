"""A BRDF and a sampler under another gloss, in numpy: what a material under that gloss has to show."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from measured_materials.bake import xp_numpy
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.samplers import Sampler
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.envelope.anisotropic_lobes import AnisotropicLobe
from measured_materials.bake.envelope.closures import closure_sum
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.gloss import stretched
from measured_materials.bake.source import Array

from .direct_light import Brdf


class Glossier:
    """f_g of a source f: f_g cos(theta_i) = f(wi') cos(theta_i') J."""

    def __init__(self, source: Any, gloss: float) -> None:
        self.source, self.gloss = source, gloss
        self.isotropic = self.bilateral = True

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr of unit directions (..., 3) that broadcast; 0 for wi on and below the horizon."""
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        before, spread = stretched(xp_numpy, wi, wo, self.gloss)
        value = np.zeros(wi.shape)
        above = (wi[..., 2] > 0) & (before[..., 2] > 0)
        factor = (spread * before[..., 2])[above] / wi[..., 2][above]
        value[above] = self.source.evaluate(before[above], wo[above]) * factor[:, None]
        return value


class CarriedSampler:
    """A sampler whose directions a gloss carries along; its density is 0 where none of them comes from."""

    def __init__(self, sampler: Sampler, gloss: float) -> None:
        self.sampler, self.gloss = sampler, gloss

    def sample(self, wo: Array, random: Array) -> Array:
        """Directions (n, 3)."""
        drawn, _ = self.sampler.sample(wo, random)
        return stretched(xp_numpy, drawn, wo, 1 / self.gloss)[0]

    def pdf(self, wi: Array, wo: Array) -> Array:
        """Density per solid angle, (n,)."""
        before, spread = stretched(xp_numpy, wi, wo, self.gloss)
        return self.sampler.pdf(before, wo) * spread


def glossy_lobe(lobe: Any, gloss: float) -> Any:
    """The closure that stands for a native one under a gloss."""
    if lobe.name != "ggx":
        return lobe
    if isinstance(lobe, AnisotropicLobe):
        return replace(lobe, alpha_x=lobe.alpha_x / gloss, alpha_y=lobe.alpha_y / gloss)
    return Lobe("ggx", min(lobe.p1 / gloss, 1.0))


def glossy_brdf(bundle: Bundle, mode: str, gloss: float) -> Brdf:
    """What a mode shows on the first bounce: closures of other widths, and the residual or all the table stretched."""
    record = BrdfRecord.read(bundle)
    if mode == "reference":
        return Glossier(record.load_table(), gloss).evaluate
    fit = record.load_preview() if mode == "preview" else record.load_envelope()
    closures = [glossy_lobe(lobe, gloss) for lobe in fit.closures]

    def native(wi: Array, wo: Array) -> Array:
        wi, wo = np.broadcast_arrays(np.asarray(wi, np.float64), np.asarray(wo, np.float64))
        return closure_sum(closures, fit.weights_at(wo), wi, wo)

    if mode == "preview":
        return native
    rest = Glossier(record.load_table("residual"), gloss)
    return lambda wi, wo: native(wi, wo) + rest.evaluate(wi, wo)


def gloss_socket(material: bpy.types.Material) -> Any:
    """The input of a material's measured group."""
    return next(node.inputs["Gloss"] for node in material.node_tree.nodes if "Gloss" in node.inputs)


def glossy(material: bpy.types.Material, gloss: float) -> bpy.types.Material:
    """The same material, by its Gloss."""
    gloss_socket(material).default_value = gloss
    return material


def link_gloss(material: bpy.types.Material, low: float, high: float, threshold: float = 0.0) -> None:
    """Link Gloss to what is `low` where x of the shaded place is under a threshold, else `high`."""
    link_socket(material, gloss_socket(material), low, high, threshold)


def link_socket(material: bpy.types.Material, socket: Any, low: float, high: float, threshold: float = 0.0) -> None:
    """The same of any input."""
    tree = material.node_tree
    place, parts = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeSeparateXYZ")
    beyond, chosen = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("ShaderNodeMapRange")
    for node in (place, parts, beyond, chosen):
        node.label = "mask of the test"
    beyond.operation, beyond.inputs[1].default_value = "GREATER_THAN", threshold
    chosen.inputs["To Min"].default_value, chosen.inputs["To Max"].default_value = low, high
    tree.links.new(place.outputs["Position"], parts.inputs[0])
    tree.links.new(parts.outputs["X"], beyond.inputs[0])
    tree.links.new(beyond.outputs[0], chosen.inputs["Value"])
    tree.links.new(chosen.outputs["Result"], socket)
