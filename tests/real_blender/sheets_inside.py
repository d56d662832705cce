"""Run inside a real Blender by sheets.py: its cases with native closures, aimed mirrors and sampled lamps.

Of each, NAME.json holds the means of parts of a picture, noise of a pixel over its mean, and seconds of a sample. With
`--parts` parts.json holds seconds of a sample while parts of the shader are taken away, one after the other.
"""

import json
import math
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
import numpy as np
from common import HERE, ours, require
from mathutils import Matrix, Vector

EDGE, PARTS, SAMPLES = 16, 24, 32
TIMED, TURNS = 512, 5
STOP = 64.0  # of a camera whose lens gives numbers; pixels that all show the same hide its blur
compat, tables = ours("nodes.compat"), ours("addon.lights.light_tables")


def turned_to_origin(eye):
    """Matrix of what looks at the origin."""
    return Matrix.Translation(eye) @ (-eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()


def made(theta, place, size, shown):
    """A scene of a large sheet, whose pixels all show the same, and the sheet."""
    scene = bpy.data.scenes.new("sheet")
    bpy.context.window.scene = scene
    mesh = bpy.data.meshes.new("sheet")
    mesh.from_pydata([(-20, -20, 0), (21, -20, 0), (21, 20, 0), (-20, 20, 0)], [], [(0, 1, 2, 3)])
    sheet = bpy.data.objects.new("sheet", mesh)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.004
    angle = math.radians(theta)
    along, up = math.sin(angle), math.cos(angle)
    camera.matrix_world = turned_to_origin(5 * Vector((along * math.cos(0.7), along * math.sin(0.7), up)))
    scene.camera = camera
    for obj in (sheet, camera):
        scene.collection.objects.link(obj)
    scene.world, background = compat.new_world("world")
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = float(place is None)
    if place is not None:
        lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "AREA"))
        lamp.data.energy, lamp.data.size, lamp.visible_camera = 300, size, shown
        lamp.matrix_world = turned_to_origin(Vector(place))
        scene.collection.objects.link(lamp)
    ours("addon.rendering.renderer").set_unbiased(scene, samples=SAMPLES, seed=1)
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    return scene, sheet


def native(record, theta):
    """Diffuse and Translucent BSDF of what the sheet reflects and lets through of an even light."""
    angles = record.albedo.theta_o_deg
    at = min(range(len(angles)), key=lambda k: abs(angles[k] - min(theta, 180 - theta)))
    material = compat.new_material("native")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    total, output = nodes.new("ShaderNodeAddShader"), nodes.new("ShaderNodeOutputMaterial")
    for k, (kind, part) in enumerate((("Diffuse", record), ("Translucent", record.part("through")))):
        closure = nodes.new(f"ShaderNodeBsdf{kind}")
        closure.inputs["Color"].default_value = (*part.albedo.directional[at], 1)
        links.new(closure.outputs[0], total.inputs[k])
    links.new(total.outputs[0], output.inputs["Surface"])
    return material


def picture(scene, columns, samples, seed):
    """(EDGE, columns, 3), and the processor's seconds."""
    scene.render.resolution_x, scene.render.resolution_y = columns, EDGE
    scene.cycles.samples, scene.cycles.seed = samples, seed
    started = time.process_time()
    return ours("addon.studio.studio").render_linear(scene), time.process_time() - started


def seconds(scene):
    """Of a million samples, set-up taken off; the least of some turns, as whatever else runs only adds to it."""
    few, many = (min(picture(scene, EDGE, samples, 1)[1] for _ in range(TURNS)) for samples in (1, TIMED + 1))
    return (many - few) / (TIMED * EDGE * EDGE) * 1e6


