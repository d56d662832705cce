"""Maps as a plain Principled BSDF: as they are rendered, in a .blend of their own, and by the window."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import measured_materials
import numpy as np
import pytest
from measured_materials.addon.baking.request import BakeRequest
from measured_materials.addon.cli.main import main
from measured_materials.addon.gantry.photograph_arc import photograph_view
from measured_materials.addon.ui.background import bake_queue
from measured_materials.addon.ui.background.maps_task import MapsTask
from measured_materials.addon.ui.properties.photographs import _shown
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.maps.bake import MapSettings
from measured_materials.bake.maps.folder import read_maps_folder
from measured_materials.bake.maps.materialx import materialx_document
from measured_materials.nodes.principled_maps import build_principled
from support.clean_blend import clean_blend  # noqa: F401
from support.imports import datablocks
from support.known_maps import ROUGHNESS, N, lights, photographs, relief, write_folder, write_photographs
from support.stacks import write_stack

F0 = 0.04


def seen(folder: Path, wi: np.ndarray, **options: Any) -> np.ndarray:
    """The gantry's photograph of a flat tile of the material."""
    material = build_principled(read_maps_folder(folder), **options)
    theta, phi = np.arccos(wi[2]), np.arctan2(wi[1], wi[0])
    return photograph_view(material, light=(float(theta), float(phi)), size=N, samples=16)


@pytest.mark.parametrize(
    ("convention", "kind"),
    [("opengl", "png16"), ("directx", "png16"), pytest.param("directx", "exr", marks=pytest.mark.slow)],
)
def test_the_picture_is_the_photograph(tmp_path: Path, convention: str, kind: str) -> None:
    """Texel by texel, from two sides, whichever way green points: colour spaces, albedo and normals as written."""
    folder = write_folder(tmp_path / "maps", convention, kind)
    directions = lights(8)[[9, 12]]
    for image, wi in zip(photographs(directions), directions, strict=True):
        found = seen(folder, wi)
        # Cycles interpolates between texels: a pixel's mean holds an eighth of either neighbour.
        for axis in (0, 1):
            image = 0.75 * image + 0.125 * (np.roll(image, 1, axis) + np.roll(image, -1, axis))
        assert np.abs(found - image).mean() < 0.05 * image.mean()
        assert abs(found.mean() / image.mean() - 1) < 0.02


def test_specular_is_its_f0(tmp_path: Path) -> None:
    """A flat tile of a GGX lobe of this F0 and roughness, along the mirror direction, and PNG's as EXR's."""
    bright = []
    for kind in ("png16", "exr"):
        folder = write_folder(tmp_path / kind, kind=kind, gloss=F0)
        material = build_principled(read_maps_folder(folder), relief="bump", width=1e-6)
        bright.append(photograph_view(material, size=N, samples=64).mean())
    alpha = ROUGHNESS**2
    # D(0) = 1 / (pi alpha^2); the base is dimmed by what the gloss reflects, about its albedo of 4 to 5 %.
    lobe, base = F0 / (4 * np.pi * alpha**2), relief()[2].mean() / np.pi
    assert bright[0] == pytest.approx(bright[1], rel=0.02)
    assert bright[1] == pytest.approx(lobe + 0.955 * base, rel=0.02)


