"""What a denoiser needs to know of a measured material: its albedo and its normal, as passes free of noise.

Cycles writes its own denoising passes at the first surface that is not a mirror. Where a sample of a measured material
is a stochastic mirror, they hence show what that mirror happened to meet: another surface's normal, or none, and the
very light of lamp and sky for an albedo. Here the material writes both as shader AOVs, for the surface that the camera
sees, and the compositor lays them over Cycles' passes, which stay right for everything else. A colour AOV's alpha is
the share of the pixel that wrote it. Closures and random numbers are as before, so the picture is the same bit by bit.
"""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bake.brdf.record import BrdfRecord
from ..bake.errors import BakeError
from ..bake.shading_maps.record import Record
from . import expr
from .adjustments import LIMITS, NEUTRAL, Adjustments
from .group import call, node_group
from .through_closure import seen_from_behind

ALBEDO, NORMAL = "MM Albedo", "MM Normal"
# Of the polynomial in the chord: within 0.03 of the albedo of every analytic model up to 87 degrees, 0.09 if quadratic.
DEGREE = 4
_KEY = "measured_materials_denoise"  # custom property of the compositor's nodes
_SHADER_KINDS = {"NodeSocketShader": "shader", "NodeSocketFloat": "float", "NodeSocketColor": "color"}


def albedo_polynomial(record: Record) -> NDArray[np.float64]:
    """Directional albedo of a bundle as a polynomial in the chord sqrt(1 - cos theta_o).

    A sheet's is what it reflects and lets through together, as Cycles counts its own closures.

    Returns
    -------
    (sides, DEGREE + 1, 3), the highest power first; its values are to be clamped to [0, 1]. There are two sides, front
    and back, where a sheet's differ; else one

    Raises
    ------
    BakeError : the albedo is known at too few angles
    """
    degrees = np.array(record.albedo.theta_o_deg, np.float64)
    if len(degrees) <= DEGREE:
        raise BakeError(record.where, f"'albedo' is known at {len(degrees)} angles only", "bake it again")
    powers = np.vander(np.sqrt(1 - np.cos(np.radians(degrees))), DEGREE + 1)
    return np.stack([np.linalg.lstsq(powers, rows, rcond=None)[0] for rows in _albedos(record)])


def _albedos(record: Record) -> list[NDArray[np.float64]]:
    """Directional albedos (angles, 3) of the sides that differ."""
    front = np.array(record.albedo.directional, np.float64)
    sheet = record.sheet if isinstance(record, BrdfRecord) else None
    if sheet is None:
        return [np.clip(front, 0, 1)]
    seen = {name: np.array(part.albedo.directional, np.float64) for name, part in sheet.parts.items()}
    none = np.zeros_like(front)
    sides = [front + seen.get("through", none)]
    if not sheet.alike:
        sides.append(seen.get("behind", none) + seen.get("through_behind", none))
    return [np.clip(side, 0, 1) for side in sides]


def with_feature_outputs(group: bpy.types.ShaderNodeTree, albedo: NDArray[np.float64]) -> bpy.types.ShaderNodeTree:
    """A measured material's group that also writes the passes, of the same inputs and outputs.

    Where a view layer has no such passes Cycles leaves the nodes out, and else runs them where the camera sees the
    surface only. A group that writes them already is returned as it is.

    Parameters
    ----------
    group : with the inputs "Normal", world, and those of `Adjustments`
    albedo : `albedo_polynomial`
    """
    if any(node.bl_idname == "ShaderNodeOutputAOV" for node in group.nodes):
        return group
    sockets: dict[str, dict[str, str]] = {"INPUT": {}, "OUTPUT": {}}
    for item in group.interface.items_tree:
        if item.item_type == "SOCKET":
            sockets[item.in_out][item.name] = _SHADER_KINDS.get(item.socket_type, "vector")

    def build(*arguments: Any) -> Any:
        named = dict(zip(sockets["INPUT"], arguments, strict=True))
        normal = named["Normal"]
        seen = [_directional_albedo(normal, side) for side in albedo]
        shown = seen[0] if len(seen) < 2 else expr.where(seen_from_behind(), seen[1], seen[0])
        write_features(normal, Adjustments.among(named).apply(shown))
        return call(group, *arguments)

    return node_group(f"{group.name} + passes", sockets["INPUT"], sockets["OUTPUT"], build, NEUTRAL, limits=LIMITS)


