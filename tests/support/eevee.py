"""Pictures of a swatch by EEVEE, in a process of its own: without OpenGL it ends there."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake.bundle.bundle import Bundle

_CHILD = """
import json, os, sys
from dataclasses import replace
import bpy, numpy as np
from measured_materials.addon.gantry import photograph_arc as gantry
from measured_materials.addon.studio import studio
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.nodes.shading_map_material import build_shading_map

path, out, techniques, view, light, size, layout = json.loads(sys.argv[1])
bundle = read_bundle(path)
pictures = {}
for technique in techniques:
    usual = ShadingMapRecord.read(bundle).render
    material = build_shading_map(bundle, settings=replace(usual, technique=technique))
    with gantry.plane_scene(material, view=view, light=light, size=size, samples=1, sun_angle=0.0) as scene:
        mesh = next(obj for obj in bpy.data.objects if obj.name.startswith("Flat tile")).data
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) @ np.array(layout).T
        mesh.uv_layers[0].data.foreach_set("uv", corners.astype(np.float32).ravel())
        scene.render.engine = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"
        scene.eevee.taa_render_samples = 1
        scene.render.filter_size = 0.0  # a pixel is its middle alone
        second = bpy.data.lights.new("second", "SUN")
        second.energy, second.angle, second.color = 3.0, 0.0, (1.0, 0.7, 0.4)
        scene.collection.objects.link(bpy.data.objects.new("second", second))  # straight from above
        pictures[technique] = studio.render_linear(scene)
np.savez(out, **pictures)
os._exit(0)  # Blender's own end may hang once OpenGL has been used
"""


def eevee_pictures(
    bundle: Bundle,
    folder: Path,
    techniques: Sequence[str],
    view: tuple[float, float],
    light: tuple[float, float],
    size: int,
    layout: Any = ((1, 0), (0, 1)),
) -> dict[str, np.ndarray]:
    """Linear pictures (size, size, 3) by technique, under a sun of irradiance 1 and one of 3 straight from above.

    Skips the test where EEVEE cannot render.

    Parameters
    ----------
    view, light : (theta, phi) in radians, as of the gantry
    layout : (2, 2), texture coordinates of the plane by x and y
    """
    out = folder / "pictures.npz"
    arguments = json.dumps(
        [str(bundle.path), str(out), list(techniques), view, light, size, np.asarray(layout).tolist()]
    )
    done = subprocess.run([sys.executable, "-P", "-c", _CHILD, arguments], capture_output=True, text=True, timeout=240)
    if done.returncode < 0:  # Blender aborts where there is no OpenGL
        pytest.skip(f"EEVEE cannot render here: {(done.stderr.strip() or 'ended by a signal').splitlines()[-1][:200]}")
    assert done.returncode == 0, done.stderr
    return dict(np.load(out))
