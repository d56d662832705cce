"""Run inside a real Blender window by tutorials.py: tutorial_photographs.md from its import on, by mouse and keys."""

import bpy
from hands import (
    HERE,
    area_of,
    check,
    click,
    dialogues,
    keys,
    open_panel,
    picture,
    press,
    soon,
    type_into,
    write,
)
from hands_menus import (
    browser_open,
    choose,
    choose_file,
    file_import,
    hover_in_dialogue,
    leave_buttons,
    open_part,
    open_tab,
    switch_in_dialogue,
)
from tutorial_measurement import baked, bakes, facts, measured

ARC = "MEASURED_MATERIALS_OT_import_arc"
FOLDER = HERE / "data" / "felt"
# Seconds: what a change rebuilds waits until Blender has drawn the icon of the material, by software here.
REBUILT = 600.0


def steps():
    """The numbers are those of the tutorial's headings."""
    bpy.context.scene.render.engine = "CYCLES"  # which also draws the icons
    yield from file_import("measured_materials.import_arc")
    yield from browser_open()
    yield from type_into(area_of("FILE_BROWSER"), "directory", f"{FOLDER}/", region="UI", part=0.4)
    yield from choose_file("felt_el05.png")
    yield from picture("swatch_5_file_browser")
    dialogues.clear()
    yield from keys("Return")
    looked = lambda: ARC in dialogues and dialogues[ARC][0].looked  # noqa: E731
    yield from soon("5 the photographs are shown in the dialogue", looked)
    yield 1.0
    yield from picture("swatch_5_dialogue")
    yield from leave_buttons(ARC)
    yield from switch_in_dialogue(ARC, "advanced", 0.5)
    yield from open_part(ARC, "brightness", 0.25)
    yield from hover_in_dialogue(ARC, "scale_by")
    yield from click()
    yield from keys("a")
    yield from soon("5 the brightness is by the albedo", lambda: dialogues[ARC][0].scale_by == "albedo")
    yield from hover_in_dialogue(ARC, "albedo")
    yield from click(times=2)
    yield from write("0.2")
    yield from soon("5 which is typed", lambda: abs(dialogues[ARC][0].albedo - 0.2) < 1e-6)
    yield from picture("swatch_5_advanced")
    yield from leave_buttons(ARC)
    yield from keys("Return")
    yield from soon("5 the bake goes on beside the window", bakes.queue.is_busy)
    yield from soon("5 a Preview is on the object", lambda: bool(measured()))
    yield from baked()
    check("5 one material, on the object", bpy.data.objects["Cube"].active_material == measured()[0])
    check("5 of ten lights", len(facts()["averages"]["elevations_deg"]) == 10)
    check("5 its brightness is by the albedo", facts()["source"]["facts"]["calibration"]["by"] == "albedo")
    properties = area_of("PROPERTIES")
    yield from open_tab(properties, "MATERIAL")
    yield from picture("swatch_5_baked")
    yield from lit(properties)
    yield from laid_out(properties)


def lit(properties):
    """Heading 6: both at once, without a bake."""
    yield from open_panel(properties, "lighting")
    yield from choose(properties, "measured_lighting.lobe", "s")
    lobe = lambda: facts()["render"]["lobe"]["name"]  # noqa: E731
    yield from soon("6 Base Reflection is Sheen", lambda: lobe() == "sheen", REBUILT)
    yield from picture("swatch_6_sheen")
    yield from press(properties, "measured_lighting.sigma_auto")
    yield from type_into(properties, "measured_lighting.sigma", "0.5")
    sigma = lambda: facts()["render"]["sigma"] or 0.0  # noqa: E731  None as calibrated
    yield from soon("6 the Strength is the number typed", lambda: abs(sigma() - 0.5) < 1e-6, REBUILT)
    check("6 without a bake", not bakes.queue.is_busy())
    yield from picture("swatch_6_strength")


def laid_out(properties):
    """Heading 6: the pattern's size, by Adjust."""
    yield from open_panel(properties, "adjust")
    yield from press(properties, "measured_materials.lay_out")
    yield from picture("swatch_6_width")
    yield from keys("Return")
    mapping = next(node for node in measured()[0].node_tree.nodes if node.bl_idname == "ShaderNodeMapping")
    yield from soon("6 the pattern is scaled", lambda: abs(mapping.inputs["Scale"].default_value[0] - 1) > 1e-3)
    yield from press(properties, "measured_materials.random_tiling")
    tiling = lambda: any("Patch Size" in node.inputs for node in measured()[0].node_tree.nodes)  # noqa: E731
    yield from soon("6 the swatch is laid out at random", tiling)
    yield from picture("swatch_6_adjust")
