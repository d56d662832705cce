"""Mitsuba's side of `bench mitsuba`, in an environment of its own: `python mitsuba_child.py JSON`.

"variant", "file" of the measurement, "facts" of the scene (`peer_scenes.facts`), "world" of a picture or empty, "edge",
"jobs" as pairs of samples and seed, "out" for the pictures (K, H, W, 3). Prints a line of JSON: processor seconds of
each job, or why this variant does not run here.
"""

import json
import sys
import time

import drjit as dr
import mitsuba as mi
import numpy as np


def scene_of(facts, world, measurement, edge):
    """The scene as `peer_scenes.lit` builds it, of a true sphere."""
    transform, ground = mi.ScalarTransform4f, facts["ground"]
    placed = transform().translate([0, 0, ground["height"]]) @ transform().scale([ground["half"], ground["half"], 1])
    described = {
        "type": "scene",
        # Cycles counts bounces between surfaces, Mitsuba also the way from the eye and the one to the light.
        "integrator": {"type": "path", "max_depth": facts["bounces"] + 2, "rr_depth": 50},
        "sensor": {
            "type": "perspective",
            "fov": facts["angle"],
            "to_world": transform().look_at(origin=facts["eye"], target=facts["target"], up=[0, 0, 1]),
            "film": {"type": "hdrfilm", "width": edge, "height": edge, "rfilter": {"type": "box"}},
            "sampler": {"type": "multijitter"},
        },
        "sphere": {"type": "sphere", "radius": 1.0, "bsdf": {"type": "measured", "filename": measurement}},
        "ground": {"type": "rectangle", "to_world": placed, "bsdf": diffuse(ground["colour"])},
    }
    if world:
        # Both turn about a pole; here it is y, and the middle of the picture lies elsewhere.
        turned = transform(np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64))
        described["world"] = {"type": "envmap", "bitmap": mi.Bitmap(np.load(world)), "to_world": turned}
    else:
        lamp = facts["lamp"]
        described["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": facts["sky"]}}
        described["lamp"] = {
            "type": "rectangle",
            "to_world": transform(np.array(lamp["matrix"], np.float64)),
            "bsdf": diffuse([0, 0, 0]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": lamp["radiance"]}},
        }
    return mi.load_dict(described)


def diffuse(colour):
    """A matte surface."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}


def main(variant, file, facts, world, edge, jobs, out):
    """Render all jobs on one thread."""
    try:
        mi.set_variant(variant)
        # Measurements hold small negative values, and it would write a line for each that comes into a picture.
        mi.set_log_level(mi.LogLevel.Error)
        dr.set_thread_count(1)
        scene = scene_of(facts, world, file, edge)
        pictures, seconds = [], []
        # The first picture of a compiled variant also compiles.
        for samples, seed in [(jobs[0][0], 0), *jobs]:
            started = time.process_time()
            pictures.append(np.array(mi.render(scene, spp=samples, seed=seed), np.float32)[..., :3])
            seconds.append(time.process_time() - started)
    except (ImportError, RuntimeError, AttributeError) as error:
        return {"error": " ".join(str(error).split())[:300]}
    np.save(out, np.stack(pictures[1:]))
    return {"seconds": seconds[1:]}


if __name__ == "__main__":
    print("FOUND" + json.dumps(main(**json.loads(sys.argv[1]))), flush=True)