def measured(case):
    """Figures of all variants."""
    bundle = ours("bake.bundle.bundle").read_bundle(HERE / "glazed.mmat")
    record = ours("bake.brdf.record").BrdfRecord.read(bundle)
    Choices, build = ours("addon.material.choices").Choices, ours("addon.material.build_brdf").build_brdf
    scene, sheet = made(*case)
    found = {}
    for name, sample in (("native", ""), ("aimed", "never"), ("sampled", "auto"), ("quiet", "auto")):
        lens = scene.camera.data.dof
        lens.use_dof, lens.aperture_fstop, lens.focus_distance = name == "quiet", STOP, 5.0
        if sample:
            material, plan = build(record, choices=Choices(mode="exact", sample=sample), scene=scene, pack=True)
            require(plan.sample == (name in ("sampled", "quiet") and case[1] is not None), f"{name}: {plan.effects}")
        else:
            material = native(record, case[0])
        sheet.data.materials.clear()
        sheet.data.materials.append(material)
        tables.update_scene(scene)
        whole = picture(scene, EDGE * PARTS, SAMPLES, 7)[0].astype(float)
        parts = [part.mean((0, 1)).tolist() for part in np.split(whole, PARTS, axis=1)]
        noise = float(whole.std((0, 1)).mean() / whole.mean())
        found[name] = {"parts": parts, "noise": noise, "time": seconds(scene)}
    return found


def parts(case):
    """Seconds of a sample of the whole, and without what is named, each on top of those before. All take turns."""
    sheet_nodes, expr = ours("nodes.sampled_sheet"), ours("nodes.expr")
    native_closure, sampled_closure = ours("nodes.native_closure"), ours("nodes.sampled_closure")
    emission = sheet_nodes.emission
    cuts = {
        "whole": {},
        "the choice between mirrors by light": {
            "light_side_group": lambda *_: None,
            "call": lambda group, *values: values[2] if group is None else ours("nodes.group").call(group, *values),
        },
        "light that mirrors meet": {
            "met_light": lambda *_: sampled_closure.Met(1.0, 1.0, 0.0, 0.0),
            "emission": lambda colour, shown: (
                native_closure.add_closures([]) if isinstance(shown, float) else emission(colour, shown)
            ),
        },
        "points of light": {"direct_light": lambda *_: (expr.vec(0.0, 0.0, 0.0), 0.0)},
        "mirrors": {
            "_mirrored": lambda mirror, closures, *_: native_closure.add_closures([made(1.0) for made in closures])
        },
    }
    record = ours("bake.brdf.record").BrdfRecord.read(ours("bake.bundle.bundle").read_bundle(HERE / "glazed.mmat"))
    Choices, build = ours("addon.material.choices").Choices, ours("addon.material.build_brdf").build_brdf
    scene, sheet = made(*case)
    materials = {"native": native(record, case[0])}
    for name, cut in cuts.items():
        for what, stand_in in cut.items():
            require(hasattr(sheet_nodes, what), f"nodes.sampled_sheet has no {what}")
            setattr(sheet_nodes, what, stand_in)
        materials[name] = build(record, choices=Choices(mode="exact"), scene=scene, pack=True)[0]
    taken = {}
    for _ in range(TURNS):
        for name, material in materials.items():
            sheet.data.materials.clear()
            sheet.data.materials.append(material)
            tables.update_scene(scene)
            spent = [picture(scene, EDGE, samples, 1)[1] for samples in (1, TIMED + 1)]
            taken[name] = [min(pair) for pair in zip(spent, taken.get(name, spent), strict=True)]
    return {name: (many - few) / (TIMED * EDGE * EDGE) * 1e6 for name, (few, many) in taken.items()}


if not hasattr(bpy.types, "ShaderNodeRaycast"):
    print("sheets: no Raycast node in this Blender")
else:
    compat.ensure_cycles()
    for name, case in json.loads((HERE / "sheets.json").read_text(encoding="utf-8")).items():
        (HERE / f"{name}.json").write_text(json.dumps(measured(case)), encoding="utf-8")
    if "--parts" in sys.argv:
        (HERE / "parts.json").write_text(json.dumps(parts((40.0, (1, 1, -3), 1.0, True))), encoding="utf-8")
print("sheets: all is well")