def test_the_height_shows_the_same_relief(tmp_path: Path) -> None:
    """As bump and as displacement; half the width is half the relief."""
    folder, wi = write_folder(tmp_path / "maps"), lights(8)[10]
    expected = seen(folder, wi)
    bump, flat = seen(folder, wi, relief="bump"), seen(folder, wi, relief="bump", width=1e-6)

    def shape(image: np.ndarray) -> np.ndarray:
        return (image / flat)[..., 0] - 1

    both = shape(bump).ravel(), shape(expected).ravel()
    assert np.corrcoef(*both)[0, 1] > 0.95 and np.polyfit(both[1], both[0], 1)[0] == pytest.approx(1, abs=0.1)
    half = shape(seen(folder, wi, relief="bump", width=0.5)).ravel()
    assert np.polyfit(both[0], half, 1)[0] == pytest.approx(0.5, abs=0.1)
    material = build_principled(read_maps_folder(folder), relief="displacement", width=2.0)
    output = material.node_tree.get_output_node("ALL")
    moved = output.inputs["Displacement"].links[0].from_node
    low, high = (relief()[0] / N).min(), (relief()[0] / N).max()
    ends = [(h - moved.inputs["Midlevel"].default_value) * moved.inputs["Scale"].default_value for h in (0.0, 1.0)]
    np.testing.assert_allclose(ends, [2 * low, 2 * high], atol=1e-5)
    assert (
        material.displacement_method == "BOTH"
        and not output.inputs["Surface"].links[0].from_node.inputs["Normal"].is_linked
    )


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BakeError, match=r"holds no maps\.json"):
        read_maps_folder(tmp_path)
    folder = write_folder(tmp_path / "maps")
    (folder / "albedo.png").rename(folder / "other.png")
    with pytest.raises(BakeError, match=r"albedo\.png: is missing"):
        read_maps_folder(folder)
    facts = json.loads((folder / "maps.json").read_text())
    facts["maps"]["albedo"]["file"] = "../maps/other.png"
    (folder / "maps.json").write_text(json.dumps(facts))
    with pytest.raises(BakeError, match="names no file of its albedo"):
        read_maps_folder(folder)
    facts["maps"]["albedo"]["file"] = "other.png"
    (folder / "other.png").write_bytes(b"no picture")
    (folder / "maps.json").write_text(json.dumps(facts))
    before = datablocks()
    with pytest.raises(BakeError, match="width: is 0"):
        build_principled(read_maps_folder(folder), width=0)
    for pack in (False, True):
        with pytest.raises(BakeError, match=r"other\.png: cannot be loaded by Blender"):
            build_principled(read_maps_folder(folder), pack=pack)
    del facts["program"]
    (folder / "maps.json").write_text(json.dumps(facts))
    with pytest.raises(BakeError, match="is not of bake maps"):
        read_maps_folder(folder)
    assert datablocks() == before


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs of the relief."""
    directions = lights(6)
    return write_photographs(tmp_path_factory.mktemp("stacks") / "relief", photographs(directions), directions)


def test_a_blend_of_its_own(stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It reads the maps beside it by relative paths, is moved with them, and replaces no other by chance."""
    blend, known = tmp_path / "out" / "relief.blend", datablocks()
    arguments = ["bake", "maps", str(stack), "--out", str(tmp_path / "out"), "--blend", str(blend), "--repeats"]
    assert main([*arguments[:5], "--width", "2"]) == 2
    assert "--relief, --width and --pack" in capsys.readouterr().err
    for wrong in ("0", "2e6"):
        assert main([*arguments, "--width", wrong]) == 2
        assert "above 0 and below 1e+06" in capsys.readouterr().err
    elsewhere = tmp_path / "none" / "relief.blend"
    assert main([*arguments[:5], "--blend", str(elsewhere)]) == 1 and "is not a folder" in capsys.readouterr().err
    assert main([*arguments, "--relief", "bump", "--width", "0.3"]) == 0
    assert datablocks() == known and "relief.blend: relief" in capsys.readouterr().out
    assert main(arguments) == 1 and "is there already" in capsys.readouterr().err
    moved = tmp_path / "elsewhere"
    shutil.move(tmp_path / "out", moved)
    with bpy.data.libraries.load(str(moved / "relief.blend"), assets_only=True) as (there, wanted):
        wanted.materials = list(there.materials)
    (material,) = wanted.materials
    images = [node.image for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"]
    assert len(images) == 4 and all(tuple(image.size) == (N, N) for image in images)
    spaces = {Path(image.filepath).stem: image.colorspace_settings.name for image in images}
    assert spaces == {"albedo": "sRGB", "roughness": "Non-Color", "specular": "Non-Color", "height": "Non-Color"}
    bump = next(node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeBump")
    scale = json.loads((moved / "relief_maps" / "maps.json").read_text())["maps"]["height"]["scale"]
    assert bump.inputs["Distance"].default_value == pytest.approx(0.3 * scale, rel=1e-5)


@pytest.fixture
def plate(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """An active object."""
    monkeypatch.setattr(bpy.app.timers, "is_registered", lambda _: True)  # stepped by hand
    measured_materials.register()
    obj = bpy.data.objects.new("plate", bpy.data.meshes.new("plate"))
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    yield obj
    bake_queue.queue.stop()
    bpy.data.objects.remove(obj)
    monkeypatch.undo()
    measured_materials.unregister()


def test_the_window_makes_them(plate: Any, stack: Path, tmp_path: Path) -> None:
    """Maps alone go to the object, beside a measured material they do not; a folder of maps is built again."""
    calls = bpy.ops.measured_materials
    assert calls.import_arc(filepath=str(stack), bundles=str(tmp_path), make="maps") == {"FINISHED"}
    first = plate.active_material
    assert first.name == "relief" and (tmp_path / "relief_maps" / "maps.json").is_file()
    assert not list(tmp_path.glob("*.mmat"))
    assert calls.import_arc(filepath=str(stack), bundles=str(tmp_path), make="both") == {"FINISHED"}
    measured = plate.active_material
    beside = next(m for m in bpy.data.materials if m.name.startswith("relief") and m not in (first, measured))
    assert (tmp_path / "relief.mmat").is_dir() and (tmp_path / "relief_maps_2").is_dir()
    assert beside.use_fake_user and beside.node_tree.nodes.get("Principled BSDF")
    assert calls.import_maps(filepath=str(tmp_path / "relief_maps" / "maps.json"), relief="bump") == {"FINISHED"}
    assert any(node.bl_idname == "ShaderNodeBump" for node in plate.active_material.node_tree.nodes)


def test_an_arc_makes_no_maps_and_its_measured_material_is_whole(
    plate: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Where both are asked for; one undo step, on the object, with the settings of its next bake."""
    felt = write_stack(tmp_path / "felt")
    calls = bpy.ops.measured_materials
    assert calls.import_arc(filepath=str(felt), bundles=str(tmp_path), make="both", slices=5) == {"FINISHED"}
    assert plate.active_material.name == "felt" and plate.active_material.measured_arc.slices == 5
    assert "there are no maps" in capfd.readouterr().out
    assert not list(tmp_path.glob("felt_maps*"))
    with pytest.raises(RuntimeError, match="one plane"):
        calls.import_arc(filepath=str(felt), bundles=str(tmp_path), make="maps")


def test_maps_alone_heed_nothing_of_a_shading_map(plate: Any, stack: Path, tmp_path: Path) -> None:
    """Neither is it shown, nor does what is wrong with it keep them away."""
    calls = bpy.ops.measured_materials
    wrong = {"azimuths": "all", "through": str(tmp_path / "nowhere")}
    with pytest.raises(RuntimeError):
        calls.import_arc(filepath=str(stack), bundles=str(tmp_path), **wrong)
    assert calls.import_arc(filepath=str(stack), bundles=str(tmp_path), make="maps", **wrong) == {"FINISHED"}
    usual = {p.identifier: getattr(p, "default", None) for p in calls.import_arc.get_rna_type().properties}
    asked = SimpleNamespace(**usual | {"make": "maps", "size": 64, "full_size": False})
    shown = _shown(asked, asked)
    assert shown == {
        "swatch": ("full_size", "size", "frame"),
        "brightness": ("decode", "scale_by", "flat_field", "align"),
        "lights": ("lights", "spheres"),
        "files": ("pack",),
    }


def test_an_object_that_shows_no_surface_is_told_of(plate: Any, tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "maps")
    empty = bpy.data.objects.new("empty", None)
    bpy.context.collection.objects.link(empty)

    def words(obj: Any) -> str:
        request = BakeRequest(folder, MapSettings())
        task = MapsTask(request, tmp_path, "maps", "normal", 1.0, True, obj, lambda *_: None)
        return task.finish(BakeResult(folder, {}, 0.0))

    assert "on plate: maps in" in words(plate)
    assert "is not on empty: an object of type Empty has no surface" in words(empty)


def test_maps_wait_in_the_queue(plate: Any, stack: Path, tmp_path: Path) -> None:
    """Baked by the worker beside the window, and their folder appears when it is whole."""
    told: list[Any] = []
    request = BakeRequest(stack, MapSettings(repeats=True))
    task = MapsTask(request, tmp_path, "relief_maps", "normal", 1.0, True, plate, lambda *made: told.append(made))
    bake_queue.queue.add([task])
    import time

    end = time.monotonic() + 90
    while not told:
        assert time.monotonic() < end and (bake_queue.queue.is_busy() or told)
        bake_queue.queue.step()
        time.sleep(0.02)
    material, warnings = told[0]
    assert plate.active_material == material and any("not calibrated" in words for words in warnings)
    assert {path.name for path in tmp_path.iterdir()} == {"relief_maps"}
    assert read_maps_folder(tmp_path / "relief_maps").name == "relief"


def test_materialx_is_valid(tmp_path: Path) -> None:
    """By MaterialX's own library: nodes, types and links of its definitions, and every file by a relative path."""
    mx = pytest.importorskip("MaterialX")
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    for convention, kind in (("opengl", "png16"), ("directx", "exr")):
        folder = write_folder(tmp_path / kind, convention, kind)
        facts = json.loads((folder / "maps.json").read_text())["maps"]
        (folder / "maps.mtlx").write_text(materialx_document("1 blue/cloth", facts))
        document = mx.createDocument()
        mx.readFromXmlFile(document, str(folder / "maps.mtlx"))
        document.setDataLibrary(library)
        valid, why = document.validate()
        assert valid, why
        (material,) = document.getMaterialNodes()
        (shader,) = mx.getShaderNodes(material)
        assert shader.getCategory() == "open_pbr_surface" and shader.getNodeDef() is not None
        names = {element.getName() for element in shader.getNodeDef().getActiveInputs()}
        assert {child.getName() for child in shader.getInputs()} <= names
        graph = document.getNodeGraph("NG__1_blue_cloth")
        assert all(node.getNodeDef() is not None for node in graph.getNodes())
        files = [node.getInputValue("file") for node in graph.getNodes("image")]
        assert len(files) == 5 and all((folder / str(file)).is_file() for file in files)
