"""Noise and time of sheets that sample lamps, beside aimed mirrors and beside Diffuse and Translucent BSDF.

Nodes ask scripts of OSL what their rays meet, as Cycles' Raycast node tells them from Blender 5.1 on; OSL is the whole
sheet, as *Shade by OSL* builds it, under a sky too. A plane is seen along one direction; its native stand-in reflects
and lets through as much of an even light. One thread renders, and of each the least time counts: whatever else the
machine does makes a turn longer, never shorter. Quiet is a camera whose lens gives numbers more even than the shader's
own.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
import numpy as np
from engine_scenes import room_pixels
from measured_materials.addon.lights.kept_surveys import surveyed
from measured_materials.addon.lights.light_tables import lamp_image, lamp_light_image, update_scene
from measured_materials.addon.lights.seen_world import surroundings_of
from measured_materials.addon.material.build_brdf import build_brdf
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.studio.studio import render_linear
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.nodes import compat
from measured_materials.nodes.material import build_material
from measured_materials.nodes.osl_script import use_osl
from record import put
from rich.console import Console
from rich.table import Table

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from support.scenes import TestScene, add_lamp
from support.sheet_scenes import BEFORE, BEHIND, GLAZED, SETTINGS, record_of, set_sky, sheet_scene

_NATIVE, _AIMED, _SAMPLED, _QUIET = "native", "aimed", "sampled", "sampled, quiet"
_OSL, _OSL_QUIET = "OSL", "OSL, quiet"
_BESIDE = _AIMED, _SAMPLED, _QUIET, _OSL, _OSL_QUIET
# Of the camera whose lens gives numbers; pixels that all show the same hide its blur.
_STOP = 64.0
_THETA, _SAMPLES, _COLUMNS = 40.0, 64, 96
# Of a picture whose time counts.
_MANY = 512
SKY = "sky"
LIGHTS = ("lamp behind", "lamp before", SKY, "HDR world")


def run(out: Path, quick: bool) -> None:
    """A table of noise at equal samples and of time, as multiples of the native closures'; --quick takes two lights."""
    table = Table("light", "native's noise", *(f"{name}: {what}" for name in _BESIDE for what in ("noise", "time")))
    with TemporaryDirectory() as folder:
        record = record_of(bake_source(GLAZED, Path(folder) / "glazed", SETTINGS))
        for light in LIGHTS[:: 2 if quick else 1]:
            found = _measured(record, light, turns=2 if quick else 4)
            noise, seconds = found[_NATIVE]
            cells = []
            for name in _BESIDE:
                if name not in found:
                    cells += ["", ""]
                    continue
                ratios = found[name][0] / noise, found[name][1] / seconds
                cells += [f"{ratio:.2g}" for ratio in ratios]
                for what, ratio in zip(("noise", "time"), ratios, strict=True):
                    put(f"{light}, {name}, {what}", ratio)
            put(f"{light}, native, noise", noise)
            table.add_row(light, f"{noise:.2%}", *cells)
    Console(width=150).print(table)


def _lit(scene: TestScene, light: str) -> None:
    if light == SKY:
        set_sky(scene.scene)
    elif light == "HDR world":
        _room(scene.scene)
    else:
        add_lamp(scene, "AREA", BEHIND if light == "lamp behind" else BEFORE, energy=300, size=1.0)


def _room(scene: bpy.types.Scene) -> None:
    """The picture of `bench engine`, and its window below the horizon too."""
    pixels = room_pixels()
    pixels = np.maximum(pixels, pixels[::-1])
    image = bpy.data.images.new("room", pixels.shape[1], pixels.shape[0], float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.concatenate([pixels[::-1], np.ones_like(pixels[..., :1])], -1).ravel())
    image.pack()
    scene.world, background = compat.new_world("room")
    tree = scene.world.node_tree
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = image
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    scene.world.cycles.sampling_method, scene.world.cycles.sample_map_resolution = "MANUAL", 512


def native_look(record: BrdfRecord, theta: float) -> bpy.types.Material:
    """Diffuse and Translucent BSDF of what a sheet shows of an even light, seen at so many degrees."""
    material = compat.new_material("native")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    total, output = nodes.new("ShaderNodeAddShader"), nodes.new("ShaderNodeOutputMaterial")
    for k, (kind, part) in enumerate((("Diffuse", record), ("Translucent", record.part("through")))):
        closure = nodes.new(f"ShaderNodeBsdf{kind}")
        if part is not None:
            rows = np.array(part.albedo.directional).T
            colour = [float(np.interp(theta, part.albedo.theta_o_deg, row)) for row in rows]
            closure.inputs["Color"].default_value = (*colour, 1)
        links.new(closure.outputs[0], total.inputs[k])
    links.new(total.outputs[0], output.inputs["Surface"])
    return material


def _measured(record: BrdfRecord, light: str, turns: int) -> dict[str, tuple[float, float]]:
    """Noise of a pixel over the mean, and processor seconds of a million samples, of every variant; but under the sky,
    which is no picture, nothing is sampled."""
    found: dict[str, tuple[float, float]] = {}
    with sheet_scene(native_look(record, _THETA), _THETA) as scene:
        blender_scene, stand_in = scene.scene, scene.sphere.data.materials[0]
        blender_scene.render.threads_mode, blender_scene.render.threads = "FIXED", 1
        blender_scene.render.resolution_x = _COLUMNS
        _lit(scene, light)
        update_scene(blender_scene)
        for name in (_NATIVE, *_BESIDE):
            if light == SKY and name in (_SAMPLED, _QUIET):
                continue
            lens, quiet = blender_scene.camera.data.dof, name in (_QUIET, _OSL_QUIET)
            lens.use_dof, lens.aperture_fstop, lens.focus_distance = quiet, _STOP, 5.0
            if name not in (_NATIVE, _AIMED):
                use_osl(blender_scene)
            scene.show(stand_in if name == _NATIVE else _built(record, name, blender_scene))
            update_scene(blender_scene)
            with scene.kept():  # a script is compiled once, in more time than many samples take
                _seconds(blender_scene, 1, 0)
                few, many = (min(_seconds(blender_scene, n, turn) for turn in range(turns)) for n in (1, _MANY + 1))
            # Cycles keeps the sequence of its own numbers too, and this one is of another length.
            blender_scene.cycles.samples = _SAMPLES
            pixels = render_linear(blender_scene).astype(float)
            rms = math.sqrt(float(pixels.var((0, 1), ddof=1).mean())) / float(pixels.mean())
            found[name] = rms, (many - few) / (_MANY * pixels[..., 0].size) * 1e6
        blender_scene.cycles.shading_system = False
    return found


def _built(record: BrdfRecord, name: str, scene: bpy.types.Scene) -> bpy.types.Material:
    """The sheet in mode Exact, fitted to the scene."""
    if name in (_SAMPLED, _QUIET):
        around = surroundings_of(surveyed(scene))
        tables = {"lamps": lamp_image(), "lights": lamp_light_image(), "surroundings": around}
        return build_material(record, mode="exact", scripted=True, pack=True, **tables)
    whole = name != _AIMED
    choices = Choices(mode="exact", sample="auto" if whole else "never", shader="osl" if whole else "nodes")
    material, plan = build_brdf(record, choices=choices, scene=scene, pack=True)
    assert plan.osl == whole
    return material


def _seconds(scene: bpy.types.Scene, samples: int, seed: int) -> float:
    scene.cycles.samples, scene.cycles.seed = samples, seed
    started = time.process_time()
    render_linear(scene)
    return time.process_time() - started
