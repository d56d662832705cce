"""Run inside a real Blender window by tutorials.py: pictures of all rows, of both kinds of material, in both places.

Arranged by bpy, since it is not what a person does but what she looks at: at Blender's usual widths, at UI scales 1
and 2, every panel open, Adjust with all that can be added.
"""

import importlib

import bpy
from hands import HERE, area_of, check, note, picture, region_of, window
from row_widths import cut_words

PACKAGE = "bl_ext.user_default.measured_materials"
# Of a properties editor in Blender's own layout on a screen of 1920 pixels.
_WIDTH = 340
_TITLE, _PREFIX = "Measured Materials", "MEASURED_MATERIALS_PT_"


def within(area):
    """The area as context of operators."""
    return bpy.context.temp_override(window=window(), screen=window().screen, area=area, region=region_of(area))


def scene():
    """Two objects, with a measurement and a swatch on them, and all in Adjust that can be there."""
    cube = bpy.data.objects["Cube"]
    ball = cube.copy()
    ball.data = cube.data.copy()
    bpy.context.collection.objects.link(ball)
    bpy.context.scene.render.engine = "CYCLES"
    for obj, name in ((cube, "lacquer"), (ball, "felt")):
        bpy.context.view_layer.objects.active = obj
        bpy.ops.measured_materials.import_bundle(filepath=str(HERE / "data" / f"{name}.mmat"), object_name=obj.name)
        yield 0.1
    for obj in (cube, ball):
        material = obj.active_material
        with bpy.context.temp_override(object=obj, active_object=obj, material=material):
            bpy.ops.measured_materials.add_bump()
            bpy.ops.measured_materials.add_normal_map()
        yield 0.1
    with bpy.context.temp_override(object=cube, active_object=cube, material=cube.active_material):
        bpy.ops.measured_materials.import_bundle(filepath=str(HERE / "data" / "lacquer.mmat"), object_name="Camera")
        second = next(m for m in bpy.data.materials if m.name.startswith("lacquer") and m != cube.active_material)
        bpy.ops.measured_materials.blend(second=second.name)
    with bpy.context.temp_override(object=ball, active_object=ball, material=ball.active_material):
        bpy.ops.measured_materials.random_tiling()
    tree = importlib.import_module(f"{PACKAGE}.nodes.material_tree")
    _, node = next(iter(tree.measured_nodes(cube.active_material.node_tree)))
    node.inputs["Brightness"].default_value = 3.0  # reflects more light than arrives, which Adjust says


def only_ours():
    """Blender's own panels of materials away, ours open from their first drawing on."""
    known = [cls for cls in bpy.types.Panel.__subclasses__() if getattr(cls, "is_registered", False)]
    ours = [cls for cls in known if cls.__name__.startswith(_PREFIX)]
    ours.sort(key=lambda cls: hasattr(cls, "bl_parent_id"))  # a panel is registered after the one that it stands in
    for cls in reversed(ours):
        bpy.utils.unregister_class(cls)
    for cls in ours:
        cls.bl_options = set(_options(cls)) - {"DEFAULT_CLOSED"}
        bpy.utils.register_class(cls)
    for cls in known:
        if getattr(cls, "bl_context", "") == "material" and cls not in ours and "HIDE_HEADER" not in _options(cls):
            bpy.utils.unregister_class(cls)


def _options(cls):
    return getattr(cls, "bl_options", ())


def cut(area, pixels):
    """Split this many pixels off at the left."""
    known = set(window().screen.areas)
    with within(area):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=pixels / area.width)
    (new,) = set(window().screen.areas) - known
    yield 0.5
    return sorted((area, new), key=lambda one: one.x)


def steps():
    """Pictures of each scale."""
    yield from scene()
    only_ours()
    yield 0.5
    ours = {"material": [], "shader": []}
    for cls in bpy.types.Panel.__subclasses__():
        if cls.__name__.startswith(_PREFIX):
            ours[cls.__name__.removeprefix(_PREFIX).split("_")[0]].append(cls)
    rest, places, found = area_of("VIEW_3D"), [], {}
    for scale in (1, 2):
        left, rest = yield from cut(rest, scale * _WIDTH)
        left.ui_type = "PROPERTIES"
        places.append(left)
    rest.ui_type = "ShaderNodeTree"
    rest.spaces.active.show_region_ui = True
    live = importlib.import_module(f"{PACKAGE}.addon.ui.panels.live_check")
    for scale, left in zip((1, 2), places):
        bpy.context.preferences.view.ui_scale = scale
        yield 1.0
        for obj in (bpy.data.objects["Cube"], bpy.data.objects["Cube.001"]):
            bpy.context.view_layer.objects.active = obj
            yield 0.5
            left.spaces.active.context = "MATERIAL"
            side = region_of(rest, "UI")
            side.active_panel_category = _TITLE
            live.check_now(bpy.context.scene)
            yield 3.0
            name = f"rows_{scale}_{obj.active_material.name}"
            yield from picture(name)
            for kind, area, region in (("material", left, region_of(left)), ("shader", rest, side)):
                note(f"{name} {kind}: {region.width} pixels at scale {bpy.context.preferences.system.ui_scale}")
                found[name, kind] = cut_words(ours[kind], area, region)
    bpy.context.preferences.view.ui_scale = 1
    for place, words in found.items():
        note(f"{place}: {words}")
    check("no word is cut", not any(found.values()))
