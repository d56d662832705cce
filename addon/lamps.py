"""The tables of a scene's lamps and world, kept current, that measured materials aim at (DESIGN.md section 5).

They follow edits, frames and the start of a render; until then an old table costs noise, never bias.
"""

from __future__ import annotations

import threading
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..bake.light_sampling import TEXELS, lamp_table
from ..nodes.aimed_light_group import SLOTS_KEY, WORLD_KEY, aimed_light_group
from . import fresh_tables, world_light
from .lamp_survey import CAPACITY, LampReport, survey, survey_scene
from .world_light import PROBE

TABLE = "MM Lamps"
# Of the draws, at most: the rest finds sky, bounce light and lamps that are not in the table.
LARGEST_SHARE = 0.9
# By scene, and its view layer in a window or whether it is rendered: lamps to aim at, and whether at the world.
_needs: dict[tuple[int, Any], tuple[int, bool]] = {}


def lamp_image() -> bpy.types.Image:
    """The file's table of lamps; made, with nothing to aim at, where there is none."""
    image = bpy.data.images.get((TABLE, None))
    if image is None or not _is_table(image):
        image = bpy.data.images.new(TABLE, TEXELS, CAPACITY, float_buffer=True, is_data=True, alpha=True)
        image.name = TABLE
        image.alpha_mode = "CHANNEL_PACKED"
        image.use_half_precision = False
        _write(image, lamp_table([], CAPACITY))
    return image


def update_lamps(depsgraph: bpy.types.Depsgraph, *, rebuild: bool = True) -> LampReport:
    """Bring the tables in line with an evaluated view layer; nothing is written where nothing has changed.

    Parameters
    ----------
    rebuild : also give materials the node group for as many lamps as there are, and for the world where that pays
    """
    key = (depsgraph.scene.session_uid, depsgraph.view_layer.name)
    return _follow(survey(depsgraph), key, rebuild, viewport=depsgraph.mode == "VIEWPORT")


def update_scene(scene: bpy.types.Scene, *, rebuild: bool = True, for_render: bool = False) -> LampReport:
    """`update_lamps` for a scene that need not be shown anywhere, all of its view layers together.

    Parameters
    ----------
    for_render : take the lamps that a render will show, which the viewport may hide
    """
    return _follow(survey_scene(scene, for_render=for_render), (scene.session_uid, for_render), rebuild)


def table_of(report: LampReport) -> np.ndarray:
    """`bake.light_sampling.lamp_table` of what is to be aimed at."""
    structure = report.world.structure if report.world.aimed else None
    world = (structure.toward, structure.flux) if structure is not None else None
    return lamp_table(report.lamps, CAPACITY, report.sky, LARGEST_SHARE, world)


def _follow(report: LampReport, key: tuple[int, Any], rebuild: bool, viewport: bool = True) -> LampReport:
    if rebuild:
        lamp_image()
        if report.world.aimed:
            world_light.world_image(report.world)
        _needs[key] = (report.slots, report.world.aimed)
        _fit_slots()
    changed = world_light.write_world(report.world) if report.world.aimed else []
    table = table_of(report)
    changed += [image for image in _tables() if _write(image, table)]
    if viewport:
        for image in changed:
            fresh_tables.for_the_viewport(image)
    return report


def _fit_slots() -> None:
    """Let all materials aim at as many lamps as the scene that needs most: windows may show several, in turn."""
    shown = {scene.session_uid for scene in bpy.data.scenes}
    needs = [need for (scene, _), need in _needs.items() if scene in shown]
    world = bpy.data.images.get((world_light.IMAGE, None)) if any(aimed for _, aimed in needs) else None
    for table in _tables():
        _set_slots(table, max((slots for slots, _ in needs), default=0), world)


def _set_slots(image: bpy.types.Image, slots: int, world: bpy.types.Image | None) -> None:
    """Let every material aim at this many lamps, and at the world or not; nothing happens where they do already."""
    wanted = (slots, world is not None)
    groups = {t for t in bpy.data.node_groups if SLOTS_KEY in t and t.users and any(_shows(n, image) for n in t.nodes)}
    if all((group[SLOTS_KEY], group.get(WORLD_KEY, False)) == wanted for group in groups):
        return
    own = [tree for tree in bpy.data.node_groups if tree.library is None]
    aiming = [node for tree in own for node in tree.nodes if getattr(node, "node_tree", None) in groups]
    if not aiming:
        return
    replaced = {node.node_tree for node in aiming}
    group = aimed_light_group(image, slots, world)
    for table in (image, world):
        if table is not None and (asked := fresh_tables.extensions(table, replaced)):
            fresh_tables.extend(table, min(asked), [group])
    for node in aiming:
        node.node_tree = group
    for old in replaced - {group}:
        if not old.users:
            bpy.data.node_groups.remove(old)


