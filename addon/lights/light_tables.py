"""The tables of a scene's lamps and world, kept current, that measured materials aim at (method.md, section 10).

They follow edits, frames and the start of a render. Until then an old table costs noise; of lamps that a shader samples
it also costs light that has bounced or passed something transparent before.

What handlers change are pixels and settings of nodes. Blender has closed its undo step when it calls them: a datablock
that they made, removed or linked to another was one that the next undo did not know of, and crashed by. Images and
groups are made, and groups of versions before exchanged, where a material is built, by operators, and when a file is
loaded, which is before its first undo step.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...bake.sampling.lamp_light import LIGHT_TEXELS, lamp_light_table
from ...bake.sampling.lamps import TEXELS, lamp_table
from ...nodes.aimed_light_group import INSTEAD_KEY, SLOTS_KEY, aim_by, aimed_light_group, can_switch
from ...nodes.exchanged_group import exchange_group
from ...nodes.group import HASH_KEY, content_hash
from ...nodes.lamp_light_groups import SAMPLED_KEY
from ...nodes.light_images import new_table, world_table
from ...nodes.light_ray import can_raycast
from ...nodes.osl_script import SCRIPTED_KEY
from ...nodes.second_group import MOST_LAMPS, is_blended
from .. import events
from . import image_reload, seen_world, world_survey
from .exact_lamps import volume_in_file
from .lamp_survey import CAPACITY, LampReport, survey, survey_scene
from .moving_camera import follow_cameras
from .world_survey import PROBE

TABLE, LIGHT_TABLE = "MM Lamps", "MM Lamp Light"
# Of the draws, at most: the rest finds sky, bounce light and lamps that are not in the table.
LARGEST_SHARE = 0.9
# Seconds until writes that Blender has refused are tried again.
_PATIENCE = 0.3


class _Need(NamedTuple):
    """Lamps to aim at, whether at the world, lamps that a shader may sample, the volume that was met, in words, and
    whether a shader may sample the world."""

    slots: int
    world: bool
    sampled: int
    volume: str
    lit: bool


# By scene, and its view layer in a window or whether it is rendered.
_needs: dict[tuple[int, Any], _Need] = {}


def lamp_image() -> bpy.types.Image:
    """The file's table of lamps; made, with nothing to aim at, where there is none."""
    image = bpy.data.images.get((TABLE, None))
    if image is None or not _is_table(image):
        image = new_table(TABLE, TEXELS, CAPACITY)
        _write(image, lamp_table([], CAPACITY))
    return image


def lamp_light_image() -> bpy.types.Image:
    """The file's table of what its lamps emit; made, all dark, where there is none."""
    image = bpy.data.images.get((LIGHT_TABLE, None))
    if image is None or not _is_light_table(image):
        image = new_table(LIGHT_TABLE, LIGHT_TEXELS, CAPACITY)
    return image


def update_lamps(depsgraph: bpy.types.Depsgraph, *, switch: bool = True) -> LampReport:
    """Bring the tables in line with an evaluated view layer; nothing is written where nothing has changed.

    Makes, removes and links no datablock: for handlers.

    Parameters
    ----------
    switch : also let materials aim at as many lamps as there are, and at the world where that pays
    """
    key = (depsgraph.scene.session_uid, depsgraph.view_layer.name) if switch else None
    return _follow(survey(depsgraph), key, viewport=depsgraph.mode == "VIEWPORT")


def update_scene(scene: bpy.types.Scene, *, for_render: bool = False) -> LampReport:
    """Bring the tables in line with a scene that need not be shown anywhere, all of its view layers together.

    Makes what is missing, and exchanges groups of versions before: for operators and scripts, not for handlers.

    Parameters
    ----------
    for_render : take the lamps that a render will show, which the viewport may hide
    """
    make_ready()
    return _follow_scene(scene, for_render)


def make_ready() -> None:
    """Make the file's tables, and give the groups of versions before, which aim at what they were built for, room."""
    lamp_image()
    world_table()
    if not any(_is_fixed(tree) for tree in bpy.data.node_groups):
        return  # as in all files of this version: no look at every node
    own = [tree for tree in bpy.data.node_groups if tree.library is None]
    aiming = [node for tree in own for node in tree.nodes if _is_fixed(getattr(node, "node_tree", None))]
    replaced = {node.node_tree for node in aiming}
    # What nobody has edited stays so.
    own_content = {tree for tree in {node.id_data for node in aiming} if tree.get(HASH_KEY) == content_hash(tree)}
    for node in aiming:
        tables = [n.image for n in node.node_tree.nodes if _is_table(getattr(n, "image", None))]
        exchange_group(node.id_data, node, aimed_light_group(tables[0] if tables else lamp_image()))
    for tree in own_content:
        tree[HASH_KEY] = content_hash(tree)
    for old in replaced:
        if not old.users and old.library is None:
            bpy.data.node_groups.remove(old)


