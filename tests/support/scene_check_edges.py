"""Every rule of the scene check just past what it reports, and just short of it, unmasked by other settings."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from measured_materials.addon.scene_check import (
    camera_rules,
    energy_rules,
    light_path_rules,
    material_rules,
    mix_rules,
    pass_rules,
    scene_rules,
    script_rules,
    sheet_rules,
)

from support.scene_check_cases import (
    another_lamp,
    cycles,
    image_world,
    lamp_of,
    mixed,
    scripted,
    shadow_linked,
    shrunk,
)
from support.scene_check_changes import (
    Change,
    adaptive,
    added,
    both,
    bounces,
    card_only,
    changed_value,
    colour_space,
    dark_lamp,
    far,
    film,
    ground_catches,
    ground_emits,
    haze,
    just_large_enough,
    lamp_nodes,
    lamp_seen_by,
    lamp_value,
    lamps_moved,
    layer_shows,
    lost,
    lost_but_packed,
    moved_nodes,
    of_the_camera,
    packed,
    sampled_by_chance,
    scaled,
    seen_by,
    sphere_seen_by,
    terminator,
    volume,
    without_lamps,
    without_light_tree,
    world_nodes,
    world_rays,
    world_seen_by,
)

MODULES = (
    scene_rules, light_path_rules, material_rules, mix_rules, camera_rules, pass_rules, energy_rules, sheet_rules,
    script_rules
)  # fmt: skip
STOP = 0.4392  # at which 50 mm that focus at 2.53 blur over one of 32 pixels of 36 mm


@dataclass(frozen=True)
class Edge:
    """A rule's two sides.

    Parameters
    ----------
    past : the least change that is reported, of a scene that the check has nothing to say about
    short : the largest that is not, or what takes the reason away while the setting stays; applied after `past`, which
        it undoes, or to a scene of its own where `anew`
    sheet : in a scene that shows a sheet
    """

    rule: str
    past: Change
    short: Change
    anew: bool = False
    sheet: bool = False


EDGES = [
    *(
        Edge(rule, cycles(name, 0.01), cycles(name, 0.0))
        for rule, name in (
            ("filter_glossy", "blur_glossy"),
            ("clamp_direct", "sample_clamp_direct"),
            ("clamp_indirect", "sample_clamp_indirect"),
        )
    ),
    *(
        Edge(name, bounces(name, least - 1, diffuse), bounces(name, least, diffuse))
        for name in ("glossy_bounces", "max_bounces")
        for diffuse, least in ((0, 4), (4, 4), (7, 7))
    ),
    Edge("adaptive_sampling", adaptive(31, 64), adaptive(32, 64)),
    Edge("adaptive_sampling", adaptive(4, 32), adaptive(4, 31)),
    # Cycles' own choice is 16 / threshold^0.3: 31.9 and 32.1.
    Edge("adaptive_sampling", adaptive(0, 64, 0.1001), adaptive(0, 64, 0.0985)),
    Edge("light_tree", without_light_tree, both(without_light_tree, without_lamps)),
    Edge("world_glossy", world_seen_by(False, True), world_seen_by(False, False)),
    Edge("world_diffuse", world_seen_by(True, False), world_seen_by(False, False)),
    Edge("lamp_glossy", seen_by(False, True), seen_by(False, False)),
    Edge("lamp_diffuse", seen_by(True, False), seen_by(False, False)),
    Edge("hidden_objects", sphere_seen_by(False, True), sphere_seen_by(False, False)),
    Edge("world_sampling", image_world, sampled_by_chance, anew=True),
    *(
        Edge(rule, spoil, both(spoil, dark_lamp))
        for rule, spoil in (
            ("lamp_shadow", lamp_value("use_shadow", False)),
            ("shadow_linking", shadow_linked),
            ("lamp_mis", lambda s: setattr(lamp_of(s).data.cycles, "use_multiple_importance_sampling", False)),
            ("lamp_size", lamp_value("size", 0.0)),
        )
    ),
    Edge(
        "lamp_size", another_lamp("SUN", energy=2, angle=1e-5), another_lamp("SUN", energy=2, angle=1.1e-5), anew=True
    ),
    Edge(
        "lamp_size",
        another_lamp("POINT", energy=2, shadow_soft_size=0.0),
        another_lamp("POINT", energy=2, shadow_soft_size=1e-4),
        anew=True,
    ),
    *(
        Edge(
            "lamp_size",
            another_lamp("AREA", energy=2, shape=shape, size=size, size_y=0.0),
            another_lamp("AREA", energy=2, shape=shape, size=0.01, size_y=least),
            anew=True,
        )
        # A square and a disk have one size only.
        for shape, size, least in (("RECTANGLE", 1, 0.01), ("ELLIPSE", 1, 0.01), ("SQUARE", 0, 0), ("DISK", 0, 0))
    ),
    *(
        Edge("lamp_size", scaled(x, y, size=1.0), scaled(max(x, 1e-3), max(y, 1e-3), size=1.0), anew=True)
        for x, y in ((0, 1), (1, 0))
    ),
    Edge("lamp_table", lamps_moved(1e-2), lamps_moved(1e-6), anew=True),
    Edge("shading_offset", terminator(1, 0.01), terminator(1, 0.0)),
    Edge("geometry_offset", terminator(2, 0.01), terminator(2, 0.0)),
    Edge("colour_space", colour_space("Linear Rec.709"), colour_space("Non-Color")),
    Edge("missing_texture", lost, lost_but_packed, anew=True),
    Edge("texture_limit", shrunk, just_large_enough),
    Edge("changed_group", changed_value, moved_nodes, anew=True),
    Edge("far_away", far(10_001.0), far(9_999.0)),
    Edge("osl_files", cycles("shading_system", True), both(packed, cycles("shading_system", True))),
    Edge("osl_off", scripted, both(scripted, cycles("shading_system", True), packed)),
    Edge("osl_gpu", both(scripted, cycles("device", "GPU")), both(scripted, cycles("device", "CPU"))),
    *(
        Edge("mixed_mirror", lambda s, k=share: mixed(s, k), lambda s, k=whole: mixed(s, k), anew=True)
        for share, whole in ((0.01, 0.0), (0.99, 1.0))
    ),
    Edge("added_mirror", added(True), added(False), anew=True),
    Edge("volume_roulette", volume(1), volume(0)),
    Edge("volume_light_path", haze("Is Shadow Ray"), haze("Is Camera Ray"), anew=True),
    Edge("world_light_path", world_nodes("Ray Depth"), world_nodes("Is Camera Ray"), anew=True),
    Edge("lamp_light_path", lamp_nodes("Ray Depth"), lamp_nodes("Is Glossy Ray"), anew=True),
    *(Edge("uneven_samples", cycles("samples", samples), cycles("samples", 64)) for samples in (63, 65, 100)),
    Edge(
        "uneven_samples",
        both(cycles("samples", 100), of_the_camera("PERSP", True, STOP * 1.02)),
        of_the_camera("PERSP", True, STOP * 0.98),
    ),
    Edge("emission_light_path", ground_emits("Is Glossy Ray"), ground_emits("Ray Depth"), anew=True),
    # Of what is opaque, and of a lamp that lights the side which is seen, it does not matter.
    Edge("lamp_camera", lamp_seen_by("camera", False), both(lamp_seen_by("camera", False), card_only), sheet=True),
    *(
        Edge(f"{kind}_{rays}", owner(rays, False), both(owner(rays, False), owner("diffuse", False)), sheet=True)
        for kind, owner in (("lamp", lamp_seen_by), ("world", world_rays))
        for rays in ("camera", "transmission")
    ),
    *(
        Edge(name, cycles(name, 3), cycles(name, 4), sheet=True)
        for name in ("transmission_bounces", "transparent_max_bounces")
    ),
    Edge("refractive_caustics", cycles("caustics_refractive", False), cycles("caustics_refractive", True), sheet=True),
    Edge("film_transparent", film(True), film(False), sheet=True),
    Edge("transparent_glass", film(True, True), film(False, True), sheet=True),
    Edge("sheet_catcher", ground_catches(True), ground_catches(False), sheet=True),
    Edge("sheet_passes", layer_shows("use_pass_z", True), layer_shows("use_pass_z", False), sheet=True),
    Edge(
        "sheet_passes",
        both(layer_shows("use_pass_normal", True), layer_shows("pass_alpha_threshold", 1e-3)),
        both(layer_shows("use_pass_normal", True), layer_shows("pass_alpha_threshold", 0.0)),
        sheet=True,
    ),
    *(
        Edge("sheet_cryptomatte", layer_shows(name, True), layer_shows(name, False), sheet=True)
        for name in ("use_pass_cryptomatte_object", "use_pass_cryptomatte_material")
    ),
]
# A switch has no value between: a scene that is as it should be is the other side, which every case starts from.
SWITCHES = {
    "reflective_caustics", "fast_gi", "path_guiding", "denoising", "engine", "bump_correction", "alpha_mode",
    "normal_pass", "denoising_data",
}  # fmt: skip
# Held from both sides by tests of their own.
ELSEWHERE = {
    "common_names": "tests/test_texture_files.py",
    "wrong_texture": "tests/test_texture_files.py",
    "no_texture": "test_scene_check.py, a texture is there or not",
    "linked_slots": "test_linked_groups_with_too_few_slots_are_told_and_left_alone",
    "not_aimed": "test_modes.py, of a material fitted to no lamps",
    "not_sampled": "test_sampled_lamps.py, of a file of a newer Blender",
    "missing_script_file": "test_osl_switch.py, of a material of one script",
    "emission_sampling": "test_sampled_lamps.py, of a file of a newer Blender",
    "too_bright": "test_adjust.py, of a material of known albedo",
    "pixel_jitter": "test_settings_of_newer_versions",
    "texture_resolution": "test_settings_of_newer_versions",
    "world_shadow": "test_settings_of_newer_versions",
}


def told_rules() -> set[str]:
    """Names of all rules, from the code that reports them."""
    told = {setting.rule for setting in scene_rules._SETTINGS}
    # Named by their setting.
    told |= {"glossy_bounces", "max_bounces", "transmission_bounces", "transparent_max_bounces"}
    for module in MODULES:
        for name in re.findall(r'Finding\(\s*f?"([\w{}]+)"', Path(str(module.__file__)).read_text()):
            kinds = ("world", "lamp", "emission") if "kind" in name else ("world", "lamp")
            told |= {name.format(kind=kind, rule=kind) for kind in kinds}
    return told
