"""Run inside a real Blender window by tutorials.py: the dialogue of photographs at a UI scale of 2, on a common screen.

All of it is to be on the screen: only some versions of Blender scroll a dialogue. The words are measured as those of
panels are.
"""

import importlib
import types
from dataclasses import replace

import bpy
from hands import HERE, area_of, check, click, dialogues, keys, note, picture, region_of, soon, window
from hands_menus import hover_in_dialogue, leave_buttons, open_part, switch_in_dialogue
from row_widths import Layout

ARC = "MEASURED_MATERIALS_OT_import_arc"
# What a dialogue keeps at both of its sides, in pixels at a UI scale of 1.
_BORDERS = 20
# Settings with which the tabs are highest.
_HIGHEST = {
    "frame": "corners",
    "decode": "gamma",
    "scale_by": "card",
    "one_plane": True,
    "through": "felt",
    "through_by": "diffuser",
    "compression": "basis",
    "lobe": "phong_cubic",
    "transmission": "phong_cubic",
    "sigma": 0.5,
    "transmission_sigma": 0.5,
    "a_max": 0.5,
}


class Drawn:
    """The operator, which draws into another layout."""

    def __init__(self, operator, layout):
        self.operator, self.layout = operator, layout
        # An operator's own is that of all operators.
        self.bl_rna = bpy.ops.measured_materials.import_arc.get_rna_type()

    def __getattr__(self, name):
        own = getattr(type(self.operator), name, None)
        return types.MethodType(own, self) if isinstance(own, types.FunctionType) else getattr(self.operator, name)


def fits(name):
    """Whether the dialogue is on the screen as a whole, and none of its words is cut."""
    yield from picture(f"dialogue_{name}")
    operator, region = dialogues[ARC]
    note(f"dialogue {name}: {region.width} by {region.height} at {region.x}, {region.y}")
    # A dialogue that is higher is cut at both ends, its shadow included, and scrolls.
    check(f"{name} is on the screen", region.height <= window().height)
    layout = Layout()
    type(operator).draw.__wrapped__(Drawn(operator, layout), bpy.context)
    cut = layout.cut(region.width / bpy.context.preferences.system.ui_scale - _BORDERS)
    note(f"{name}: {cut}")
    check(f"{name}: no word is cut", not cut)


def steps():
    """The photographs as they are shown first, then every part of Advanced."""
    bpy.context.preferences.view.ui_scale = 2
    yield 1.0
    dialogues.clear()
    view = area_of("VIEW_3D")
    with bpy.context.temp_override(window=window(), screen=window().screen, area=view, region=region_of(view)):
        bpy.ops.measured_materials.import_arc(
            "INVOKE_DEFAULT", directory=str(HERE / "data" / "felt"), object_name="Cube"
        )
    looked = lambda: ARC in dialogues and dialogues[ARC][0].looked  # noqa: E731
    yield from soon("the photographs are shown in the dialogue", looked)
    yield 1.0
    yield from fits("look")
    look = importlib.import_module("bl_ext.user_default.measured_materials.addon.ui.photograph_look").looking
    look.look = replace(look.look, doubts=(f"A doubt {'that is long ' * 10}.",) * 5)
    yield from hover_in_dialogue(ARC, "quality")
    yield from click()  # whatever is clicked has all drawn anew
    yield from fits("doubts")
    for name, value in _HIGHEST.items():
        setattr(dialogues[ARC][0], name, value)
    yield from leave_buttons(ARC)
    yield from switch_in_dialogue(ARC, "advanced", 0.5)
    tabs = bpy.ops.measured_materials.import_arc.get_rna_type().properties["part"].enum_items.keys()
    for number, name in enumerate(tabs):
        yield from open_part(ARC, name, (number + 0.5) / len(tabs))
        yield from leave_buttons(ARC)
        yield from fits(name)
    yield from keys("Escape")
    bpy.context.preferences.view.ui_scale = 1
    yield 1.0
