"""Run inside a real Blender by lamps_agree.py: pictures of `lamp_cases`, lamps sampled in the shader and by the mirror.

Names of cases follow `--`. Of each, NAME.npz holds the pictures (K, H, W, 3) of both and the pixels that count.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
import numpy as np
import world_cases
from common import HERE, ours, require
from lamp_cases import CASES as OF_LAMPS
from lamp_cases import built

CASES = OF_LAMPS | world_cases.CASES
SEEDS = 10
_FORMULAS = {
    "paint": ("metallic-paint", {"flake_alpha": 0.3, "coat_alpha": 0.2}),
    "metal": ("ward", {"diffuse": (0.1, 0.05, 0.02), "specular": (0.5, 0.4, 0.3), "alpha": 0.25}),
}


def bundles():
    """Those of the formulas, baked where they are not there yet."""
    settings = ours("bake.brdf.settings").BakeSettings(
        resolution=24,
        alpha=(0.5, 0.4),
        sampler=ours("bake.sampling.half_vector_cells").SamplerLayout(n_o=32, n_h=32, n_phi=16),
    )
    found = {}
    for name, (formula, parameters) in _FORMULAS.items():
        folder = HERE / f"{name}.mmat"
        if not folder.is_dir():
            source = ours("bake.sources.analytic").by_name(formula, **parameters)
            ours("bake.brdf.bake").bake_source(source, folder, settings)
        found[name] = ours("bake.bundle.bundle").read_bundle(folder)
    return found


def materials(scene, sample, swatch_name=""):
    """Of mode Exact, by name: those of the formulas, or a swatch alone; refused where lamps cannot be sampled."""
    choices = ours("addon.material.choices").Choices(mode="exact", sample=sample)
    if swatch_name:
        return {"swatch": swatch(scene, swatch_name, choices)}
    build = ours("addon.material.build_brdf").build_brdf
    return {name: build(bundle, choices=choices, scene=scene)[0] for name, bundle in bundles().items()}


def swatch(scene, name, choices):
    """Of photographs, as the extension builds it for a scene."""
    bundle = ours("bake.bundle.bundle").read_bundle(HERE / f"{name}.mmat")
    material = ours("nodes.shading_map_material").build_shading_map(bundle)
    ours("addon.material.choices").show_choices(material.measured_quality, choices)
    record = ours("bake.shading_maps.record").ShadingMapRecord.of(bundle)
    ours("addon.material.build_shading_map").build_map(record, material, record.render, pack=False, scene=scene)
    return material


def pictures(scene, first, samples):
    """(K, H, W, 3) under seeds of their own."""
    found = []
    for seed in range(first, first + SEEDS):
        scene.cycles.seed, scene.cycles.samples = seed, samples
        found.append(ours("addon.studio.studio").render_linear(scene))
    return np.stack(found)


def grown(pixels):
    """With all that are at most two away, as far as the filter of pixels reaches."""
    ways = range(-2, 3)
    return np.any([np.roll(pixels, (y, x), (0, 1)) for y in ways for x in ways], axis=0)


def compared(name):
    """Render a case both ways."""
    case = CASES[name]
    scene, dress = built(case)
    dress(materials(scene, "never", case.swatch))
    # Materials that sample are built before anything changes.
    sampling = materials(scene, "always", case.swatch) if case.later else None
    if case.later:
        case.later(scene)
        bpy.context.view_layer.update()
    mirrored = pictures(scene, 1, case.samples)
    dress(sampling or materials(scene, "always", case.swatch))
    bpy.context.view_layer.update()
    require_sampled(name, later=case.later is not None)
    sampled = pictures(scene, 101, case.samples)
    mean = 0.5 * (mirrored + sampled).mean((0, 3))
    lit = mean > 0.05 * mean.mean()
    lit &= ~grown(mean > case.brightest * np.median(mean[lit]))
    np.savez(HERE / f"{name}.npz", mirrored=mirrored, sampled=sampled, mask=lit)


def require_sampled(name, later):
    """All groups sample what the case is about, or aim at it instead once something has changed."""
    kind = "measured_materials_instead" if later else "measured_materials_sampled"
    key = "measured_materials_world" if name in world_cases.CASES else "measured_materials_lamps"
    found = [g[key] for g in bpy.data.node_groups if kind in g and g.users]
    require(found and all(found), f"{name}: not all is sampled: {found}")


if not hasattr(bpy.types, "ShaderNodeRaycast"):
    print("unbiased: no Raycast node in this Blender")
else:
    for name in sys.argv[sys.argv.index("--") + 1 :]:
        compared(name)
print("unbiased: all is well")
