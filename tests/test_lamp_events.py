"""Each event of Blender with each kind of edit: the tables are those of a scene that was just opened.

And handlers, which Blender calls after it has closed its undo step, make, remove and link no datablock: one that they
did such a thing to was a crash at the next undo (4.3, 5.2; `./run test --ui` edits in a real window).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.lights import light_tables
from measured_materials.addon.lights.light_tables import lamp_image, survey, table_of
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.nodes import compat
from measured_materials.nodes.aimed_light_group import (
    MAX_SLOTS,
    SLOTS_KEY,
    WORLD_KEY,
    aim_by,
    aimed_light_group,
    can_switch,
)
from measured_materials.nodes.group import (
    FAMILY_KEY,
    HASH_KEY,
    SWITCHED_KEY,
    active_output,
    content_hash,
    nodes_before,
)
from measured_materials.nodes.shading_map_material import build_shading_map
from support.lamp_edits import EDITS, add, four_more, grey_world, lamp, spot_world
from support.swatches import identity_map, map_bundle


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[bpy.types.Scene]:
    """In the window, because only what it shows is undone: a ball of mirrors, and a lamp."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    compat.ensure_cycles()
    mesh = bpy.data.meshes.new("ball")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [], [(0, 1, 2)])
    ball = bpy.data.objects.new("ball", mesh)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.collection.objects.link(ball)
    bundle = map_bundle(tmp_path / "grey", identity_map(), RenderSettings(sigma=0.5, mode="reference"))
    mesh.materials.append(build_shading_map(bundle, lamps=lamp_image()))
    add(scene, "POINT", (0, -1, 3))
    sky = np.full((16, 32, 3), 0.1, np.float32)
    sky[3, 7] = 900
    write_image(tmp_path / "spot.exr", sky, Storage.FLOAT32)
    scene["sky"] = str(tmp_path / "spot.exr")
    light_tables.register()
    scene.view_layers[0].update()
    bpy.ops.ed.undo_push(message="Start")
    yield scene
    light_tables.unregister()
    bpy.ops.wm.read_factory_settings(use_empty=False)


# --- events: each lets Blender call the handlers -----------------------------------------------------------


def evaluated(scene: bpy.types.Scene, edit: Callable[[bpy.types.Scene], object], _: Path) -> bpy.types.Scene:
    edit(scene)
    untouched(lambda: scene.view_layers[0].update())
    return scene


def undone(scene: bpy.types.Scene, edit: Callable[[bpy.types.Scene], object], folder: Path) -> bpy.types.Scene:
    before = written()
    bpy.ops.ed.undo_push(message="Before")
    evaluated(scene, edit, folder)
    bpy.ops.ed.undo_push(message="Edit")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    scene.view_layers[0].update()
    assert np.array_equal(written(), before)
    return scene


def redone(scene: bpy.types.Scene, edit: Callable[[bpy.types.Scene], object], folder: Path) -> bpy.types.Scene:
    evaluated(scene, edit, folder)
    after = written()
    bpy.ops.ed.undo_push(message="Edit")
    bpy.ops.ed.undo()
    bpy.context.scene.view_layers[0].update()
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    scene.view_layers[0].update()
    assert np.array_equal(written(), after)
    return scene


def loaded(scene: bpy.types.Scene, edit: Callable[[bpy.types.Scene], object], folder: Path) -> bpy.types.Scene:
    """A file that was saved by a Blender without the extension."""
    light_tables.unregister()
    edit(scene)
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "edited.blend"))
    finally:
        light_tables.register()
    bpy.ops.wm.open_mainfile(filepath=str(folder / "edited.blend"))
    return bpy.context.scene


def framed(scene: bpy.types.Scene, edit: Callable[[bpy.types.Scene], object], _: Path) -> bpy.types.Scene:
    edit(scene)
    scene.frame_set(2)
    scene.view_layers[0].update()
    return scene


def rendered(scene: bpy.types.Scene, edit: Callable[[bpy.types.Scene], object], _: Path) -> bpy.types.Scene:
    """What the table holds when the render is done: lamps that the render shows, and groups for them."""
    edit(scene)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera, scene.cycles.samples = camera, 1
    scene.render.resolution_x = scene.render.resolution_y = 4
    bpy.ops.render.render()
    return scene


EVENTS = {f.__name__: f for f in (evaluated, undone, redone, loaded, framed, rendered)}
# What every event is tried with; the handler looks at the edit itself only after an evaluation.
SOME = ("add point", "dim", "another type", "spotted world", "instance", "hide", "delete", "add four")


def written() -> np.ndarray:
    """The file's table of lamps, row 0 first."""
    image = lamp_image()
    pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(image.size[1], image.size[0], 4)[::-1]


