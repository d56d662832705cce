"""Run inside a real Blender by repeat_zones.py: trees for some numbers of lamps, and what they take, to zones.json."""

import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
import numpy as np
from common import HERE, ours

COUNTS, ROWS, EDGE, SAMPLES, TURNS = (1, 4, 16), 16, 64, 64, 4


def data_image(name, table):
    """A table (rows, columns, 4) whose rows count from the top."""
    image = bpy.data.images.new(name, table.shape[1], table.shape[0], float_buffer=True, is_data=True)
    image.pixels.foreach_set(table[::-1].astype(np.float32).ravel())
    image.update()
    return image


def light_tables():
    """Lamps in a row, each of which hides part of the next."""
    lamps, light = ours("bake.sampling.lamps"), ours("bake.sampling.lamp_light")
    shown = [
        lamps.Lamp(lamps.SPHERE, 1.0, centre=(0.2 * (k % 4), 0.2 * (k // 4), 2.0 + 0.1 * k), extent=0.3)
        for k in range(ROWS)
    ]
    emitted = [light.LampLight((1.0 + k, 1.0, 0.5)) for k in range(ROWS)]
    return ours("nodes.lamp_light_groups").LightTables(
        data_image("zone lamps", lamps.lamp_table(shown, ROWS)),
        data_image("zone lights", light.lamp_light_table(emitted, ROWS)),
    )


def one_lamp(tables):
    """Group of what a shader does for one lamp that a direction may meet: (Row, Position, Normal, wi) to its light."""
    expr, group, lit = ours("nodes.expr"), ours("nodes.group"), ours("nodes.lamp_light_groups")

    def build(row, position, normal, wi):
        seen = group.call(lit._seen_group(tables), row, position, normal)
        radiance, _, length = group.call(lit._met_group(), *seen, position, wi)
        return expr.scale(radiance, ours("nodes.light_ray").light_ray(position, wi, length)[0])

    inputs = {"Row": "float", "Position": "vector", "Normal": "vector", "wi": "vector"}
    return group.node_group("Zone Lamp", inputs, {"Light": "vector"}, build)


def tree_of(lamp, count, zone):
    """A material that emits the light of so many lamps along one direction."""
    material = ours("nodes.compat").new_material("zone" if zone else "unrolled")
    tree = material.node_tree
    new, link = tree.nodes.new, tree.links.new
    place, away = new("ShaderNodeNewGeometry"), new("ShaderNodeVectorMath")
    away.operation, away.inputs[0].default_value = "SUBTRACT", (0.0, 0.0, 2.0)
    link(place.outputs["Position"], away.inputs[1])
    straight = new("ShaderNodeVectorMath")
    straight.operation = "NORMALIZE"
    link(away.outputs[0], straight.inputs[0])

    def light(row):
        made = new("ShaderNodeGroup")
        made.node_tree = lamp
        for socket, name in ((place.outputs["Position"], "Position"), (place.outputs["Normal"], "Normal")):
            link(socket, made.inputs[name])
        link(straight.outputs[0], made.inputs["wi"])
        if isinstance(row, float):
            made.inputs["Row"].default_value = row
        else:
            link(row, made.inputs["Row"])
        return made.outputs[0]

    def plus(first, second):
        added = new("ShaderNodeVectorMath")
        link(first, added.inputs[0])
        link(second, added.inputs[1])
        return added.outputs[0]

    if zone:
        begin, end = new("GeometryNodeRepeatInput"), new("GeometryNodeRepeatOutput")
        begin.pair_with_output(end)
        end.repeat_items.clear()
        end.repeat_items.new("VECTOR", "Light")
        begin.inputs["Iterations"].default_value = count
        link(plus(begin.outputs["Light"], light(begin.outputs["Iteration"])), end.inputs["Light"])
        total = end.outputs["Light"]
    else:
        total = light(0.0)
        for k in range(1, count):
            total = plus(total, light(float(k)))
    shown, output = new("ShaderNodeEmission"), new("ShaderNodeOutputMaterial")
    link(total, shown.inputs["Color"])
    link(shown.outputs[0], output.inputs["Surface"])
    return material


def scene_of():
    """A square seen from above."""
    scene = bpy.context.scene
    for obj in list(scene.objects):
        bpy.data.objects.remove(obj)
    mesh = bpy.data.meshes.new("square")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 1.9, (0, 0, 9)
    scene.camera = camera
    for obj in (bpy.data.objects.new("square", mesh), camera):
        scene.collection.objects.link(obj)
    ours("addon.rendering.renderer").set_unbiased(scene, samples=1, seed=1)
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    return scene, mesh


def seconds(scene, samples):
    """Of the processor, and the picture."""
    scene.render.resolution_x = scene.render.resolution_y = EDGE
    scene.cycles.samples = samples
    started = time.process_time()
    seen = ours("addon.studio.studio").render_linear(scene)
    return time.process_time() - started, seen


def measured(scene, mesh, lamp, count):
    """Figures of both trees, which take turns; of each the least counts."""
    found = {}
    for _ in range(TURNS):
        for name in ("zone", "unrolled"):
            started = time.process_time()
            material = tree_of(lamp, count, name == "zone")
            build = time.process_time() - started
            mesh.materials.clear()
            mesh.materials.append(material)
            first, _ = seconds(scene, 1)
            more, seen = seconds(scene, SAMPLES + 1)
            told = {"build": build, "first": first, "million": (more - first) / (SAMPLES * EDGE**2) * 1e6}
            known = found.setdefault(name, dict(told))
            known.update({what: min(known[what], told[what]) for what in told})
            known.update(nodes=len(material.node_tree.nodes), mean=float(seen.mean()))
            bpy.data.materials.remove(material)
    return found


if hasattr(bpy.types, "GeometryNodeRepeatInput") and hasattr(bpy.types, "ShaderNodeRaycast"):
    ours("nodes.compat").ensure_cycles()
    scene, mesh = scene_of()
    lamp = one_lamp(light_tables())
    told = {count: measured(scene, mesh, lamp, count) for count in COUNTS}
    (HERE / "zones.json").write_text(json.dumps(told), encoding="utf-8")
else:
    print("no Repeat zone with rays in this Blender")
