"""Run inside a real Blender by check.py: lamps that the shader samples, where a Raycast node is there to ask.

A ball of measured paint under a lamp, a card half way between: the picture is that of a mirror that meets the lamp,
with a fraction of its noise; and where the lamps' light is not known, as in a volume, the mirror is back at once.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
from common import HERE, empty_scene, lacquer, lamp, ours, require

SEEDS, SAMPLES = 12, 128


def ball():
    """Of paint, the active object."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=1)
    bpy.ops.object.shade_smooth()
    obj = bpy.context.object
    obj.shadow_terminator_geometry_offset = 0
    return lacquer(HERE, "flakes", resolution=24)


def pictures(scene, first):
    """(K, H, W, 3) under seeds of their own."""
    import numpy as np

    found = []
    for seed in range(first, first + SEEDS):
        scene.cycles.seed, scene.cycles.samples = seed, SAMPLES
        found.append(ours("addon.studio.studio").render_linear(scene))
    return np.stack(found).astype(float)


def groups():
    """Lamps by name of the group that samples them, or aims at them where that is all it can."""
    switch, instead = "measured_materials_lamps", "measured_materials_instead"
    used = [group for group in bpy.data.node_groups if group.users and instead not in group]
    return {group.name: group[switch] for group in used if switch in group}


def compared(scene, material, first):
    """Mean over mean, its standard error, and the part of the variance that is left, sampled beside mirrored."""
    results = []
    for k, choice in enumerate(("never", "auto")):
        material.measured_quality.sample = choice
        require(not material.measured_quality.problem, material.measured_quality.problem)
        results.append(pictures(scene, first + 100 * k))
    mirrored, sampled = results
    lit = mirrored.mean((0, 3)) > 0.1 * mirrored.mean()
    means = [r[:, lit].mean((1, 2)) for r in results]
    error = sum((m.std(ddof=1) / m.mean()) ** 2 / SEEDS for m in means) ** 0.5
    left = sampled[:, lit].var(0, ddof=1).mean() / mirrored[:, lit].var(0, ddof=1).mean()
    return means[1].mean() / means[0].mean(), error, left


if not hasattr(bpy.types, "ShaderNodeRaycast"):
    print("sampled: no Raycast node in this Blender; a mirror meets the lamps")
else:
    for shape, size in (("SQUARE", 0.3), ("DISK", 2.5)):
        scene = empty_scene(size=40)
        ours("addon.rendering.renderer").set_unbiased(scene, samples=SAMPLES, seed=0)
        light = lamp(scene, (1.0, 0.5, 3), size=size)
        light.data.shape = shape
        bpy.ops.mesh.primitive_plane_add(size=0.5, location=(0.7, 0.4, 2.0))
        bpy.context.object.visible_camera = False
        material = ball()
        require(set(groups().values()) == {1}, f"one lamp should be sampled: {groups()}")
        require(material.cycles.emission_sampling == "NONE", "Cycles would take the ball for a lamp")
        ratio, error, left = compared(scene, material, 1)
        told = f"{shape} of {size} m: mean {ratio:.4f} of the mirror's, standard error {error:.4f}, variance {left:.3f}"
        print(f"sampled: {told}")
        require(abs(ratio - 1) < 3 * error, f"not the same picture: {told}")
        require(left < (0.5 if size < 1 else 1.0), f"no less noise: {told}")
        # A planted error of 2 % would have been found by the same comparison.
        require(0.02 > 5 * error, f"too noisy to say so: {told}")
        world = scene.world = scene.world or bpy.data.worlds.new("world")
        ours("nodes.compat").node_tree(world)
        tree = world.node_tree
        output = next((n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputWorld"), None)
        output = output or tree.nodes.new("ShaderNodeOutputWorld")
        link = tree.links.new(tree.nodes.new("ShaderNodeVolumeScatter").outputs[0], output.inputs["Volume"])
        bpy.context.view_layer.update()
        require(set(groups().values()) == {0}, f"a volume is there: {groups()}")
        tree.links.remove(link)
        bpy.context.view_layer.update()
        require(set(groups().values()) == {1}, f"the volume is gone: {groups()}")
        light.data.use_shadow = False
        bpy.context.view_layer.update()
        require(set(groups().values()) == {0}, f"a lamp without shadows is there: {groups()}")
        material.measured_quality.sample = "always"
        require("no shadows" in material.measured_quality.problem, "sampling should have been refused")
        light.data.use_shadow = True
print("sampled: all is well")
