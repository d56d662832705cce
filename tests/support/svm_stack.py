"""How near a material comes to the limits of Cycles' SVM: 255 floats of stack, 64 closures.

No version of Blender reports how much of the stack a material takes, so it is probed: the material is rendered while
more floats are kept alive all through it, and a shader that does not fit is black. The most that fit are the room left.
On 4.5, where the environment variables GLOG_v=3 and GLOG_logtostderr=1 print the peak of every shader that is compiled,
peak and room make 252 to 255.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
from measured_materials.addon.lights.world_survey import PROBE
from measured_materials.addon.rendering.renderer import set_unbiased
from measured_materials.addon.studio import studio
from measured_materials.nodes import compat, expr
from measured_materials.nodes.aimed_light_group import MAX_SLOTS, aim_by, can_switch
from measured_materials.nodes.feature_passes import store_feature_passes
from measured_materials.nodes.group import call, node_group

CLOSURES = 64
_VECTORS = 84  # of three floats: nearly the whole stack


def fits_with(material: bpy.types.Material, more: int) -> bool:
    """Whether the material compiles with so many floats more, a multiple of 3, live all through it."""
    with _probe(material, more // 3) as compiles:
        return compiles(more // 3)


def room_on_stack(material: bpy.types.Material) -> int:
    """Floats that could be live all through the material besides its own, in steps of 3; -3 if it does not compile."""
    with _probe(material, _VECTORS) as compiles:
        fits, fails = -1, _VECTORS + 1
        while fails - fits > 1:
            middle = (fits + fails) // 2
            fits, fails = (middle, fails) if compiles(middle) else (fits, middle)
        return 3 * fits


def closures_in(material: bpy.types.Material) -> int:
    """Closure nodes that reach Cycles' output; an upper bound of those that one shading point holds."""
    return _closures_before(_cycles_output(material).inputs["Surface"], [])


def aim_at_everything() -> None:
    """Let all materials aim at as many lamps as are ever aimed at, and at a world; the tables' content is no matter."""
    for group in filter(can_switch, bpy.data.node_groups):
        aim_by(group, MAX_SLOTS, world=True)


@contextmanager
def _probe(material: bpy.types.Material, most: int) -> Iterator[Any]:
    """A function that reports whether a copy of the material compiles with so many vectors live besides, or `most`."""
    scene, card = _card_scene()
    copy = material.copy()
    group = _keep_alive(copy, most)
    card.materials.append(copy)

    def compiles(vectors: int) -> bool:
        _let_live(group, vectors)
        return bool(studio.render_linear(scene).max() > 0)

    try:
        yield compiles
    finally:
        owned = [obj.data for obj in scene.objects]
        bpy.data.batch_remove([*scene.objects, *owned, copy, group])
        bpy.data.scenes.remove(scene)


def _keep_alive(material: bpy.types.Material, vectors: int) -> bpy.types.ShaderNodeTree:
    """Let the material shine by a colour computed before its closures and another after; returns the colours' group.

    Closures that are added are compiled one after the other, each with what it alone needs, and a float stays on the
    stack until its last use: what both colours are made of is live in between.
    """
    group = node_group("Live Floats", {}, {"Before": "vector", "After": "vector"}, lambda: _two_chains(vectors))
    surface = _cycles_output(material).inputs["Surface"]
    own = expr.Scalar(surface.links[0].from_socket)
    with expr.building(compat.node_tree(material)) as tree:
        before, after = (_emission(colour + expr.vec(1.0, 1.0, 1.0)) for colour in call(group))
        expr.feed(tree, surface, _add(before, _add(own, after)))
    return group


def _two_chains(vectors: int) -> tuple[Any, Any]:
    """The largest of many vectors, found twice; `_let_live` shortens the chains by the names of their nodes."""
    expr.need_tree()  # nodes get names here
    position = expr.Vector(expr.node("ShaderNodeNewGeometry", {}, {}).outputs["Position"])
    live = [expr.scale(position, k + 1.5) for k in range(vectors)]
    ends = []
    for name, least in (("Before", 1.0), ("After", 2.0)):
        largest = expr.vec(least, least, least)
        for k, vector in enumerate(live, 1):
            largest = expr.vector_node("MAXIMUM", largest, vector)
            largest.socket.node.name = f"{name} {k}"
        ends.append(largest)
    return ends[0], ends[1]


def _let_live(group: bpy.types.ShaderNodeTree, count: int) -> None:
    """Let only so many of the vectors count."""
    output = next(n for n in group.nodes if n.bl_idname == "NodeGroupOutput")
    for name in ("Before", "After"):
        for link in list(output.inputs[name].links):
            group.links.remove(link)
        if count:
            group.links.new(group.nodes[f"{name} {count}"].outputs[0], output.inputs[name])


def _emission(colour: Any) -> Any:
    return expr.Scalar(expr.node("ShaderNodeEmission", {}, {"Color": colour}).outputs[0])


def _add(first: Any, second: Any) -> Any:
    return expr.Scalar(expr.node("ShaderNodeAddShader", {}, {0: first, 1: second}).outputs[0])


def _card_scene() -> tuple[bpy.types.Scene, bpy.types.Mesh]:
    """A plane that fills a picture of 2 x 2 pixels, and the passes for a denoiser."""
    compat.ensure_cycles()
    scene = bpy.data.scenes.new("probe")
    mesh = bpy.data.meshes.new("probe")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new()
    _place(scene, mesh, (0, 0, 0))
    scene.camera = _place(scene, bpy.data.cameras.new("probe"), (0, 0, 0.5))
    _place(scene, bpy.data.lights.new("probe", "POINT"), (0, 0, 3))
    scene[PROBE] = True  # the graph stays as it is, however few lamps are here
    scene.render.resolution_x = scene.render.resolution_y = 2
    store_feature_passes(scene.view_layers[0])
    set_unbiased(scene, samples=1, seed=0)
    return scene, mesh


def _place(scene: bpy.types.Scene, data: Any, location: tuple[float, float, float]) -> bpy.types.Object:
    obj = bpy.data.objects.new(data.name, data)
    obj.location = location
    scene.collection.objects.link(obj)
    return obj


def _cycles_output(material: bpy.types.Material) -> bpy.types.Node:
    outputs = [n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial"]
    return next(n for n in outputs if n.target != "EEVEE")


def _closures_before(socket: Any, groups: list[bpy.types.Node]) -> int:
    """Closure nodes upstream of a shader socket inside these group nodes, the outermost first."""
    if not socket.links:
        return 0
    source = socket.links[0].from_socket
    node = source.node
    if node.bl_idname == "NodeGroupInput":
        return _closures_before(groups[-1].inputs[source.identifier], groups[:-1])
    if node.bl_idname == "ShaderNodeGroup":
        inner = next(n for n in node.node_tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output)
        return _closures_before(next(s for s in inner.inputs if s.identifier == source.identifier), [*groups, node])
    if node.bl_idname in ("ShaderNodeAddShader", "ShaderNodeMixShader"):
        return sum(_closures_before(s, groups) for s in node.inputs if s.type == "SHADER")
    return 1