def _shows(node: bpy.types.Node, image: bpy.types.Image) -> bool:
    return getattr(node, "image", None) == image


def _is_table(image: bpy.types.Image) -> bool:
    return image.name.startswith(TABLE) and tuple(image.size) == (TEXELS, CAPACITY)


def _tables() -> list[bpy.types.Image]:
    """The file's table, and those that came along with linked and appended materials."""
    return [image for image in bpy.data.images if _is_table(image)]


def _write(image: bpy.types.Image, table: np.ndarray) -> bool:
    pixels = np.ascontiguousarray(table[::-1]).ravel()
    before = np.empty_like(pixels)
    image.pixels.foreach_get(before)
    if np.array_equal(pixels, before):
        return False
    image.pixels.foreach_set(pixels)
    image.update()
    return True


def keep_current(scene: bpy.types.Scene) -> None:
    """Bring the tables in line with the scene as it will be rendered, if some material aims by them."""
    if _in_use() and PROBE not in scene:
        update_scene(scene, for_render=True)


def pack_tables() -> None:
    """Put the tables into the .blend that is about to be saved: only so does it keep the pixels of such images.

    A table that was lost holds zeros, and nothing is aimed by it. (That of the world is packed whenever it is written.)
    """
    for image in _tables():
        if image.is_dirty and image.library is None and image.users:
            image.pack()


def _in_use() -> bool:
    return any(image.users > 0 for image in _tables())


@persistent
def _after_an_edit(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if not _in_use():
        _needs.clear()  # nobody looks at the lamps until then
    elif PROBE not in depsgraph.scene:
        known = (depsgraph.scene.session_uid, depsgraph.view_layer.name) in _needs
        if not known or any(_concerns_lamps(update) for update in depsgraph.updates):
            update_lamps(depsgraph)
        elif any(isinstance(update.id, bpy.types.Material) for update in depsgraph.updates):
            _fit_slots()


def _concerns_lamps(update: bpy.types.DepsgraphUpdate) -> bool:
    """Whether an edit may change what is aimed at; most only change other objects, or what they are made of."""
    block = update.id
    if isinstance(block, bpy.types.Object):
        moved = update.is_updated_transform or update.is_updated_geometry
        return block.type == "LIGHT" or (block.is_instancer and moved)
    return isinstance(block, (bpy.types.Light, bpy.types.World, bpy.types.Scene, bpy.types.Collection))


@persistent
def _after_a_frame(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    # Before every picture of a render too, then with the lamps that it shows; that may be outside Blender's main
    # thread, and the nodes are evaluated already: none is touched, but where only that lets Cycles see the table, and
    # then Blender evaluates them once more.
    if _in_use() and PROBE not in depsgraph.scene:
        update_lamps(depsgraph, rebuild=False)
        if depsgraph.mode == "RENDER" and depsgraph.scene.render.use_persistent_data:
            for image in (*_tables(), *world_light.tables()):
                fresh_tables.for_a_render(depsgraph.scene, image)


@persistent
def _before_a_render(scene: bpy.types.Scene, *_: Any) -> None:
    # The last chance to change nodes, for lamps that only a render shows.
    if threading.current_thread() is threading.main_thread():
        keep_current(scene)


@persistent
def _after_loading(*_: Any) -> None:
    world_light.distrust_tables()
    fresh_tables.forget()
    _needs.clear()
    if _in_use():
        update_scene(bpy.context.scene)


@persistent
def _after_undo(*_: Any) -> None:
    world_light.distrust_tables()


@persistent
def _before_saving(*_: Any) -> None:
    pack_tables()


_HANDLERS = {
    "depsgraph_update_post": _after_an_edit,
    "frame_change_post": _after_a_frame,
    "render_init": _before_a_render,
    "load_post": _after_loading,
    "undo_post": _after_undo,
    "redo_post": _after_undo,
    "save_pre": _before_saving,
}


def register() -> None:
    """Called by `addon.register`."""
    for event, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, event).append(handler)


def unregister() -> None:
    """Called by `addon.unregister`."""
    for event, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, event).remove(handler)
    _needs.clear()
