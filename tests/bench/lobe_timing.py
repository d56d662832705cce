"""Time of a cosine lobe in rendered nodes and in OSL: a plane that emits the sum of many."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import bpy
from measured_materials.addon.studio import render_linear, set_unbiased
from measured_materials.bake.cosine_lobes import cosine_lobe
from measured_materials.bake.errors import BakeError
from measured_materials.nodes import compat, expr
from measured_materials.nodes.osl_script import output, script_node, use_osl, with_headers

EVALUATIONS = 24  # for a shading point
_OSL = """
#include "measured_lobes.h"
shader lobes(string Lobe = "", float X = 0, float Exponent = 1, output float Sum = 0)
{
  for (int k = 0; k < 24; ++k) {
    float at = X * (0.01 + 0.005 * k);
    Sum += Lobe == "none" ? at : mm_cosine_lobe(Lobe, at, Exponent);
  }
}
"""


def measure_rendered(lobes: Sequence[str], quick: bool) -> dict[str, dict[str, float]]:
    """Column to lobe to ns of processor per evaluation beyond a sum of the arguments themselves."""
    kinds: dict[str, tuple[Callable[..., Any], bool, bool]] = {
        "nodes, one n": (_nodes, False, False),
        "nodes, n varies": (_nodes, False, True),
        "OSL, n varies": (_osl, True, True),
    }
    size, samples = (96, 8) if quick else (240, 16)
    result = {}
    for label, (build, osl, varies) in kinds.items():
        try:
            scenes = {name: _scene(build, name, osl, varies, size, samples) for name in ("none", *lobes)}
        except BakeError as error:
            print(f"{label}: {error}")
            continue
        seconds: dict[str, list[float]] = {name: [] for name in scenes}
        # Interleaved, so that whatever else the machine does meets all alike; the first round warms up.
        for _ in range(3 if quick else 6):
            for name, scene in scenes.items():
                started = time.process_time()  # of all threads
                render_linear(scene)
                seconds[name].append(time.process_time() - started)
        count = size * size * samples * EVALUATIONS
        least = {name: min(times[1:]) for name, times in seconds.items()}
        result[label] = {name: (least[name] - least["none"]) / count * 1e9 for name in lobes}
        for scene in scenes.values():
            bpy.data.scenes.remove(scene)
    return result


def _nodes(name: str, x: Any, n: Any) -> Any:
    total = x
    for k in range(EVALUATIONS):
        at = x * (0.01 + 0.005 * k)
        total = total + (at if name == "none" else cosine_lobe(expr, name, at, n))
    return total


def _osl(name: str, x: Any, n: Any) -> Any:
    source = with_headers("lobes.osl", _OSL)
    return output(script_node("lobes.osl", source, {"Lobe": name, "X": x, "Exponent": n}), "Sum")


def _scene(build: Callable[..., Any], name: str, osl: bool, varies: bool, size: int, samples: int) -> bpy.types.Scene:
    scene = bpy.data.scenes.new("lobes")
    mesh = bpy.data.meshes.new("lobes")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    camera = bpy.data.objects.new("lobes", bpy.data.cameras.new("lobes"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 1.0, (0.5, 0.5, 1)
    for obj in (bpy.data.objects.new("lobes", mesh), camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    material = compat.new_material("lobes")
    mesh.materials.append(material)
    tree = material.node_tree
    with expr.building(tree):
        place = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Position"])
        x, y, _ = expr.components(place)
        emission = expr.node("ShaderNodeEmission", {}, {"Strength": build(name, x, y * 100 + 1 if varies else 60.0)})
        tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    scene.render.resolution_x = scene.render.resolution_y = size
    set_unbiased(scene, samples=samples, seed=0)
    if osl:
        use_osl(scene)
    return scene