def table_of(report: LampReport) -> np.ndarray:
    """`bake.sampling.lamps.lamp_table` of what is to be aimed at."""
    structure = report.world.structure if report.world.aimed else None
    world = (structure.toward, structure.flux) if structure is not None else None
    return lamp_table(report.lamps, CAPACITY, report.sky, LARGEST_SHARE, world)


def light_table_of(report: LampReport) -> np.ndarray:
    """`bake.sampling.lamp_light.lamp_light_table` of what may be sampled; all dark where that is not known exactly.

    A shader that samples lamps then leaves them to its mirror, whatever it was built for: also between the frames of a
    render, which may change pixels and no nodes.
    """
    return lamp_light_table([] if report.inexact else report.lights, CAPACITY)


def _follow_scene(scene: bpy.types.Scene, for_render: bool) -> LampReport:
    return _follow(survey_scene(scene, for_render=for_render), (scene.session_uid, for_render))


def _follow(report: LampReport, key: tuple[int, Any] | None, viewport: bool = True) -> LampReport:
    shown = seen_world.world_light_table(report)
    if key is not None:
        scene, which = key
        if isinstance(which, str):  # edited since a file was opened or rendered, which looked at all layers together
            for older in (False, True):
                _needs.pop((scene, older), None)
        sampled = 0 if report.inexact else report.slots
        _needs[key] = _Need(report.slots, report.world.aimed, sampled, report.volume, bool(shown[0, 0, 3] > 0))
        fit_slots()
        follow_cameras()
    changed = world_survey.write_world(report.world) if report.world.aimed else []
    table = table_of(report)
    changed += [image for image in _tables() if _write(image, table)]
    lights = light_table_of(report)
    changed += [image for image in _light_tables() if _write(image, lights)]
    changed += [image for image in seen_world.world_light_images() if _write(image, shown)]
    if viewport:
        for image in changed:
            image_reload.for_the_viewport(image)
    return report


def fit_slots() -> None:
    """Let all materials aim at as many lamps as the scene that needs most: windows may show several, in turn."""
    shown = {(s.session_uid, which) for s in bpy.data.scenes for which in (False, True, *s.view_layers.keys())}
    needs = [need for key, need in _needs.items() if key in shown]
    slots, world = max((need.slots for need in needs), default=0), any(need.world for need in needs)
    # Of scenes that need lamps at all: where their light is not known in one, none is sampled in any.
    known = min((need.sampled for need in needs if need.slots), default=0) > 0
    # The world's own table is dark in a scene where that may not be sampled.
    lit = any(need.lit for need in needs)
    if any(is_blended(material) for material in bpy.data.materials):
        slots = min(slots, MOST_LAMPS)
    # As many as the scene with most: nothing aims at what a group could sample and does not.
    sampled = slots if known else 0
    for group in bpy.data.node_groups:
        if can_switch(group):
            rays = can_raycast() or SCRIPTED_KEY in group
            if SAMPLED_KEY in group:
                aim_by(group, sampled * rays, lit and rays)
            elif INSTEAD_KEY in group:
                aim_by(group, 0 if sampled and rays else slots, world and not (lit and rays and group[INSTEAD_KEY]))
            else:
                aim_by(group, slots, world)


def _is_fixed(tree: bpy.types.NodeTree | None) -> bool:
    return tree is not None and SLOTS_KEY in tree and not can_switch(tree)


def _is_table(image: bpy.types.Image | None) -> bool:
    return image is not None and image.name.startswith(TABLE) and tuple(image.size) == (TEXELS, CAPACITY)


def _is_light_table(image: bpy.types.Image) -> bool:
    return image.name.startswith(LIGHT_TABLE) and tuple(image.size) == (LIGHT_TEXELS, CAPACITY)


def _light_tables() -> list[bpy.types.Image]:
    """What lamps emit, by the file's table and those that came along."""
    return [image for image in bpy.data.images if _is_light_table(image)]


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
    if _is_main_thread() and not bpy.app.background and not bpy.app.timers.is_registered(pack_when_at_rest):
        bpy.app.timers.register(pack_when_at_rest, first_interval=_PATIENCE)
    return True


def keep_current(scene: bpy.types.Scene) -> None:
    """Bring the tables in line with the scene as it will be rendered, if some material aims by them."""
    if _in_use() and PROBE not in scene:
        update_scene(scene, for_render=True)