def _directional_albedo(normal: Any, albedo: NDArray[np.float64]) -> Any:
    """Value of the polynomial for this viewer, in [0, 1]."""
    incoming = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Incoming"])
    chord = expr.minimum(expr.length(normal - incoming) * (1 / math.sqrt(2)), 1.0)
    value = expr.vec(*map(float, albedo[0]))
    for coefficient in albedo[1:]:
        value = expr.scale(value, chord) + expr.vec(*map(float, coefficient))
    return clamped(value)


def clamped(colour: Any) -> Any:
    """A colour with each channel in [0, 1]."""
    colour = expr.vector_node("MAXIMUM", colour, expr.vec(0.0, 0.0, 0.0))
    return expr.vector_node("MINIMUM", colour, expr.vec(1.0, 1.0, 1.0))


def write_features(normal: Any, albedo: Any) -> None:
    """Write both passes, in the tree under construction.

    Parameters
    ----------
    normal : world space
    albedo : colour
    """
    # As Cycles' own pass: relative to the camera.
    settings = {"vector_type": "NORMAL", "convert_from": "WORLD", "convert_to": "CAMERA"}
    seen = expr.Vector(expr.node("ShaderNodeVectorTransform", settings, {0: normal}).outputs[0])
    expr.node("ShaderNodeOutputAOV", {"aov_name": ALBEDO}, {"Color": albedo})
    expr.node("ShaderNodeOutputAOV", {"aov_name": NORMAL}, {"Color": seen})


# --- scene ----------------------------------------------------------------------------------------------


def asks_for_passes(scene: bpy.types.Scene) -> bool:
    """Whether a view layer holds what measured materials write for the denoiser."""
    return any(ALBEDO in layer.aovs for layer in scene.view_layers)


def store_feature_passes(layer: bpy.types.ViewLayer) -> None:
    """Let a view layer hold the passes of measured materials, and Cycles' own for everything else."""
    layer.cycles.denoising_store_passes = True
    for name in (ALBEDO, NORMAL):
        if name not in layer.aovs:
            made = layer.aovs.add()
            made.name, made.type = name, "COLOR"


def drop_feature_passes(layer: bpy.types.ViewLayer) -> None:
    """Take the passes of measured materials from a view layer; Cycles' own may serve others."""
    for aov in [aov for aov in layer.aovs if aov.name in (ALBEDO, NORMAL)]:
        layer.aovs.remove(aov)


def denoise_by_features(
    scene: bpy.types.Scene, layer: bpy.types.ViewLayer | None = None, *, prefilter: str = "ACCURATE"
) -> bpy.types.NodeTree:
    """Denoise the scene's renders in its compositor, by the passes of the measured materials where they are seen.

    Cycles' own denoising is switched off: it knows its own passes only. What the compositor did with the layer's
    picture it does with the denoised one; an empty compositor gets it as its output. Called again, it replaces itself.

    Parameters
    ----------
    layer : by default the scene's first
    prefilter : of albedo and normal, "NONE", "FAST" or "ACCURATE"; these passes need none, those of other materials may

    Returns
    -------
    The compositor's tree.
    """
    layer = layer or scene.view_layers[0]
    stop_denoising(scene)
    store_feature_passes(layer)
    scene.cycles.use_denoising = False
    scene.render.use_compositing = True
    tree = compositor_of(scene)
    source = _source(tree, scene, layer)
    readers = [link.to_socket for link in source.outputs["Image"].links]
    denoise = _own(tree, "CompositorNodeDenoise", (0, 300))
    if "Prefilter" in denoise.inputs:
        denoise.inputs["Prefilter"].default_value = prefilter.capitalize()
    else:
        denoise.prefilter = prefilter
    tree.links.new(source.outputs["Image"], denoise.inputs["Image"])
    for kind, feature in zip(("Albedo", "Normal"), _laid_over(tree, source), strict=True):
        tree.links.new(feature, denoise.inputs[kind])
    for socket in readers or [compositor_output(tree)]:
        tree.links.new(denoise.outputs[0], socket)
    return tree