def untouched(action: Callable[[], object]) -> None:
    """The action makes, removes and links no datablock."""
    before = datablocks()
    action()
    assert datablocks() == before


def datablocks() -> dict[tuple[str, int], list[Any]]:
    """All of the kinds that materials are made of, each with those that its nodes refer to."""
    found: dict[tuple[str, int], list[Any]] = {}
    for name in ("materials", "node_groups", "images", "worlds", "lights", "objects", "scenes", "texts"):
        for block in getattr(bpy.data, name):
            tree = block if name == "node_groups" else getattr(block, "node_tree", None)
            nodes = tree.nodes if tree else ()
            refers = [getattr(n, kind, None) for n in nodes for kind in ("node_tree", "image")]
            found[name, block.session_uid] = [other and (other.name, other.session_uid) for other in refers]
    return found


@pytest.mark.parametrize("event", EVENTS)
def test_after_each_event_the_tables_are_those_of_a_fresh_start(
    scene: bpy.types.Scene, tmp_path: Path, event: str
) -> None:
    for name in EDITS if event == "evaluated" else SOME:
        if not any(obj.type == "LIGHT" for obj in scene.collection.objects):
            add(scene, "POINT", (0, -1, 3))
        scene = EVENTS[event](scene, EDITS[name], tmp_path)
        report = survey(scene.view_layers[0].depsgraph, for_render=event == "rendered")
        assert np.array_equal(written(), table_of(report)), name
        groups = [tree for tree in bpy.data.node_groups if can_switch(tree)]
        assert groups, name
        for group in groups:
            assert (group[SLOTS_KEY], group[WORLD_KEY]) == (report.slots, report.world.aimed), name
            chosen = active_output(group)
            assert (chosen[SLOTS_KEY], chosen[WORLD_KEY]) == (report.slots, report.world.aimed), name
        if report.world.aimed:
            assert np.array(bpy.data.images["MM World"].pixels[:]).any(), name


@pytest.mark.parametrize("event", ["loaded", "rendered", "evaluated"])
def test_what_an_edit_takes_away_is_not_kept_for_an_earlier_event(
    scene: bpy.types.Scene, tmp_path: Path, event: str
) -> None:
    """A render, a loaded file and a view layer that is gone needed more than the scene does now."""
    scene = EVENTS[event](scene, lambda s: (four_more(s), spot_world(s)), tmp_path)
    if event == "evaluated":
        scene.view_layers[0].name = "renamed"
    for obj in [obj for obj in scene.objects if obj.type == "LIGHT"][1:]:
        bpy.data.objects.remove(obj)
    grey_world(scene)
    scene.view_layers[0].update()
    wanted = [(tree[SLOTS_KEY], tree[WORLD_KEY]) for tree in bpy.data.node_groups if can_switch(tree)]
    assert wanted == [(1, False)]


def test_undo_of_a_lamp_and_redo_keep_every_datablock(scene: bpy.types.Scene) -> None:
    """The edit that crashed: the group of one lamp had gone when undo asked for it."""
    known = {key for key in datablocks() if key[0] == "node_groups"}
    for _ in range(3):
        add(scene, "AREA", (1, 1, 2))
        bpy.ops.ed.undo_push(message="Add Light")
        untouched(lambda: bpy.context.scene.view_layers[0].update())
        for step in (bpy.ops.ed.undo, bpy.ops.ed.redo, bpy.ops.ed.undo):
            step()
            scene = bpy.context.scene
            untouched(lambda: bpy.context.scene.view_layers[0].update())
            assert {key for key in datablocks() if key[0] == "node_groups"} == known


