"""The light of a scene's world, read or rendered, for measured materials to aim at (method.md, section 10).

An image of the surroundings is read directly, however it is turned. Any other world of nodes (a sky, a mixture) is
rendered small, when somebody asks for it: `measure_world`. A world that has changed since is not aimed at; if a table
were out of date all the same, that would cost noise and never bias.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Matrix

from ...bake.sampling.world import COLUMNS, ROWS, WorldStructure, cell_light, world_structure, world_texels
from ...bake.source import Array, luminance
from ...nodes import compat
from ...nodes.group import content_hash
from ...nodes.light_images import WORLD as IMAGE
from ...nodes.light_images import world_tables as tables
from ..rendering.renderer import render_pixels, set_unbiased

# Custom property of a scene that exists to be measured by: tables do not follow it.
PROBE = "measured_materials_probe"
_KEY, _FACTS, _SUM = "measured_materials_key", "measured_materials_facts", "measured_materials_sum"
_REMEMBERED = 4
# An image as large as 8192 x 4096 takes 512 MB to be read; a larger one is rendered.
_LARGEST = 1 << 25
_SUB_SAMPLES, _WIDTH = 16, 1024


@dataclass(frozen=True)
class WorldPicture:
    """A picture: its image's session_uid, rows of what turns the world's directions to its own, and its strength."""

    image: int
    interpolation: str
    rows: tuple[tuple[float, ...], ...]
    strength: float


@dataclass(frozen=True)
class WorldLight:
    """A world as far as it is known.

    Parameters
    ----------
    irradiance : that it gives to a surface, about
    structure : what stands out of its mean; None for an even world and for one that is not known
    key : what the table to aim by is known by
    measured : it took a rendering to know it, which its file had better keep
    why_not : reason why it is not aimed at; empty if it is
    picture : all of its light, where it is one picture
    """

    irradiance: float
    structure: WorldStructure | None = None
    key: str = ""
    measured: bool = False
    why_not: str = ""
    picture: WorldPicture | None = None

    @property
    def aimed(self) -> bool:
        """Whether it is worth to aim at it."""
        return not self.why_not


@dataclass(frozen=True)
class _Picture:
    """Radiance (H, W, 3) on demand, which is turned to the world and scaled; the key distinguishes what differs."""

    key: str
    read: Callable[[], Array]
    to_world: Matrix
    strength: float
    seen: WorldPicture


_known: dict[str, tuple[WorldStructure, Array]] = {}
# Images whose pixels are those that their properties describe.
_trusted: set[int] = set()


def world_light(world: bpy.types.World | None) -> WorldLight:
    """The light of a world, as far as it is known. An image is read where it has not been yet; nothing is rendered."""
    if world is None:
        return WorldLight(0.0, why_not="there is no world")
    if not world.cycles_visibility.glossy:
        return WorldLight(0.0, why_not="the world is hidden from glossy rays")
    surface = _surface(world)
    if surface is None:
        return WorldLight(0.0 if _tree(world) else math.pi * _luminance(world.color), why_not="the world is even")
    plain = _plain_background(surface)
    if plain is not None:
        return WorldLight(math.pi * plain, why_not="the world is even")
    picture = _picture(surface)
    key = picture.key if picture else content_hash(_tree(world))
    structure = _structure(key)
    if structure is None and picture is not None:
        structure = _remember(key, picture.read(), picture.to_world)
    if structure is None:
        return WorldLight(math.pi * _guess(world), why_not="the world's nodes are not known: measure the world")
    structure = _scaled(structure, picture.strength if picture else 1.0)
    irradiance = structure.background + structure.flux / 4
    why_not = "" if structure.pays else _why_not_worth_it(structure)
    return WorldLight(irradiance, structure, key, picture is None, why_not, picture.seen if picture else None)


def measure_world(scene: bpy.types.Scene) -> WorldLight:
    """`world_light` of a scene's world, looked at afresh: its image is read again, its nodes are rendered.

    Takes about two seconds, and replaces what Blender shows as the render result. Not for handlers.
    """
    world = scene.world
    surface = _surface(world) if world is not None else None
    if surface is not None and _plain_background(surface) is None:
        picture = _picture(surface)
        key = picture.key if picture else content_hash(_tree(world))
        read = picture.read if picture else lambda: _rendered(world)
        _remember(key, read(), picture.to_world if picture else Matrix.Identity(3))
        for image in tables():
            image[_KEY] = ""  # so that it is written again
    return world_light(world)


def write_world(light: WorldLight) -> list[bpy.types.Image]:
    """Write the tables of a world that is aimed at, where they are of another one; returns those."""
    source, written = None, []
    for image in tables():
        if image.library is None:
            image.use_fake_user = light.measured  # even while another scene is shown
        if image.get(_KEY) == light.key and _intact(image):
            continue
        source = source or _table_of(light.key)
        if source is None:
            continue
        texels, facts = source
        image.pixels.foreach_set(texels)
        image.update()
        if image.library is None:
            # At once, not when the file is saved: undo would bring the image back without its pixels, and draws by a
            # table of zeros would be wrong.
            image.pack()
        image[_KEY], image[_FACTS] = light.key, facts
        image[_SUM] = _checksum(image)
        _trusted.add(image.session_uid)
        written.append(image)
    return written


def _table_of(key: str) -> tuple[Array, str] | None:
    """Texels of a world's table in Blender's order, and its facts: as remembered, or as the .blend was saved with."""
    if key in _known:
        structure, weights = _known[key]
        return world_texels(weights).ravel(), json.dumps(asdict(structure))
    image = _saved(key)
    return (_pixels(image), str(image[_FACTS])) if image is not None else None


def distrust_tables() -> None:
    """Look at the pixels before believing what an image says of them: loading and undoing may part the two."""
    _trusted.clear()


def _intact(image: bpy.types.Image) -> bool:
    if image.session_uid not in _trusted and _checksum(image) == image.get(_SUM):
        _trusted.add(image.session_uid)
    return image.session_uid in _trusted


def _checksum(image: bpy.types.Image) -> str:
    return hashlib.sha256(_pixels(image).tobytes()).hexdigest()


def _pixels(image: bpy.types.Image) -> Array:
    pixels = np.empty(COLUMNS * ROWS * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels


def _saved(key: str) -> bpy.types.Image | None:
    """The file's own table, if it is of that world."""
    image = bpy.data.images.get((IMAGE, None))
    return image if image is not None and image.get(_KEY) == key and _intact(image) else None