def pack_tables() -> None:
    """Put the tables into the .blend that is about to be saved: only so does it keep the pixels of such images.

    A table that was lost holds zeros, and nothing is aimed by it. (That of the world is packed whenever it is written.)
    """
    for image in (*_tables(), *_light_tables(), *seen_world.world_light_images()):
        if image.is_dirty and image.library is None:
            image.pack()


@events.timer
def pack_when_at_rest() -> float | None:
    """For a timer: pack the tables before Blender asks, as it does at every save from 5.2 on, whether images that the
    artist does not know of are to be saved; seconds to the next try.
    """
    if bpy.app.is_job_running("RENDER"):
        return _PATIENCE
    pack_tables()
    return None


def _in_use() -> bool:
    return any(image.users > 0 for image in _tables())


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@persistent
def _after_an_edit(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if not _in_use():
        _needs.clear()  # nobody looks at the lamps until then
    elif PROBE not in depsgraph.scene:
        known = _needs.get((depsgraph.scene.session_uid, depsgraph.view_layer.name))
        with _tried_again_where_locked():
            if known is None or any(_concerns_lamps(update) for update in depsgraph.updates):
                update_lamps(depsgraph)
            elif any(isinstance(update.id, bpy.types.Material) for update in depsgraph.updates):
                # A material may bring a volume, or take it away.
                if volume_in_file() != known.volume:
                    update_lamps(depsgraph)
                fit_slots()


@contextmanager
def _tried_again_where_locked() -> Iterator[None]:
    """While a thread renders, if only a material's preview, Blender refuses Python to write to nodes."""
    try:
        yield
    except AttributeError as error:
        _raise_unless_refused(error)
        _needs.clear()
        if not bpy.app.timers.is_registered(_try_again):
            bpy.app.timers.register(_try_again, first_interval=_PATIENCE)


def _raise_unless_refused(error: AttributeError) -> None:
    if "not allowed" not in str(error):
        raise error


@events.timer
def _try_again() -> float | None:
    """Look at what the windows show once more; called by a timer, until the writes are allowed."""
    try:
        for window in bpy.context.window_manager.windows:
            depsgraph = window.view_layer.depsgraph
            if depsgraph is not None and _in_use() and PROBE not in window.scene:
                update_lamps(depsgraph)
    except AttributeError as error:
        _raise_unless_refused(error)
        return _PATIENCE
    return None


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
    # thread, and the nodes are evaluated already: none is touched there, but where only that lets Cycles see the
    # table, and then Blender evaluates them once more.
    if _in_use() and PROBE not in depsgraph.scene:
        with _tried_again_where_locked():
            update_lamps(depsgraph, switch=depsgraph.mode == "VIEWPORT" and _is_main_thread())
        if depsgraph.mode == "RENDER" and depsgraph.scene.render.use_persistent_data:
            small = (*_tables(), *_light_tables(), *seen_world.world_light_images())
            for image in (*small, *world_survey.tables()):
                image_reload.for_a_render(depsgraph.scene, image)


@persistent
def _before_a_render(scene: bpy.types.Scene, *_: Any) -> None:
    # The last chance to change nodes, for lamps that only a render shows.
    if _is_main_thread() and _in_use() and PROBE not in scene:
        _follow_scene(scene, for_render=True)


@persistent
def _after_loading(*_: Any) -> None:
    world_survey.distrust_tables()
    image_reload.forget()
    _needs.clear()
    if _in_use():
        update_scene(bpy.context.scene)


@persistent
def _after_importing(*_: Any) -> None:
    # Inside of the operator that appends or links, before its undo step is closed. Tables that came along are those of
    # another file until the next evaluation, which then looks at the lamps.
    _needs.clear()
    if _in_use():
        make_ready()


@persistent
def _after_undo(*_: Any) -> None:
    # What has come back may be older than the tables, and the other way round: the next evaluation looks again.
    world_survey.distrust_tables()
    _needs.clear()


@persistent
def _before_saving(*_: Any) -> None:
    pack_tables()
    follow_cameras()  # another computer may render it, without the extension


_HANDLERS = {
    "depsgraph_update_post": _after_an_edit,
    "frame_change_post": _after_a_frame,
    "render_init": _before_a_render,
    "load_post": _after_loading,
    "blend_import_post": _after_importing,
    "undo_post": _after_undo,
    "redo_post": _after_undo,
    "save_pre": _before_saving,
}


def register() -> None:
    """Called by `addon.register`."""
    events.listen(_HANDLERS)


def unregister() -> None:
    """Called by `addon.unregister`."""
    events.stop_listening(_HANDLERS)
    for timer in (_try_again, pack_when_at_rest):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    _needs.clear()
