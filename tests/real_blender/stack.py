"""Run inside a real Blender by lamps_agree.py: the largest graphs that sample light, within Cycles' 255 stack floats.

Isotropic and anisotropic, a B-spline whose slices are blended, codes that the shader decodes, one or four lamps and the
world, a denoiser's passes; and what is aimed at instead where the world is another. Of each the floats that an artist's
own nodes may keep alive beside it are told.
"""

import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
from common import HERE, empty_scene, ours, require

ROOM = 36  # nine nodes that hold a colour and a number each, as in tests/test_svm_limits.py
_SOURCES = {
    "paint": ("metallic-paint", {"flake_alpha": 0.3, "coat_alpha": 0.2}),
    "satin": ("ward", {"alpha": 0.2, "alpha_y": 0.5, "diffuse": (0.3, 0.2, 0.1), "specular": 0.4}),
    # Its sides differ. Of four lamps it samples two.
    "cloth": ("thin-cloth", {"diffuse": (0.1, 0.2, 0.1), "diffuse_behind": (0.3, 0.1, 0.1), "exponent": 8.0}),
}
_ROOM_FOR = {"cloth": 2}


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
    """A material that can sample four lamps and a world."""
    tables, seen_world = ours("addon.lights.light_tables"), ours("addon.lights.seen_world")
    picture = bpy.data.images.new("around", 8, 4, float_buffer=True, is_data=True)
    return ours("nodes.material").build_material(
        source,
        mode=mode,
        filter="bspline",
        stochastic=False,
        features=True,
        lamps=tables.lamp_image(),
        lights=tables.lamp_light_image(),
        surroundings=ours("nodes.world_picture").Surroundings(picture, "Linear", seen_world.world_light_image()),
    )


# Swatches by the model of their map; "measured" is of slices too, each channel at a level of its own.
_MAPS = ("none", "power", "basis", "azimuth", "measured")
# And those that let light through: of four lamps they sample two, as sheets do.
_THROUGH = tuple(f"{model}_through" for model in _MAPS if model != "azimuth")
_ROOM_FOR |= dict.fromkeys(_THROUGH, 2)


def largest_map(model, mode):
    """A swatch's material that can sample four lamps and a world."""
    tables, seen_world = ours("addon.lights.light_tables"), ours("addon.lights.seen_world")
    picture = bpy.data.images.new("around", 8, 4, float_buffer=True, is_data=True)
    source = ours("bake.bundle.bundle").read_bundle(HERE / f"swatch_{model}.mmat")
    record = ours("bake.shading_maps.record").ShadingMapRecord.of(source)
    lobe = None if model.startswith("measured") else ours("bake.lobes.lobes").Lobe("phong", 12.0, 0.4)
    return ours("nodes.shading_map_material").build_shading_map(
        record,
        settings=replace(record.render, lobe=lobe, mode=mode, above="clamp"),
        features=True,
        normals=True,
        texels=0.01 if model in ("none_through", "basis_through") else 0.0,
        lamps=tables.lamp_image(),
        lights=tables.lamp_light_image(),
        surroundings=ours("nodes.world_picture").Surroundings(picture, "Linear", seen_world.world_light_image()),
    )


# Lamps and world that are sampled, and those that are aimed at instead.
STATES = {
    "the world": ((0, True), (0, False)),
    "one lamp and the world": ((1, True), (0, False)),
    "four lamps and the world": ((4, True), (0, False)),
    "four lamps, and aimed at the world": ((4, False), (0, True)),
    "aimed at four lamps and the world": ((0, False), (4, True)),
}


def switch(sampled, instead):
    """Let all groups sample and aim at these."""
    aim_by = ours("nodes.aimed_light_group").aim_by
    for group in bpy.data.node_groups:
        if "measured_materials_sampled" in group:
            aim_by(group, *sampled)
        elif "measured_materials_instead" in group:
            aim_by(group, *instead)


def sampled_now():
    """What the groups sample."""
    groups = (group for group in bpy.data.node_groups if "measured_materials_sampled" in group)
    return {(group["measured_materials_lamps"], group["measured_materials_world"]) for group in groups if group.users}


if not hasattr(bpy.types, "ShaderNodeRaycast"):
    print("stack: no Raycast node in this Blender; no graph samples lamps")
else:
    import svm_stack

    for name in (*_SOURCES, *_MAPS, *_THROUGH):
        scene, source = empty_scene(), bundle(name) if name in _SOURCES else None
        scene["measured_materials_probe"] = True  # no handler switches what is measured
        ours("addon.rendering.renderer").set_unbiased(scene, samples=1, seed=0)
        for mode in ("exact", "balanced"):
            material = largest_map(name, mode) if source is None else largest(source, mode)
            # The largest by far is measured in both modes, all others in one.
            for words, (sampled, instead) in STATES.items():
                if mode == "exact" or words == "four lamps and the world":
                    switch(sampled, instead)
                    sampled = min(sampled[0], _ROOM_FOR.get(name, sampled[0])), sampled[1]
                    room, closures = svm_stack.room_on_stack(material), svm_stack.closures_in(material)
                    print(f"stack: {name}, {mode}, {words}: room for {room} floats, {closures} closures", flush=True)
                    require(sampled_now() == {sampled}, f"while it was measured they were not: {sampled_now()}")
                    require(room >= ROOM and closures <= svm_stack.CLOSURES, "that is not enough")
print("stack: all is well")