def _structure(key: str) -> WorldStructure | None:
    if key in _known:
        return _known[key][0]
    image = _saved(key)
    if image is None:
        return None
    # The .blend was saved with its table: what has been rendered need not be rendered again.
    with contextlib.suppress(ValueError, TypeError, KeyError, AttributeError):
        facts = json.loads(image[_FACTS])
        return WorldStructure(**facts | {"toward": tuple(facts["toward"])})
    return None


def _remember(key: str, radiance: Array, to_world: Matrix) -> WorldStructure:
    _known.pop(key, None)
    while len(_known) >= _REMEMBERED:
        del _known[next(iter(_known))]
    _known[key] = world_structure(cell_light(radiance, np.array(to_world)))
    return _known[key][0]


def _scaled(structure: WorldStructure, strength: float) -> WorldStructure:
    x, y, z = structure.toward
    return replace(
        structure,
        flux=structure.flux * strength,
        toward=(x * strength, y * strength, z * strength),
        background=structure.background * strength,
    )


def _why_not_worth_it(structure: WorldStructure) -> str:
    if structure.flux == 0:
        return "the world is even"
    return (
        f"the world is nearly even: aiming at it would change a noise of {structure.unaimed:.2f} a sample "
        f"to {structure.aimed:.2f}"
    )


# --- worlds of an image or a colour ----------------------------------------------------------------------


def _tree(world: bpy.types.World) -> bpy.types.NodeTree | None:
    return world.node_tree if compat.uses_nodes(world) else None


def _surface(world: bpy.types.World) -> bpy.types.NodeSocket | None:
    """The socket that gives the world its light."""
    tree = _tree(world)
    output = tree.get_output_node("CYCLES") if tree else None
    return _source(output.inputs["Surface"]) if output else None


