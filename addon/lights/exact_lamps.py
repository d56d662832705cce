"""Whether the light of a scene's lamps and world is known so exactly that a shader may sample it (method.md, part 10).

What is not known is left to a mirror, which meets whatever there is: noisier, and right.
"""

from __future__ import annotations

import bpy
from mathutils import Matrix

from ...bake.sampling.lamp_light import EVEN, LampLight, radiance_of, spot_beam, spread_beam
from ...bake.sampling.lamps import Lamp
from ...bake.source import Array, luminance
from ...nodes import compat
from .motion import changes

_BOUNCES = 1024
_LEAST_SPREAD = 0.02
_EVEN_SCALE = 1e-3


def emitted_light(lamp: Lamp, colour: Array, data: bpy.types.Light, rays: int) -> LampLight:
    """What a lamp emits, by its plain settings.

    Parameters
    ----------
    lamp : with its power towards its axis
    colour : (3,) of luminance above 0, to which the power is in proportion
    rays : of `rays_of_lamp`
    """
    whole = float(luminance(colour))
    bright = radiance_of(lamp) / whole if whole > 0 else 0.0
    facing, beam = False, (float(EVEN), 0.0, 0.0)
    if data.type in {"POINT", "SPOT"}:
        facing = bool(getattr(data, "use_soft_falloff", False))
    if data.type == "SPOT":
        beam = spot_beam(data.spot_size, data.spot_blend)
    elif data.type == "AREA":
        beam = spread_beam(data.spread)
    red, green, blue = (float(bright * c) for c in colour)
    return LampLight((red, green, blue), facing, beam, rays)


def rays_of_lamp(*shown: bpy.types.Object) -> int:
    """Which rays meet a lamp besides those of mirrors, as `LampLight` has it: those that meet its instancer too."""
    names = "visible_camera", "visible_diffuse", "visible_transmission"
    camera, diffuse, transmission = (all(getattr(obj, name) for obj in shown) for name in names)
    return camera + 2 * diffuse + 4 * transmission


def rays_of_world(scene: bpy.types.Scene) -> int:
    """The same of a scene's world; where the film is transparent, the camera's do not."""
    if scene.world is None:
        return 0
    seen = scene.world.cycles_visibility
    return (seen.camera and not scene.render.film_transparent) + 2 * seen.diffuse + 4 * seen.transmission


def why_not_exact(obj: bpy.types.Object, matrix: Matrix) -> str:
    """Why a lamp's light is not known exactly; empty if it is.

    Parameters
    ----------
    matrix : of the object or its instance, in the world
    """
    data = obj.data
    if compat.uses_nodes(data) and not _is_plain(data.node_tree):
        return "its nodes are more than a plain Emission"
    if not data.use_shadow:
        return "it casts no shadows"
    if obj.lightgroup:
        return f"its light goes to light group {obj.lightgroup}"
    linking = obj.light_linking
    if linking.receiver_collection is not None or linking.blocker_collection is not None:
        return "Light Linking or Shadow Linking singles out objects"
    if data.cycles.max_bounces < _BOUNCES:
        return "its light ends after some bounces"
    if data.type == "AREA" and data.spread < _LEAST_SPREAD:
        return "its beam is all but parallel"
    if data.type == "SPOT":
        scales = [column.length for column in matrix.to_3x3().col]
        if max(scales) - min(scales) > _EVEN_SCALE * max(scales):
            return "its cone is scaled unevenly"
    return ""


def why_world_not_exact(scene: bpy.types.Scene) -> str:
    """Why the light of a world of one picture is not known exactly to a shader; empty if it is, or there is none."""
    if (world := scene.world) is None:
        return ""
    if scene.render.film_transparent and scene.cycles.film_transparent_glass:
        # From whatever has come through glass before; no shader knows that of its ray.
        return "Transparent Glass of the film hides the world from what comes through a sheet"
    if world.lightgroup:
        return f"the world's light goes to light group {world.lightgroup}"
    if world.cycles.max_bounces < _BOUNCES:
        return "the world's light ends after some bounces"
    return "the world is animated" if changes(world) else ""


def why_not_in(scene: bpy.types.Scene, volume: str) -> str:
    """Why no lamp of a scene may be sampled; empty if lamps themselves decide. `volume` is `volume_in_file`'s."""
    if scene.cycles.blur_glossy > 0:
        # Cycles blurs the mirror after a diffuse bounce, and then samples lamps for it too.
        return "Filter Glossy of the scene is above 0"
    render = scene.render
    if render.use_motion_blur and render.motion_blur_position != "CENTER" and (lamp := _moved_in(scene)):
        # Cycles blurs no lamp. It has it where it is half way through the shutter: not at the frame, as the table.
        return f"Motion Blur is not centred on the frame, and {lamp} may move"
    return volume


def _moved_in(scene: bpy.types.Scene) -> str:
    """The first lamp, or instancer that may show one, that may be another in another frame; empty if there is none."""
    for obj in scene.objects:
        if (obj.type == "LIGHT" and (changes(obj) or changes(obj.data))) or (obj.is_instancer and changes(obj)):
            return str(obj.name)
    return ""


def volume_in_file() -> str:
    """The first volume in words, empty if there is none: a ray that asks what it meets passes through volumes."""
    for kind, blocks in (("world", bpy.data.worlds), ("material", bpy.data.materials)):
        for block in blocks:
            if block.users and compat.uses_nodes(block) and has_volume(block.node_tree):
                return f"a volume in {kind} {block.name}"
    return next((f"volume {block.name}" for block in bpy.data.volumes if block.users), "")


def has_volume(tree: bpy.types.NodeTree) -> bool:
    """Whether what a node tree shows in Cycles has a volume."""
    output = tree.get_output_node("CYCLES")
    return output is not None and "Volume" in output.inputs and output.inputs["Volume"].is_linked


def _is_plain(tree: bpy.types.NodeTree) -> bool:
    output = tree.get_output_node("CYCLES")
    if output is None or not output.inputs["Surface"].is_linked:
        return True  # and dark
    node = output.inputs["Surface"].links[0].from_node
    if node.bl_idname != "ShaderNodeEmission" or node.mute:
        return False
    return not any(socket.is_linked for socket in (node.inputs["Color"], node.inputs["Strength"]))
