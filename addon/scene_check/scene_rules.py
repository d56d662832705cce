"""Rules of the scene check: settings of scene, world and lamps.

Figures are shares of the picture's light, measured with a metallic paint on a sphere over matte ground under a sky and
an area lamp of a third of the sphere's width, but where the sentence says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import bpy

from ...nodes import compat
from ...nodes.light_ray import is_ray_script
from .findings import NOTE, SLOW, WRONG, Finding, Subject, editable, measured_trees, setting

# Bounces that carry all the light one can measure, in a room of measured paint.
_BOUNCES = 4
# Samples before a pixel may be left: at 32 and a threshold of 0.01 nothing was lost.
_MIN_SAMPLES = 32
# Lamps without extent get a radius of this part of their distance: shadows about as sharp as twice the sun's.
_SIZE = 0.01
_SUN = math.radians(0.526)


@dataclass(frozen=True)
class _Setting:
    """A property of `scene.cycles` that has one right value."""

    rule: str
    severity: str
    name: str
    label: str
    right: Any
    why: str


_SETTINGS = (
    _Setting(
        "filter_glossy",
        WRONG,
        "blur_glossy",
        "Filter Glossy",
        0,
        "it blurs the mirror after a diffuse bounce; 1 lost 0.5 to 2 %, up to 7 % in places",
    ),
    _Setting(
        "clamp_direct",
        WRONG,
        "sample_clamp_direct",
        "Clamping, Direct Light",
        0,
        "it cuts rare bright samples off; 10 lost 13 % under a lamp that is not aimed at",
    ),
    _Setting(
        "clamp_indirect",
        WRONG,
        "sample_clamp_indirect",
        "Clamping, Indirect Light",
        0,
        "it cuts rare bright samples off; 10 lost 1.7 % under a small lamp that is not aimed at",
    ),
    _Setting(
        "reflective_caustics",
        WRONG,
        "caustics_reflective",
        "Reflective Caustics",
        True,
        "without, nothing that a diffuse bounce lights sees the mirror; that lost 2 %, 9 % in places",
    ),
    _Setting(
        "fast_gi",
        WRONG,
        "use_fast_gi",
        "Fast GI Approximation",
        False,
        "it guesses the light that is to be measured; Replace lost 2.6 %, Add gave 51 % too much",
    ),
    _Setting(
        "pixel_jitter",
        WRONG,
        "use_pixel_jitter",
        "Pixel Jitter",
        False,
        "all samples of a pixel draw the same direction, and noise stays however many there are; 3 % were lost",
    ),
    _Setting(
        "path_guiding",
        SLOW,
        "use_guiding",
        "Path Guiding",
        False,
        "it cannot guide a mirror; it takes 30 to 60 % more time and left as much noise",
    ),
)


def cycles_settings(subject: Subject) -> Iterator[Finding]:
    """Rule: settings of Cycles that have one right value."""
    cycles = subject.scene.cycles
    for rule in _SETTINGS:
        value = getattr(cycles, rule.name, rule.right)  # some are of newer versions
        if value != rule.right:
            found = f"{rule.label} is {_words(value)}"
            mend = setting(cycles, rule.name, rule.right)
            yield Finding(rule.rule, rule.severity, _scene(subject), found, _words(rule.right), rule.why, mend)


def engine(subject: Subject) -> Iterator[Finding]:
    """Only Cycles follows the mirror."""
    name = subject.scene.render.engine
    if name != "CYCLES":
        why = "other engines show Cycles' own shaders or a stand-in, not the measurement"
        yield Finding("engine", WRONG, _scene(subject), f"Render Engine is {name}", "Cycles", why)


def bounces(subject: Subject) -> Iterator[Finding]:
    """A mirror is a glossy bounce, even where the material is matte."""
    cycles = subject.scene.cycles
    wanted = max(_BOUNCES, cycles.diffuse_bounces)
    why = "a matte material's mirror counts as glossy too; 0 lost 8 %, 1 and 2 up to 13 and 4 % in corners of a room"
    for name, label in (("glossy_bounces", "Glossy Bounces"), ("max_bounces", "Total Bounces")):
        value = getattr(cycles, name)
        if value < wanted:
            mend = setting(cycles, name, wanted)
            yield Finding(name, WRONG, _scene(subject), f"Light Paths, {label} are {value}", str(wanted), why, mend)


def adaptive_sampling(subject: Subject) -> Iterator[Finding]:
    """Pixels that are left before their rare bright samples have come."""
    cycles = subject.scene.cycles
    least = cycles.adaptive_min_samples
    if least == 0:  # Cycles' own choice
        least = int(16 / max(cycles.adaptive_threshold, 1e-3) ** 0.3)
    if cycles.use_adaptive_sampling and least < _MIN_SAMPLES <= cycles.samples:
        why = (
            "pixels end before their rare bright samples have come; 4 lost 1.4 % at a threshold of 0.1 under a lamp "
            "that is not aimed at"
        )
        mend = setting(cycles, "adaptive_min_samples", 2 * _MIN_SAMPLES)
        found = f"Noise Threshold, Min Samples are {least}"
        yield Finding("adaptive_sampling", WRONG, _scene(subject), found, str(2 * _MIN_SAMPLES), why, mend)


def light_tree(subject: Subject) -> Iterator[Finding]:
    """Rule: the light tree is off, which serves the native closures."""
    cycles = subject.scene.cycles
    if subject.lamps and not cycles.use_light_tree:
        why = "19 % more noise with one lamp and a sky"
        mend = setting(cycles, "use_light_tree", True)
        yield Finding("light_tree", SLOW, _scene(subject), "Light Tree is off", "on", why, mend)


def denoising(subject: Subject) -> Iterator[Finding]:
    """Not what was measured any more, but what artists want."""
    cycles = subject.scene.cycles
    if cycles.use_denoising:
        why = "fine for a picture, wrong for comparing it with a measurement"
        mend = setting(cycles, "use_denoising", False)
        yield Finding("denoising", NOTE, _scene(subject), "Denoise is on", "", why, mend)


def open_shading_language(subject: Subject) -> Iterator[Finding]:
    """Materials built as a script, and those of nodes that ask by one which lamps are seen."""
    cycles, where = subject.scene.cycles, _scene(subject)
    trees = {tree for material in subject.wearers for tree in measured_trees(material)}
    scripts = [tree for tree in trees if any(node.bl_idname == "ShaderNodeScript" for node in tree.nodes)]
    if not scripts:
        return
    only_rays = all(is_ray_script(tree) for tree in scripts)
    severity = SLOW if only_rays else WRONG
    if not cycles.shading_system:
        mend = setting(cycles, "shading_system", True)
        why = _UNASKED if only_rays else "without it Cycles leaves Script nodes out"
        yield Finding("osl_off", severity, where, "Open Shading Language is off", "on", why, mend)
    if cycles.device == "GPU" and compat.compute_device() != "OPTIX":
        mend = setting(cycles, "device", "CPU")
        why = "Script nodes run on CPU and OptiX only" + (f"; {_UNASKED}" if only_rays else "")
        yield Finding("osl_gpu", severity, where, "Device is GPU", "CPU", why, mend)


_UNASKED = "materials cannot ask then which lamps are seen, and a mirror brings all of their light, noisier"


# --- world ----------------------------------------------------------------------------------------------


def world(subject: Subject) -> Iterator[Finding]:
    """Seen by mirror and native closures alike, and sampled."""
    world = subject.scene.world
    if world is None:
        return
    where = f"world {world.name}"
    yield from _ray_visibility("world", where, world.cycles_visibility, "glossy", "diffuse", "41 %", "17 %")
    kinds = {node.bl_idname for node in world.node_tree.nodes} if world.node_tree else set()
    if world.cycles.sampling_method == "NONE" and kinds & {"ShaderNodeTexEnvironment", "ShaderNodeTexSky"}:
        mend = setting(world.cycles, "sampling_method", "AUTOMATIC")
        why = "Cycles' own shaders find its bright places by chance only"
        yield Finding("world_sampling", SLOW, where, "Sampling is None", "Auto", why, mend)
    if not getattr(world.cycles, "use_shadows", True):
        yield Finding("world_shadow", WRONG, where, "Shadow is off", "on", _SHADOWS)


_SHADOWS = "its light passes obstacles on the way to Cycles' own shaders, but not to the mirror"
_UNSHADED = "a sphere behind a card got 39 % more light, in mode Reference none"


def _ray_visibility(
    rule: str, where: str, owner: Any, glossy: str, diffuse: str, without_glossy: str, without_diffuse: str
) -> Iterator[Finding]:
    """Hidden from one kind of rays; what is hidden from both is meant to be."""
    seen_glossy, seen_diffuse = getattr(owner, glossy), getattr(owner, diffuse)
    if seen_diffuse and not seen_glossy:
        why = f"the mirror of a matte material is glossy too and does not meet it; a sphere lost {without_glossy}"
        mend = setting(owner, glossy, True)
        yield Finding(f"{rule}_glossy", WRONG, where, "Ray Visibility, Glossy is off", "on", why, mend)
    if seen_glossy and not seen_diffuse:
        why = f"only a part of the material sees it; a sphere lost {without_diffuse}"
        yield Finding(f"{rule}_diffuse", WRONG, where, "Ray Visibility, Diffuse is off", "on, or Glossy off too", why)


# --- lamps ----------------------------------------------------------------------------------------------


def lamps(subject: Subject) -> Iterator[Finding]:
    """A mirror meets only what a ray can hit."""
    for obj in subject.lamps:
        data, where = obj.data, f"lamp {obj.name}"
        yield from _ray_visibility("lamp", where, obj, "visible_glossy", "visible_diffuse", "33 %", "8 %")
        if not data.cycles.use_multiple_importance_sampling:
            why = "the mirror never meets the lamp; a sphere lost 10 % of its light, 35 % in mode Reference"
            mend = setting(data.cycles, "use_multiple_importance_sampling", True)
            yield Finding("lamp_mis", WRONG, where, "Multiple Importance is off", "on", why, mend)
        if _extent(obj) <= 0:
            label, value, wanted = _size_words(obj, subject.distance(obj))
            why = "no ray can meet it, so that only Cycles' own shaders see its light"
            mend = editable(data, partial(_give_extent, obj, subject.distance(obj))) if label != "Scale" else None
            yield Finding("lamp_size", WRONG, where, f"{label} is {value}", wanted, why, mend)
        if not data.use_shadow:
            yield Finding("lamp_shadow", WRONG, where, "Cast Shadow is off", "on", f"{_SHADOWS}; {_UNSHADED}")
        blockers = obj.light_linking.blocker_collection
        if blockers is not None:
            found = f"Shadow Linking, only {blockers.name} casts shadows"
            yield Finding("shadow_linking", WRONG, where, found, "all objects", f"{_SHADOWS}; {_UNSHADED}")


def hidden_objects(subject: Subject) -> Iterator[Finding]:
    """Rule: objects hidden from glossy rays, which the mirror does not reflect."""
    names = [o.name for o in subject.objects if o.type != "LIGHT" and o.visible_diffuse and not o.visible_glossy]
    if names:
        found = f"Ray Visibility, Glossy is off for {', '.join(names[:3])}" + (" and others" if len(names) > 3 else "")
        why = "mirrors of measured materials do not reflect them, Cycles' own shaders do"
        yield Finding("hidden_objects", NOTE, _scene(subject), found, "", why)


def _extent(obj: bpy.types.Object) -> float:
    """Across the narrow side, in the world: only an area lamp grows with its object."""
    data = obj.data
    if data.type == "SUN":
        return data.angle if data.angle > 1e-5 else 0.0
    if data.type == "AREA":
        across, along, _ = obj.matrix_world.to_scale()
        size_y = data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
        return min(abs(across) * data.size, abs(along) * size_y)
    return data.shadow_soft_size


def _wanted_sizes(obj: bpy.types.Object, distance: float) -> tuple[float, ...]:
    """Sizes of a lamp's data that make it as wide as it should be, 0 where no size does: its object has no extent."""
    if obj.data.type == "SUN":
        return (_SUN,)
    if obj.data.type != "AREA":
        return (_SIZE * distance,)
    scales = [abs(scale) for scale in obj.matrix_world.to_scale()[:2]]
    if obj.data.shape not in ("RECTANGLE", "ELLIPSE"):
        scales = [min(scales)]
    return tuple(2 * _SIZE * distance / scale if scale > 0 else 0.0 for scale in scales)


def _size_words(obj: bpy.types.Object, distance: float) -> tuple[str, str, str]:
    """The setting, what it is, and what it should be."""
    wanted = _wanted_sizes(obj, distance)
    if not all(wanted):
        return "Scale", "0 across the lamp", "above 0"
    if obj.data.type == "SUN":
        return "Angle", "0", "the sun's 0.526 degrees"
    return ("Size" if obj.data.type == "AREA" else "Radius"), "0", f"{max(wanted):.2g} or so"


def _give_extent(obj: bpy.types.Object, distance: float) -> None:
    data, (wanted, *other) = obj.data, _wanted_sizes(obj, distance)
    if data.type == "SUN":
        data.angle = wanted
    elif data.type == "AREA":
        data.size = data.size or wanted
        if other:
            data.size_y = data.size_y or other[0]
    else:
        data.shadow_soft_size = wanted


def _scene(subject: Subject) -> str:
    return f"scene {subject.scene.name}"


def _words(value: Any) -> str:
    return ("off", "on")[value] if isinstance(value, bool) else f"{value:.4g}"


RULES = (
    engine,
    cycles_settings,
    bounces,
    adaptive_sampling,
    light_tree,
    open_shading_language,
    world,
    lamps,
    hidden_objects,
    denoising,
)
