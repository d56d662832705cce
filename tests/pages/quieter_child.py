"""Pictures of one material in the studio, in a process of its own: with the package of an older commit too.

`python quieter_child.py JSON`: "as" is "principled", "nodes" or "osl", "bundle" a folder, baked if it is not there,
"edge" in pixels, "samples" a list, "out" an .npz file of one picture (H, W, 3) by each number of samples.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.report.principled_match import fit_principled
from measured_materials.addon.studio.studio import build_studio, render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.sources.analytic import MetallicPaint
from measured_materials.nodes import compat


def main(built: str, bundle: str, edge: int, samples: list[int], out: str) -> None:
    """Write the pictures."""
    compat.ensure_cycles()
    source = MetallicPaint()
    material = fit_principled(source).material() if built == "principled" else bpy.data.materials.new("paint")
    scene = build_studio(material, resolution=(edge, edge), seed=3)
    if built != "principled":
        path = Path(bundle)
        if not path.is_dir():
            bake_source(source, path)
        # An older commit knows of no choice of a shader.
        told = {"shader": "osl", "sample": "always"} if built == "osl" else {}
        build_brdf(read_bundle(path), material, choices=Choices(mode="exact", **told), scene=scene)
    if built == "osl":
        from measured_materials.nodes.osl_script import use_osl

        use_osl(scene)
    pictures = {}
    for count in samples:
        scene.cycles.samples = count
        pictures[str(count)] = render_linear(scene)
    np.savez(out, **pictures)


if __name__ == "__main__":
    told = json.loads(sys.argv[1])
    main(told["as"], told["bundle"], told["edge"], told["samples"], told["out"])