def _source(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """Where a socket's value comes from, None where it has its own."""
    while socket.is_linked:
        found = socket.links[0].from_socket
        if found.node.bl_idname != "NodeReroute":
            return found
        socket = found.node.inputs[0]
    return None


def _background(surface: bpy.types.NodeSocket) -> tuple[Any, float] | None:
    """Colour socket and strength of a Background node that is the whole world."""
    node = surface.node
    if node.bl_idname != "ShaderNodeBackground" or node.mute or _source(node.inputs["Strength"]) is not None:
        return None
    return node.inputs["Color"], max(float(node.inputs["Strength"].default_value), 0.0)


def _plain_background(surface: bpy.types.NodeSocket) -> float | None:
    """Luminance of a world of one colour."""
    found = _background(surface)
    if found is None or _source(found[0]) is not None:
        return None
    return _luminance(found[0].default_value) * found[1]


def _picture(surface: bpy.types.NodeSocket) -> _Picture | None:
    """A world that is one equirectangular image, turned and scaled; None for all others."""
    found = _background(surface)
    if found is None:
        return None
    colour, strength = found
    source = _source(colour)
    texture = None if source is None else source.node
    if texture is None or texture.bl_idname != "ShaderNodeTexEnvironment" or texture.mute:
        return None
    image, mapping, colours = texture.image, texture.texture_mapping, texture.color_mapping
    usual = (colours.brightness, colours.contrast, colours.saturation, colours.blend_factor) == (1, 1, 1, 0)
    turned = any(mapping.rotation) or any(mapping.translation) or tuple(mapping.scale) != (1, 1, 1)
    if image is None or texture.projection != "EQUIRECTANGULAR" or turned or not usual or colours.use_color_ramp:
        return None
    size = tuple(image.size)
    if image.source not in ("FILE", "GENERATED") or image.type == "MULTILAYER" or not 0 < size[0] * size[1] <= _LARGEST:
        return None
    matrix = _to_picture(_source(texture.inputs["Vector"]))
    if matrix is None:
        return None
    file = Path(bpy.path.abspath(image.filepath, library=image.library)) if image.filepath else None
    changed = file.stat().st_mtime_ns if file and file.is_file() else 0
    about = (image.name_full, image.session_uid, str(file), changed, size, image.colorspace_settings.name)
    key = json.dumps([*about, [[round(x, 6) for x in row] for row in matrix]])
    seen = WorldPicture(image.session_uid, texture.interpolation, tuple(map(tuple, matrix)), strength)
    return _Picture(key, lambda: _radiance(image), matrix.transposed(), strength, seen)


def _to_picture(vector: bpy.types.NodeSocket | None) -> Matrix | None:
    """Rotation or reflection from directions of the world to those of its image; None for any other mapping."""
    if vector is None or _is_direction(vector):
        return Matrix.Identity(3)
    node = vector.node
    names = [name for name in ("Location", "Rotation", "Scale") if name in node.inputs and node.inputs[name].enabled]
    if node.bl_idname != "ShaderNodeMapping" or node.mute or any(_source(node.inputs[name]) for name in names):
        return None
    source = _source(node.inputs["Vector"])
    values = {name: tuple(node.inputs[name].default_value) for name in names}
    scale = values["Scale"]
    size = abs(scale[0])
    even = size > 0 and all(abs(abs(s) - size) < 1e-4 * size for s in scale)
    if source is None or not _is_direction(source) or any(values.get("Location", ())) or not even:
        return None
    rotation = Euler(values["Rotation"]).to_matrix()
    signs = Matrix.Diagonal([math.copysign(1.0, s) for s in scale])
    return signs @ rotation.transposed() if node.vector_type == "TEXTURE" else rotation @ signs


def _is_direction(socket: bpy.types.NodeSocket) -> bool:
    return socket.node.bl_idname == "ShaderNodeTexCoord" and socket.name == "Generated" and not socket.node.mute


def _radiance(image: bpy.types.Image) -> Array:
    """(H, W, 3) linear, row 0 on top."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, image.channels)[::-1]
    colours = pixels[..., :3] if image.channels > 2 else np.repeat(pixels[..., :1], 3, -1)
    if not image.is_float and image.colorspace_settings.name == "sRGB":
        return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return colours


def _luminance(colour: Any) -> float:
    return max(float(luminance(np.array(colour[:3], float))), 0.0)


def _guess(world: bpy.types.World) -> float:
    """Luminance of all backgrounds together; what is not plain is taken for middle grey."""
    tree = _tree(world)
    assert tree is not None  # its surface was found there
    total = 0.0
    for node in tree.nodes:
        if node.bl_idname == "ShaderNodeBackground":
            colour, strength = node.inputs["Color"], node.inputs["Strength"]
            grey = 0.5 if colour.is_linked else _luminance(colour.default_value)
            total += grey * (0.5 if strength.is_linked else max(strength.default_value, 0.0))
    return total


# --- other worlds ----------------------------------------------------------------------------------------


def _rendered(world: bpy.types.World) -> Array:
    """(H, W, 3): the world as a panorama, as rays see it that a mirror has reflected."""
    compat.ensure_cycles()
    seen = world.copy()
    scene = bpy.data.scenes.new(IMAGE)
    camera = bpy.data.objects.new(IMAGE, bpy.data.cameras.new(IMAGE))
    data = camera.data
    try:
        _answer_light_paths(_tree(seen))
        scene[PROBE], scene.world, scene.camera = True, seen, camera
        scene.collection.objects.link(camera)
        data.type = "PANO"
        panorama = data if hasattr(data, "panorama_type") else data.cycles  # until 4.2
        panorama.panorama_type = "EQUIRECTANGULAR"
        # Then the panorama's columns and rows are those of an environment texture.
        camera.rotation_euler = (math.pi / 2, 0, -math.pi / 2)
        set_unbiased(scene, _SUB_SAMPLES, 0)
        scene.cycles.pixel_filter_type = "BOX"
        scene.render.resolution_x, scene.render.resolution_y = _WIDTH, _WIDTH // 2
        return render_pixels(scene)[..., :3].copy()
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.objects.remove(camera)
        bpy.data.cameras.remove(data)
        bpy.data.worlds.remove(seen)


def _answer_light_paths(tree: bpy.types.NodeTree) -> None:
    """Let Light Path nodes say what they say to a reflected ray: worlds often show cameras something else."""
    for node in tree.nodes:
        if node.bl_idname != "ShaderNodeLightPath":
            continue
        for output in node.outputs:
            value = {"Is Glossy Ray": 1.0, "Is Reflection Ray": 1.0, "Is Singular Ray": 1.0, "Ray Depth": 1.0}
            for link in list(output.links):
                target = link.to_socket
                tree.links.remove(link)
                if target.type == "VALUE":
                    target.default_value = value.get(output.name, 0.0)
