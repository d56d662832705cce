"""Run inside a real Blender by lamps_agree.py: the largest graphs that sample lamps, within Cycles' 255 stack floats.

Anisotropic, a B-spline whose slices are blended, codes that the shader decodes, four lamps, a denoiser's
passes. Of each the floats that an artist's own nodes may keep alive beside it are told.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
from common import HERE, empty_scene, lamp, ours, require

ROOM = 36  # nine nodes that hold a colour and a number each, as in tests/test_svm_limits.py
_SOURCES = {
    "satin": ("ward", {"alpha": 0.2, "alpha_y": 0.5, "diffuse": (0.3, 0.2, 0.1), "specular": 0.4}),
}


def bundle(name):
    """Small, of one of the formulas."""
    formula, parameters = _SOURCES[name]
    sampler = ours("bake.sampling.half_vector_cells").SamplerLayout(8, 8, 8)
    settings = ours("bake.brdf.settings").BakeSettings(
        8, "fitted", storage="log", filter="bspline", sampler=sampler, basis="half", viewers=(5, 3)
    )
    source = ours("bake.sources.analytic").by_name(formula, **parameters)
    baked = ours("bake.brdf.bake").bake_source(source, HERE / f"{name}.mmat", settings)
    return ours("bake.bundle.bundle").read_bundle(baked.path)


def largest(source, mode):
    """A material that samples four lamps."""
    tables = ours("addon.lights.light_tables")
    made = ours("nodes.material").build_material(
        source,
        mode=mode,
        filter="bspline",
        stochastic=False,
        features=True,
        lamps=tables.lamp_image(),
        lights=tables.lamp_light_image(),
    )
    tables.update_scene(bpy.context.scene)
    require(sampled_lamps() == {4}, f"not four lamps are sampled: {sampled_lamps()}")
    return made


def sampled_lamps():
    """How many the groups sample."""
    groups = (group for group in bpy.data.node_groups if "measured_materials_sampled" in group)
    return {group["measured_materials_lamps"] for group in groups if group.users}


if not hasattr(bpy.types, "ShaderNodeRaycast"):
    print("stack: no Raycast node in this Blender; no graph samples lamps")
else:
    import svm_stack

    for name in _SOURCES:
        scene, source = empty_scene(), bundle(name)
        ours("addon.rendering.renderer").set_unbiased(scene, samples=1, seed=0)
        for k in range(4):
            lamp(scene, (k, 0, 3))
        for mode in ("exact", "balanced"):
            room, closures = svm_stack.room_on_stack(material := largest(source, mode)), svm_stack.closures_in(material)
            print(f"stack: {name}, {mode}: room for {room} floats, {closures} closures")
            require(sampled_lamps() == {4}, f"while it was measured they were not: {sampled_lamps()}")
            require(room >= ROOM and closures <= svm_stack.CLOSURES, "that is not enough")
print("stack: all is well")
