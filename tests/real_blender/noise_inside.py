"""Run inside a real Blender by noise.py: one material of `bench engine`, its lights, and `--quiet`, follow `--`.

Prints a line of figures for each light and variant.
"""

import json
import sys
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))
import bpy
from common import HERE, ours, require

if not hasattr(bpy.types, "ShaderNodeRaycast"):
    print("no Raycast node in this Blender")
    raise SystemExit

from engine_scenes import LIGHTS, Sizes, compare, lit


def with_lamp(scene):
    """Both."""
    LIGHTS["HDR world"](scene)
    world = scene.world
    LIGHTS["small lamp"](scene)
    scene.world = world


LIGHTS["HDR world and lamp"] = with_lamp
VARIANTS = {"aimed": "never", "sampled": "auto"}


def measured(bundle, stand_in, light, quiet):
    """Figures of all variants in one light."""
    Choices, build = ours("addon.material.choices").Choices, ours("addon.material.build_brdf").build_brdf
    with lit(light) as scene:
        if quiet:
            lens = scene.camera.data.dof
            lens.use_dof, lens.aperture_fstop, lens.focus_distance = True, 64.0, 5.2
        # Drivers and handlers look at the scene that is shown.
        bpy.context.window.scene = scene
        materials = {"Principled": stand_in.material()}
        for name, sample in VARIANTS.items():
            materials[name], plan = build(bundle, choices=Choices(mode="exact", sample=sample), scene=scene)
            require(plan.sample == (name == "sampled"), f"{name}: {plan.effects}")
        found = compare(scene, materials, Sizes())
    for material in materials.values():
        bpy.data.materials.remove(material)
    bpy.data.orphans_purge(do_recursive=True)
    return found


name, *lights = sys.argv[sys.argv.index("--") + 1 :]
facts = json.loads((HERE / "noise.json").read_text(encoding="utf-8"))
stand_in = ours("addon.report.principled_match").Principled(**facts["stand_ins"][name])
bundle = ours("bake.bundle.bundle").read_bundle(HERE / facts["bundles"][name])
for light in (light for light in lights if light != "--quiet"):
    for variant, noise in measured(bundle, stand_in, light, "--quiet" in lights).items():
        told = {"material": name, "light": light, "variant": variant, **asdict(noise)}
        print(f"noise: {json.dumps(told)}")
