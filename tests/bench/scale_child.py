"""Many materials in one scene, in a process of its own: what they take, as one line of JSON.

`python scale_child.py JSON`: "side" is "measured", "preview" (BRDFs in that mode) or "principled", "count" of
materials, "bundles" their folders, "edge" of the pictures in pixels. Runs with the package of an older commit too.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import resource
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import measured_materials
from measured_materials.addon.lights import light_tables
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.build_shading_map import build_map
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.rendering.renderer import render_pixels, set_unbiased
from measured_materials.addon.studio.studio_meshes import sphere_mesh
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.nodes import compat
from measured_materials.nodes.shading_map_material import build_shading_map

MOVES, LAMPS, ONE_BY_ONE = 5, 3, 8


def main(side: str, count: int, bundles: list[str], edge: int) -> dict[str, Any]:
    """All figures: processor seconds, but for those of a picture's wall; MB; numbers of datablocks."""
    compat.ensure_cycles()
    if side != "principled":
        measured_materials.register()
    bpy.ops.wm.read_homefile(use_empty=True)
    scene, spheres = _scene(count, edge)
    found: dict[str, Any] = {"megabytes_before": _megabytes()}
    seconds: list[float] = []
    began = time.process_time()
    with _together():
        for k, sphere in enumerate(spheres):
            start = time.process_time()
            sphere.material_slots[0].material = _material(side, bundles, k)
            seconds.append(time.process_time() - start)
    found |= {"build": time.process_time() - began, "new": seconds[: len(bundles)], "again": seconds[len(bundles) :]}
    found["nodes"] = sum(_nodes(sphere.material_slots[0].material.node_tree) for sphere in spheres)
    found |= {"images": len(bpy.data.images), "groups": len(bpy.data.node_groups), "megabytes_built": _megabytes()}
    for samples in (1, 16):
        found[f"wall_{samples}"], found[f"processor_{samples}"] = _rendered(scene, samples, side)
    found["megabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found["moved"], found["added"] = _handled(scene)
    start, extra = time.process_time(), min(ONE_BY_ONE, count)
    for k in range(extra):
        _material(side, bundles, k)
    found["one_by_one"] = (time.process_time() - start) / extra
    if side != "principled":
        measured_materials.unregister()
    return found


def _together() -> Any:
    """As operators build; commits before have no such thing."""
    try:
        together = importlib.import_module("measured_materials.addon.material.together")
    except ImportError:
        return contextlib.nullcontext()
    return together.built_together()


def _nodes(tree: bpy.types.NodeTree) -> int:
    """That Cycles compiles; commits before cannot tell, which gives 0."""
    sys.path.insert(1, str(Path(__file__).resolve().parents[1]))
    try:
        return int(importlib.import_module("support.node_count").count_nodes(tree))
    except ImportError:
        return 0


def _material(side: str, bundles: list[str], k: int) -> bpy.types.Material:
    if side == "principled":
        material = compat.new_material(f"plain {k}")
        tree = material.node_tree
        shader, output = tree.nodes.new("ShaderNodeBsdfPrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
        shader.inputs["Roughness"].default_value = 0.1 + 0.8 * (k % 24) / 24
        tree.links.new(shader.outputs[0], output.inputs["Surface"])
        return material
    bundle = read_bundle(bundles[k % len(bundles)])
    if bundle.material["kind"] != "shading_map":
        return build_brdf(bundle, **({"choices": Choices(mode="preview")} if side == "preview" else {}))[0]
    record = ShadingMapRecord.read(bundle)
    made = build_shading_map(record, lamps=light_tables.lamp_image())
    build_map(record, made, record.render, pack=False)
    return made


def _scene(count: int, edge: int) -> tuple[bpy.types.Scene, list[bpy.types.Object]]:
    """Small spheres in rows above a lamp's cone, under a grey sky."""
    scene, mesh = bpy.context.scene, sphere_mesh(24, 12)
    mesh.materials.append(None)
    row = int(count**0.5) + 1
    spheres = []
    for k in range(count):
        sphere = bpy.data.objects.new("sphere", mesh)
        sphere.location, sphere.scale = (2.2 * (k % row), 2.2 * (k // row), 0), (1, 1, 1)
        scene.collection.objects.link(sphere)
        sphere.material_slots[0].link = "OBJECT"
        spheres.append(sphere)
    middle = 1.1 * (row - 1)
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.4 * row
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.camera.location = (middle, middle, 20)
    scene.collection.objects.link(scene.camera)
    _lamp(scene, (middle, -3, 9))
    scene.world, background = compat.new_world("grey")
    background.inputs["Strength"].default_value = 0.3
    scene.render.resolution_x = scene.render.resolution_y = edge
    set_unbiased(scene, 1, 0)
    scene.view_layers[0].update()
    return scene, spheres


def _lamp(scene: bpy.types.Scene, place: tuple[float, float, float]) -> bpy.types.Object:
    data = bpy.data.lights.new("lamp", "AREA")
    data.energy, data.size = 2000, 1.0
    made = bpy.data.objects.new("lamp", data)
    made.location = place
    scene.collection.objects.link(made)
    return made


def _rendered(scene: bpy.types.Scene, samples: int, side: str) -> tuple[float, float]:
    """Wall and processor seconds of a picture, from nothing."""
    scene.cycles.samples = samples
    wall, processor = time.perf_counter(), time.process_time()
    if side != "principled":
        light_tables.keep_current(scene)
    render_pixels(scene)
    return time.perf_counter() - wall, time.process_time() - processor


def _handled(scene: bpy.types.Scene) -> tuple[float, float]:
    """Seconds until Blender has evaluated a lamp that was moved, and one that was added."""
    layer, lamp = scene.view_layers[0], next(obj for obj in scene.objects if obj.type == "LIGHT")
    moved, added = [], []
    layer.update()
    for _ in range(MOVES):
        lamp.location.x += 0.1
        moved.append(_updated(layer))
    for k in range(LAMPS):
        _lamp(scene, (2.0 * k, -4, 8))
        added.append(_updated(layer))
    return statistics.median(moved), statistics.median(added)


def _updated(layer: bpy.types.ViewLayer) -> float:
    start = time.process_time()
    layer.update()
    return time.process_time() - start


def _megabytes() -> float:
    """Memory of this process now; where the system does not tell, the most so far."""
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    print("FOUND" + json.dumps(main(**json.loads(sys.argv[1]))), flush=True)
    # A process that has rendered with the bpy wheel may never end by itself.
    os._exit(0)