def shown_features(scene: bpy.types.Scene) -> tuple[Any, Any]:
    """Albedo and normal as outputs in the scene's compositor, which is made to hold them; see `stop_denoising`."""
    layer = scene.view_layers[0]
    store_feature_passes(layer)
    scene.render.use_compositing = True
    tree = compositor_of(scene)
    return _laid_over(tree, _source(tree, scene, layer))


def _laid_over(tree: bpy.types.NodeTree, source: bpy.types.Node) -> tuple[Any, Any]:
    """Albedo and normal: the materials' passes over Cycles' own."""
    made = []
    for k, (ours, kind) in enumerate(((ALBEDO, "Albedo"), (NORMAL, "Normal"))):
        over = _own(tree, "CompositorNodeAlphaOver", (-250, 60 - 240 * k))
        under_at, over_at = (0, 1) if over.inputs[0].name == "Background" else (1, 2)
        tree.links.new(source.outputs[f"Denoising {kind}"], over.inputs[under_at])
        tree.links.new(source.outputs[ours], over.inputs[over_at])
        made.append(over.outputs[0])
    return made[0], made[1]


def _source(tree: bpy.types.NodeTree, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bpy.types.Node:
    """The node of the layer's passes, made where there is none."""
    source = next((n for n in tree.nodes if _is_source(n, scene, layer)), None)
    if source is None:
        source = tree.nodes.new("CompositorNodeRLayers")
        source.scene, source.layer, source.location = scene, layer.name, (-600, 300)
    return source


def stop_denoising(scene: bpy.types.Scene) -> None:
    """Take away what `denoise_by_features` put into the compositor; the passes stay."""
    tree = getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)
    if tree is None:
        return
    own = [node for node in tree.nodes if node.get(_KEY)]
    for node in own:
        if node.bl_idname == "CompositorNodeDenoise" and node.inputs["Image"].is_linked:
            noisy = node.inputs["Image"].links[0].from_socket
            for socket in [link.to_socket for link in node.outputs[0].links]:
                tree.links.new(noisy, socket)
    for node in own:
        tree.nodes.remove(node)


def compositor_of(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    """The scene's compositor, made where there is none; from 5.0 it is a node group."""
    if hasattr(scene, "compositing_node_group"):
        if scene.compositing_node_group is None:
            scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        return scene.compositing_node_group
    fresh = scene.node_tree is None
    if not scene.use_nodes:
        scene.use_nodes = True
    if fresh:
        scene.node_tree.nodes.clear()  # the usual ones, which may be of the scene in the window
    return scene.node_tree


def compositor_output(tree: bpy.types.NodeTree) -> Any:
    """Input of the tree's output node, made where there is none."""
    if not hasattr(bpy.types, "CompositorNodeComposite"):
        if not any(item.in_out == "OUTPUT" for item in tree.interface.items_tree if item.item_type == "SOCKET"):
            tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        kind = "NodeGroupOutput"
    else:
        kind = "CompositorNodeComposite"
    found = next((node for node in tree.nodes if node.bl_idname == kind), None) or tree.nodes.new(kind)
    found.location = (300, 300)
    return found.inputs[0]


def _is_source(node: Any, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bool:
    return node.bl_idname == "CompositorNodeRLayers" and node.scene == scene and node.layer == layer.name


def _own(tree: bpy.types.NodeTree, kind: str, location: tuple[int, int]) -> Any:
    made = tree.nodes.new(kind)
    made[_KEY], made.location = True, location
    return made