def test_a_render_aims_at_lamps_that_only_it_shows(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Looked at while it renders: the next edit is again about the viewport."""
    lamp(scene).hide_viewport = True
    scene.view_layers[0].update()
    assert [tree[SLOTS_KEY] for tree in bpy.data.node_groups if can_switch(tree)] == [0]
    seen = []

    def look(*_: Any) -> None:
        slots = [active_output(tree)[SLOTS_KEY] for tree in bpy.data.node_groups if can_switch(tree)]
        seen.append((slots, bool(written()[0, 1, 3] > 0)))

    bpy.app.handlers.render_post.append(look)
    try:
        rendered(scene, lambda _: None, tmp_path)
    finally:
        bpy.app.handlers.render_post.remove(look)
    assert seen == [([1], True)]


def test_writes_that_blender_refuses_are_tried_again(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """As it does while a thread renders a preview; here the writes of two attempts."""
    refused = iter((True, True))

    def refuse(*arguments: Any) -> None:
        if next(refused, False):
            raise AttributeError("Writing to ID classes in this context is not allowed: MM Aim, NodeTree datablock")
        aim_by(*arguments)

    monkeypatch.setattr(light_tables, "aim_by", refuse)
    add(scene, "AREA", (1, 1, 2))
    scene.view_layers[0].update()
    assert bpy.app.timers.is_registered(light_tables._try_again)
    assert light_tables._try_again() == light_tables._PATIENCE
    assert light_tables._try_again() is None
    assert [tree[SLOTS_KEY] for tree in bpy.data.node_groups if can_switch(tree)] == [2]
    assert np.array_equal(written(), table_of(survey(scene.view_layers[0].depsgraph)))


@pytest.mark.parametrize("step", ["undo", "redo"])
def test_undo_and_redo_trust_no_pixels(scene: bpy.types.Scene, step: str) -> None:
    """Either may part an image from what its properties say: draws by a table of zeros would be wrong."""
    spot_world(scene)
    scene.view_layers[0].update()
    bpy.ops.ed.undo_push(message="World")
    image = bpy.data.images["MM World"]
    kept = np.array(image.pixels[:])
    lamp(scene).location.x += 1
    scene.view_layers[0].update()
    bpy.ops.ed.undo_push(message="Move")
    if step == "redo":
        bpy.ops.ed.undo()
        bpy.context.scene.view_layers[0].update()
    image = bpy.data.images["MM World"]
    image.pixels.foreach_set(np.zeros_like(kept, np.float32))
    getattr(bpy.ops.ed, step)()
    spot = bpy.context.scene
    spot.view_layers[0].update()
    assert np.array_equal(bpy.data.images["MM World"].pixels[:], kept)


# --- the group ---------------------------------------------------------------------------------------------


def test_one_group_has_room_and_is_known_however_it_is_switched(scene: bpy.types.Scene) -> None:
    group = aimed_light_group(lamp_image())
    for slots in range(MAX_SLOTS + 1):
        for world in (False, True):
            aim_by(group, slots, world)
            assert content_hash(group) == group[HASH_KEY] and aimed_light_group(lamp_image()) == group
            needed = nodes_before(active_output(group))
            assert all(node.mute == (node not in needed) for node in group.nodes if hasattr(node, "node_tree"))
    inner = next(n.node_tree for n in group.nodes if n.bl_idname == "ShaderNodeGroup")
    next(n for n in inner.nodes if n.bl_idname == "ShaderNodeMath").operation = "WRAP"
    assert aimed_light_group(lamp_image()) != group  # an artist's now


def old_group() -> bpy.types.ShaderNodeTree:
    """As versions before made it: without room, known by its slots."""
    group = aimed_light_group(lamp_image()).copy()
    for node in [n for n in group.nodes if n.bl_idname == "NodeGroupOutput" and not n.is_active_output]:
        group.nodes.remove(node)
    del group[SWITCHED_KEY]
    group[FAMILY_KEY] = f"MM Aim by {lamp_image().name_full}"
    group[HASH_KEY] = content_hash(group)
    return group


def exchange_all(old: bpy.types.ShaderNodeTree) -> int:
    """Put it in the place of every group that aims."""
    nodes = [n for t in bpy.data.node_groups for n in t.nodes if can_switch(getattr(n, "node_tree", None) or {})]
    for node in nodes:
        node.node_tree = old
    for tree in [tree for tree in bpy.data.node_groups if HASH_KEY in tree]:
        tree[HASH_KEY] = content_hash(tree)
    return len(nodes)


def test_files_of_versions_before_get_room_when_they_are_opened(scene: bpy.types.Scene, tmp_path: Path) -> None:
    assert exchange_all(old_group()) == 1
    add(scene, "POINT", (1, 1, 3))
    untouched(lambda: scene.view_layers[0].update())
    light_tables.unregister()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "old.blend"))
    light_tables.register()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "old.blend"))
    aiming = [tree for tree in bpy.data.node_groups if SLOTS_KEY in tree and tree.users]
    assert aiming and all(can_switch(tree) and tree[SLOTS_KEY] == 2 for tree in aiming)
    # Nothing of it was edited manually, and nothing says so.
    assert all(tree[HASH_KEY] == content_hash(tree) for tree in bpy.data.node_groups if HASH_KEY in tree)


def test_materials_of_versions_before_get_room_when_they_are_appended(scene: bpy.types.Scene, tmp_path: Path) -> None:
    exchange_all(old_group())
    bpy.data.materials[0].use_fake_user = True
    name = bpy.data.materials[0].name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "old.blend"), copy=True)
    light_tables.unregister()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    light_tables.register()
    folder = str(tmp_path / "old.blend" / "Material")
    bpy.ops.wm.append(filepath=str(Path(folder, name)), directory=folder, filename=name)
    aiming = [tree for tree in bpy.data.node_groups if SLOTS_KEY in tree and tree.users]
    assert aiming and all(map(can_switch, aiming))
