"""The virtual gantry: radiometry, orientation, tiling, and what it leaves behind."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from measured_materials.addon.gantry import photograph_arc
from measured_materials.addon.studio import studio
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import read_header, read_image
from measured_materials.nodes import compat
from support.scenes import diffuse_material

Array = np.ndarray
NORMAL = (0.0, 0.0)


def everything() -> set[tuple[str, int]]:
    """All datablocks of the file but the Render Result, which Blender makes with the first render and keeps."""
    names = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    found = {(name, block.session_uid) for name in names for block in getattr(bpy.data, name)}
    return found - {("images", i.session_uid) for i in bpy.data.images if i.type == "RENDER_RESULT"}


def pyramids(*places: tuple[float, float], radius: float = 0.2, height: float = 0.2) -> Callable:
    """A builder of four-sided pyramids on a white tile with the diagonals of their bases along u and v."""

    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        faces = [(0, 1, 2, 3)]
        for u, v in places:
            first, r = len(points), radius
            points += [(u + r, v, 0), (u, v + r, 0), (u - r, v, 0), (u, v - r, 0), (u, v, height)]
            faces += [(first + k, first + (k + 1) % 4, first + 4) for k in range(4)]
        mesh = bpy.data.meshes.new("pyramids")
        mesh.from_pydata(points, [], faces)
        mesh.materials.append(diffuse_material(0.8))
        obj = bpy.data.objects.new("pyramids", mesh)
        scene.collection.objects.link(obj)
        return [obj]

    return build


def uv_material() -> bpy.types.Material:
    """Emits (u, v, 0)."""
    material = compat.new_material("uv")
    tree = material.node_tree
    uv, emission, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "Emission", "OutputMaterial"))
    tree.links.new(uv.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


# --- arcs -----------------------------------------------------------------------------------------------


def test_lambert_arc_is_f_cos(tmp_path: Path) -> None:
    elevations, azimuth = [90.0, 45.0, 120.0, 15.5], 30.0
    shares: list[float] = []
    files = photograph_arc.photograph_arc(
        diffuse_material(0.5),
        tmp_path / "new" / "arc",
        elevations=elevations,
        azimuth=azimuth,
        size=8,
        samples=16,
        progress=shares.append,
    )
    assert [file.name for file in files] == ["el090.00.exr", "el045.00.exr", "el120.00.exr", "el015.50.exr"]
    for file, elevation in zip(files, elevations):
        frame = read_image(file)
        expected = 0.5 / math.pi * math.sin(math.radians(elevation))
        assert frame.shape == (8, 8, 3)
        # The sun's disk of half a degree changes the cosine by 0.8 % (rms) at the lowest elevation; 16 samples
        # of it leave 0.2 % in a texel.
        np.testing.assert_allclose(frame, expected, rtol=8e-3)
        np.testing.assert_allclose(frame.mean(), expected, rtol=1e-3)
        assert read_header(file).attributes["elevation"] == f"{elevation:g}"
    with open(files[0].parent / "lights.csv", newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["file", "elevation", "azimuth"]
    assert [row[0] for row in rows[1:]] == [file.name for file in files]
    assert [[float(x) for x in row[1:]] for row in rows[1:]] == [[90, 30], [45, 30], [60, 210], [15.5, 30]]
    assert sorted(path.name for path in files[0].parent.parent.iterdir()) == ["arc"]
    assert shares == sorted(shares) and shares[-1] == 1


def test_frames_of_an_arc_see_the_same_points(tmp_path: Path) -> None:
    # A texel half black and half white is told apart by its samples alone: alike in every frame.
    material = uv_material()
    files = photograph_arc.photograph_arc(material, tmp_path / "arc", elevations=[80, 20], size=4, samples=2)
    first, second = map(read_image, files)
    assert np.array_equal(first, second) and first.std() > 0


def test_interrupted_arc_leaves_nothing_and_spares_the_older_one(tmp_path: Path) -> None:
    folder, material = tmp_path / "arc", diffuse_material(0.5)
    settings = {"size": 4, "samples": 1}
    before = everything()

    def interrupt(share: float) -> None:
        if share > 0.4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        photograph_arc.photograph_arc(material, folder, elevations=[80, 40], progress=interrupt, **settings)
    assert list(tmp_path.iterdir()) == []
    older = photograph_arc.photograph_arc(material, folder, elevations=[80, 40], **settings)
    content = {file.name: file.read_bytes() for file in folder.iterdir()}
    with pytest.raises(KeyboardInterrupt):
        photograph_arc.photograph_arc(material, folder, elevations=[70], progress=interrupt, **settings)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == content
    photograph_arc.photograph_arc(material, folder, elevations=[70], **settings)
    assert sorted(file.name for file in folder.iterdir()) == ["el070.00.exr", "lights.csv"]
    assert not older[0].exists() and [path.name for path in tmp_path.iterdir()] == ["arc"]
    assert everything() == before


def test_folders_of_others_are_spared(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for folder, cause in ((tmp_path, "holds other things"), (tmp_path / "notes.txt", "cannot be used")):
        with pytest.raises(BakeError, match=cause):
            photograph_arc.photograph_arc(diffuse_material(0.5), folder, elevations=[45], size=4, samples=1)
    with pytest.raises(BakeError, match="cannot be written"):
        below = tmp_path / "notes.txt" / "arc"
        photograph_arc.photograph_arc(diffuse_material(0.5), below, elevations=[45], size=4, samples=1)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    "change",
    [
        {"elevations": []},
        {"elevations": [45, float("nan")]},
        {"elevations": [0]},
        {"elevations": [180]},
        {"elevations": [45, 45.001]},
        {"azimuth": float("inf")},
        {"size": 0},
        {"size": 1 << 20},
        {"samples": 0},
        {"tile": float("nan")},
        {"tile": 0},
    ],
    ids=str,
)
def test_nonsense_is_refused(tmp_path: Path, change: dict) -> None:
    before = everything()
    settings = {"elevations": [45], "size": 4, "samples": 1} | change
    with pytest.raises(BakeError):
        photograph_arc.photograph_arc(lambda scene: pyramids((0.5, 0.5))(scene), tmp_path / "arc", **settings)
    assert everything() == before and list(tmp_path.iterdir()) == []


# --- pictures -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("azimuth, bright, dark", [(0, "right", "left"), (90, "top", "bottom"), (180, "left", "right")])
def test_light_comes_from_its_azimuth(azimuth: float, bright: str, dark: str) -> None:
    picture = photograph_arc.photograph_view(
        pyramids((0.5, 0.5)), light=(math.radians(60), math.radians(azimuth)), size=40, samples=4
    )
    sides = {
        "right": picture[19:21, 23:27],
        "left": picture[19:21, 13:17],
        "top": picture[13:17, 19:21],
        "bottom": picture[23:27, 19:21],
    }
    # The sun stands 60 degrees off the normal, the faces 35 degrees: it leaves the far ones dark.
    assert sides[bright].mean() > 4 * sides[dark].mean()


def test_frame_covers_the_tile_with_v_upwards() -> None:
    size = 16
    picture = photograph_arc.photograph_view(uv_material(), size=size, samples=64)
    middle = (np.arange(size) + 0.5) / size
    # 64 points of a texel average to its middle within a few per cent of its width.
    np.testing.assert_allclose(picture[..., 0], np.broadcast_to(middle, (size, size)), atol=0.15 / size)
    np.testing.assert_allclose(picture[..., 1], np.broadcast_to(1 - middle[:, None], (size, size)), atol=0.15 / size)


def test_tilted_view_foreshortens_about_the_middle() -> None:
    size, theta = 20, math.radians(60)
    picture = photograph_arc.photograph_view(uv_material(), view=(theta, -math.pi / 2), size=size, samples=64)
    middle = (np.arange(size) + 0.5) / size
    v = (0.5 + (0.5 - middle) / math.cos(theta)) % 1
    inner = np.abs(v - 0.5) < 0.5 - 1 / size  # where no border between tiles crosses the texel
    np.testing.assert_allclose(picture[..., 0].mean(axis=0), middle, atol=0.1 / size)
    np.testing.assert_allclose(picture[inner, :, 1].mean(axis=1), v[inner], atol=0.2 / size)


def test_neighbours_wrap_around() -> None:
    # A shift by half a tile, which puts the pyramid across the border, only rolls the picture. At this light it
    # throws its shadow half a tile far.
    size, light = 48, (math.radians(68), math.radians(20))
    there = photograph_arc.photograph_view(pyramids((0.55, 0.4)), light=light, size=size, samples=128, sun_angle=0)
    wrapped = photograph_arc.photograph_view(pyramids((0.05, 0.4)), light=light, size=size, samples=128, sun_angle=0)
    # The noise of the interreflections; measured 1.4 %, and half of that with four times the samples.
    assert np.abs(np.roll(there, size // 2, axis=1) - wrapped).mean() < 0.025 * there.mean()
    np.testing.assert_allclose(wrapped.mean(), there.mean(), rtol=3e-3)
    # The tile alone, with neither its neighbours' shadows nor their halves of the pyramid, would differ plainly.
    assert np.abs(there - wrapped).mean() > 0.1 * there.mean()


def test_tile_size_scales_the_frame_alone() -> None:
    def large(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        (obj,) = pyramids((0.5, 0.5))(scene)
        obj.scale = (3, 3, 3)
        return [obj]

    light = (math.radians(50), 0.4)
    small = photograph_arc.photograph_view(pyramids((0.5, 0.5)), light=light, size=24, samples=32)
    scaled = photograph_arc.photograph_view(large, light=light, size=24, samples=32, tile=3)
    np.testing.assert_allclose(scaled, small, atol=0.02 * small.mean() + 0.1 * small.std())


def test_sun_of_some_size_shows_in_a_mirror() -> None:
    # What a stochastic mirror lives on: the disk's radiance is E / (pi sin^2(angle / 2)).
    mirror = {"Color": (1, 1, 1, 1), "Roughness": 0}
    material = compat.shader_material("mirror", "ShaderNodeBsdfAnisotropic", mirror)
    angle, tilt = math.radians(8), math.radians(35)
    seen = photograph_arc.photograph_view(
        material, view=(tilt, math.pi), light=(tilt, 0), size=2, samples=4, sun_angle=angle
    )
    np.testing.assert_allclose(seen, 1 / (math.pi * math.sin(angle / 2) ** 2), rtol=1e-3)


def test_plane_scene_is_the_scene_of_the_view() -> None:
    material, directions = diffuse_material(0.5), {"view": (0.9, 2.0), "light": (0.7, 1.0)}
    before = everything()
    with photograph_arc.plane_scene(material, size=4, samples=8, **directions) as scene:
        rendered = studio.render_linear(scene)
    assert np.array_equal(rendered, photograph_arc.photograph_view(material, size=4, samples=8, **directions))
    np.testing.assert_allclose(rendered, 0.5 / math.pi * math.cos(0.7), rtol=2e-3)
    assert everything() == before


# --- targets --------------------------------------------------------------------------------------------


def test_existing_objects_stay_as_they_are() -> None:
    scene = bpy.data.scenes.new("of the user")
    kept = pyramids((0.5, 0.5))(scene)
    collection = bpy.data.collections.new("of the user")
    collection.objects.link(kept[0])
    before, current = everything(), bpy.context.scene
    light = (1.0, 0.3)
    pictures = [
        photograph_arc.photograph_view(target, light=light, size=12, samples=4)
        for target in (kept[0], kept, collection, pyramids((0.5, 0.5)))
    ]
    assert everything() == before and bpy.context.scene == current
    assert list(scene.collection.objects) == kept and list(collection.objects) == kept
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture, pictures[0])
    mesh = kept[0].data
    bpy.data.batch_remove([scene, collection, *kept, mesh, *mesh.materials])


def test_what_the_block_makes_is_its_own() -> None:
    shown = diffuse_material(0.5)
    before = everything()
    with photograph_arc.gantry_scene(shown, size=4, samples=1) as made:
        own = bpy.data.materials.new("own")
        copies = len(made.copies)
        made.set_view(1.2, 0.3)
        assert len(made.copies) > copies
    assert everything() - before == {("materials", own.session_uid)}


def test_failing_builder_leaves_nothing() -> None:
    def build(scene: bpy.types.Scene) -> list[bpy.types.Object]:
        pyramids((0.5, 0.5))(scene)
        raise LookupError("planted")

    before = everything()
    with pytest.raises(LookupError, match="planted"):
        photograph_arc.photograph_view(build, size=4, samples=1)
    assert everything() == before


@pytest.mark.parametrize(
    "build, cause",
    [(lambda scene: [], "nothing"), (pyramids((0.5, 0.5), height=float("nan")), "finite")],
    ids=["empty", "not finite"],
)
def test_targets_without_sense_are_refused(build: Callable, cause: str) -> None:
    before = everything()
    with pytest.raises(BakeError, match=cause):
        photograph_arc.photograph_view(build, size=4, samples=1)
    assert everything() == before


@pytest.mark.parametrize("angles", [(-0.1, 0.0), (math.pi / 2, 0.0), (float("nan"), 0.0), (0.1, float("inf"))], ids=str)
@pytest.mark.parametrize("which", ["view", "light"])
def test_directions_below_the_surface_are_refused(which: str, angles: tuple[float, float]) -> None:
    with pytest.raises(BakeError, match="angle"):
        photograph_arc.photograph_view(pyramids((0.5, 0.5)), size=4, samples=1, **{which: angles})
