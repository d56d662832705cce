"""Processor time of an expression in a render: a plane that emits the sum of many of it, beside one that does not.

What a render costs apart from shading (the scene, its textures, the picture) falls out, since the same scene is
rendered with few and with many samples; what the arguments cost falls out with the plane that emits only them.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ...nodes import compat, expr
from ...nodes.osl_script import use_osl
from ..rendering.renderer import set_unbiased
from ..studio.studio import render_linear

# From the place on the plane, x and y in [0, 1], to what is emitted: a number or a colour.
Build = Callable[[Any], Any]
# A difference of two renders that is shorter than this is noise.
LEAST_NS = 0.1


@dataclass(frozen=True)
class Effort:
    """Pixels along an edge, samples, and how often each plane is rendered; the least time counts."""

    size: int = 96
    samples: int = 16
    rounds: int = 3


def evaluation_ns(
    builds: Mapping[str, Build],
    arguments: Build,
    evaluations: int,
    effort: Effort,
    *,
    osl: bool = False,
    progress: Callable[[float], None] | None = None,
) -> dict[str, float]:
    """Nanoseconds of processor, summed over threads, of one evaluation of each expression.

    Parameters
    ----------
    builds : by name; each emits `evaluations` of its expression at a shading point
    arguments : emits what those are evaluated of
    osl : render with Open Shading Language
    progress : called with the share done

    Raises
    ------
    BakeError : an expression needs OSL, and this Blender has none
    """
    planes = {"": arguments, **builds}
    # Of few and of many samples apart: the least difference of pairs would be that of the most disturbed first half.
    least: dict[tuple[str, int], float] = {}
    with contextlib.ExitStack() as stack:
        scenes = {name: stack.enter_context(_plane(build, effort.size, osl)) for name, build in planes.items()}
        for done in range(effort.rounds):
            # Interleaved, so that whatever else the machine does meets all alike.
            for k, (name, scene) in enumerate(scenes.items()):
                if progress:
                    progress((done + k / len(scenes)) / effort.rounds)
                for samples in (1, 1 + effort.samples):
                    spent = _spent(scene, samples)
                    least[name, samples] = min(spent, least.get((name, samples), spent))
    seconds = {name: least[name, 1 + effort.samples] - least[name, 1] for name in planes}
    count = effort.size**2 * effort.samples * evaluations
    return {name: max((seconds[name] - seconds[""]) / count * 1e9, LEAST_NS) for name in builds}


def _spent(scene: bpy.types.Scene, samples: int) -> float:
    scene.cycles.samples = samples
    started = time.process_time()  # of all threads
    render_linear(scene)
    return time.process_time() - started


@contextlib.contextmanager
def _plane(build: Build, size: int, osl: bool) -> Iterator[bpy.types.Scene]:
    """The plane [0, 1]^2 seen from above, everything about it gone afterwards."""
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("Timing")
    mesh = bpy.data.meshes.new("Timing")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    camera = bpy.data.cameras.new("Timing")
    camera.type, camera.ortho_scale = "ORTHO", 1.0
    plane, view = bpy.data.objects.new("Timing", mesh), bpy.data.objects.new("Timing camera", camera)
    view.location = (0.5, 0.5, 1)
    material = compat.new_material("Timing")
    try:
        mesh.materials.append(material)
        for obj in (plane, view):
            scene.collection.objects.link(obj)
        scene.camera = view
        _emit(material, build)
        scene.render.resolution_x = scene.render.resolution_y = size
        scene.render.use_persistent_data = True  # the second render of a pair finds its textures loaded
        set_unbiased(scene, samples=1, seed=0)
        if osl:
            use_osl(scene)
        yield scene
    finally:
        # Only this frees the renderer with its textures, which would outlive the scene.
        scene.render.use_persistent_data = False
        bpy.data.scenes.remove(scene)
        bpy.data.batch_remove([plane, view, mesh, camera, material])


def _emit(material: bpy.types.Material, build: Build) -> None:
    tree = material.node_tree
    with expr.building(tree):
        emitted = build(expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Position"]))
        socket = "Color" if isinstance(emitted, expr.Vector) else "Strength"
        emission = expr.node("ShaderNodeEmission", {}, {socket: emitted})
        tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
