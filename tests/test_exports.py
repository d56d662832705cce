"""Measured materials as glTF and USD show them, written by Blender's own exporters and read again from the files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import unquote

import bpy
import measured_materials
import numpy as np
import pytest
from measured_materials.addon.exports.gltf import without_glow
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.preview_sphere import to_srgb
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.maps.folder import read_maps_folder
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes.exported_look import exported_closure, look_of
from measured_materials.nodes.material import build_material
from measured_materials.nodes.principled_maps import build_principled
from measured_materials.nodes.shading_map_material import build_shading_map
from PIL import Image
from support.clean_blend import clean_blend  # noqa: F401
from support.coarse_bakes import coarse  # noqa: F401
from support.known_maps import ROUGHNESS, relief, write_folder
from support.swatches import map_bundle, rough_map

# Of fits that are not looked at, and of closures for some.
SETTINGS = BakeSettings(8, "squared", basis="half")
PLAIN = BakeSettings(8, basis="normal", parameterization="uniform", envelope=False)
RED = (0.5, 0.1, 0.05)
F0 = 0.03
SOURCES = {
    "matte": analytic.Lambert(RED),
    "lacquer": analytic.Ward(diffuse=RED, specular=(0.05, 0.05, 0.05), alpha=0.2),
    "gold": analytic.Ggx(alpha=0.3, f0=(0.9, 0.6, 0.2)),
    "brushed": analytic.Ward(diffuse=(0.1, 0.1, 0.1), specular=(0.3, 0.2, 0.1), alpha=0.2, alpha_y=0.4),
    "sheet": analytic.by_name("thin-cloth"),
}


Bundles = Callable[[str], Bundle]


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> Bundles:
    """A bundle of each kind, baked when it is asked for."""
    folder = tmp_path_factory.mktemp("bundles")

    @cache
    def made(name: str) -> Bundle:
        path = folder / f"{name}.mmat"
        if name == "swatch":
            return map_bundle(path, rough_map(), RenderSettings(lobe=Lobe("lambert"), sigma=0.5))
        return read_bundle(bake_source(SOURCES[name], path, SETTINGS if name in ("lacquer", "gold") else PLAIN).path)

    return made


@pytest.fixture(autouse=True)
def enabled() -> Iterator[None]:
    """The exporter asks extensions that are enabled in the preferences."""
    addons = bpy.context.preferences.addons
    addon = addons.new()
    addon.module = measured_materials.__name__
    yield
    addons.remove(addon)


def tile(material: bpy.types.Material) -> None:
    """The one object of the scene that is exported."""
    mesh = bpy.data.meshes.new("tile")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="UVMap")
    mesh.materials.append(material)
    obj = bpy.data.objects.new("tile", mesh)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.update()  # else the layer may not know the object yet, and nothing is selected
    for other in bpy.context.view_layer.objects:
        other.select_set(other == obj)
    assert obj.select_get() and obj.visible_get()
    bpy.context.view_layer.objects.active = obj


def in_gltf(folder: Path) -> dict[str, Any]:
    """Base colour, metallic and roughness that the file gives the material, and what it emits."""
    path = folder / "tile.gltf"
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLTF_SEPARATE", use_selection=True)
    (material,) = json.loads(path.read_text())["materials"]
    pbr = material["pbrMetallicRoughness"]
    assert not any(name.endswith("Texture") for name in (*pbr, *material))
    return {
        "colour": pbr.get("baseColorFactor", [1, 1, 1, 1])[:3],
        "metallic": pbr.get("metallicFactor", 1),
        "roughness": pbr.get("roughnessFactor", 1),
        "emits": material.get("emissiveFactor", [0, 0, 0]),
    }


def in_usd(folder: Path) -> dict[str, Any]:
    """The same of a file of text."""
    path = folder / "tile.usda"
    bpy.ops.wm.usd_export(filepath=str(path), selected_objects_only=True)
    text = path.read_text()

    def value(name: str, usual: Any) -> Any:
        found = re.search(rf"inputs:{name} = (\(?[-\d., e]+\)?)", text)
        return usual if found is None else json.loads(found[1].replace("(", "[").replace(")", "]"))

    assert text.count('info:id = "UsdPreviewSurface"') == 1
    return {
        "colour": value("diffuseColor", [0.18] * 3),
        "metallic": value("metallic", 0),
        "roughness": value("roughness", 0.5),
        "emits": value("emissiveColor", [0, 0, 0]),
    }


def materials(bundle: Bundle, name: str) -> Iterator[bpy.types.Material]:
    """In every mode."""
    if name == "swatch":
        for mode in ("exact", "preview"):
            yield build_shading_map(bundle, settings=RenderSettings(lobe=Lobe("lambert"), sigma=0.5, mode=mode))
        return
    for mode in ("preview", "exact", "reference"):
        if mode != "exact" or BrdfRecord.read(bundle).has("envelope"):
            yield build_material(bundle, mode=mode)


@pytest.mark.parametrize(
    "name",
    [
        "matte",
        "lacquer",
        "swatch",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("gold", "brushed", "sheet")),
    ],
)
def test_every_kind_keeps_its_colour(bundles: Bundles, name: str, tmp_path: Path) -> None:
    """That of a uniform sky, in glTF and in USD, whatever its mode; nothing glows."""
    record = (ShadingMapRecord if name == "swatch" else BrdfRecord).read(bundles(name))
    look = look_of(record)
    for k, material in enumerate(materials(bundles(name), name)):
        folder = tmp_path / str(k)
        folder.mkdir()
        tile(material)
        for found in (in_gltf(folder), in_usd(folder)):
            np.testing.assert_allclose(found["colour"], record.albedo.under_sky, atol=1e-4)
            assert found["metallic"] == pytest.approx(look.metallic, abs=1e-4)
            assert found["roughness"] == pytest.approx(look.roughness, abs=1e-4)
            assert found["emits"] == [0, 0, 0]


def test_gloss_goes_along(bundles: Bundles) -> None:
    """Lacquer is a little of a metal, cloth is none."""
    matte, lacquer = (look_of(BrdfRecord.read(bundles(name))) for name in ("matte", "lacquer"))
    assert matte.metallic == 0 and matte.roughness == 1
    assert 0.02 < lacquer.metallic < 0.5 and lacquer.roughness < 0.7


@pytest.mark.slow
def test_a_metal_is_one(bundles: Bundles) -> None:
    """Roughness is the root of alpha."""
    gold, brushed = (look_of(BrdfRecord.read(bundles(name))) for name in ("gold", "brushed"))
    assert gold.metallic > 0.95 and gold.roughness == pytest.approx(0.3**0.5, abs=0.1)
    assert brushed.metallic > 0.4


def test_an_artist_has_the_last_word(bundles: Bundles) -> None:
    """What is exported follows another bake, but for values that somebody has set, and a node that is gone."""
    material = build_material(bundles("matte"), mode="preview")
    nodes = material.node_tree.nodes
    shown = next(node for node in nodes if node.label == "For exports" and "Base Color" in node.inputs)
    shown.inputs["Roughness"].default_value = 0.3
    build_material(bundles("lacquer"), material, mode="preview")
    expected = BrdfRecord.read(bundles("lacquer")).albedo.under_sky
    np.testing.assert_allclose(shown.inputs["Base Color"].default_value[:3], expected, atol=1e-6)
    assert shown.inputs["Roughness"].default_value == pytest.approx(0.3)
    nodes.remove(shown)
    build_material(bundles("matte"), material, mode="preview")
    assert not any("Base Color" in node.inputs for node in nodes)


def active(material: bpy.types.Material) -> str:
    """Label of the output that Blender's own operators, and glTF's exporter, take."""
    return next(n.label for n in material.node_tree.nodes if getattr(n, "is_active_output", False))


def test_the_active_output_is_as_it_was(bundles: Bundles, tmp_path: Path) -> None:
    """After an export, and after one that failed when the file is saved, or with the next export."""
    measured_materials.register()
    try:
        material = build_material(bundles("matte"), mode="preview")
        before = active(material)
        assert before != "For exports"
        tile(material)
        in_gltf(tmp_path)
        assert active(material) == before
        (tmp_path / "file").write_text("")
        for restore in (
            lambda: in_gltf(tmp_path),
            lambda: bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tile.blend"), copy=True),
        ):
            with pytest.raises(RuntimeError):
                bpy.ops.export_scene.gltf(filepath=str(tmp_path / "file" / "tile.gltf"), export_format="GLTF_SEPARATE")
            assert active(material) == "For exports"
            restore()
            assert active(material) == before
    finally:
        measured_materials.unregister()


def test_nothing_glows_but_what_an_artist_lets_glow(bundles: Bundles) -> None:
    """Of what an exporter took from the group's Emission nodes nothing is left; the material's own light stays."""
    material = build_material(bundles("matte"), mode="preview")
    lit = {
        "emissive_factor": [1, 1, 1],
        "emissive_texture": "map",
        "extensions": {"KHR_materials_emissive_strength": 2},
    }
    written = SimpleNamespace(**lit)
    without_glow(written, material)
    assert vars(written) == {"emissive_factor": None, "emissive_texture": None, "extensions": {}}
    exported_closure(material.node_tree).inputs["Emission Strength"].default_value = 1
    lit["extensions"] = {"KHR_materials_emissive_strength": 2}
    without_glow(glowing := SimpleNamespace(**lit), material)
    assert vars(glowing) == lit


def test_a_linked_material_keeps_its_colour(bundles: Bundles, tmp_path: Path) -> None:
    """As an asset library gives it; in memory it is as before."""
    made = build_material(bundles("matte"), mode="preview")
    bpy.data.libraries.write(str(tmp_path / "matte.blend"), {made}, fake_user=True)
    with bpy.data.libraries.load(str(tmp_path / "matte.blend"), link=True) as (there, wanted):
        wanted.materials = list(there.materials)
    (linked,) = wanted.materials
    before = active(linked)
    tile(linked)
    expected = BrdfRecord.read(bundles("matte")).albedo.under_sky
    np.testing.assert_allclose(in_gltf(tmp_path)["colour"], expected, atol=1e-4)
    assert active(linked) == before != "For exports"


def test_engines_do_not_look_at_it(bundles: Bundles) -> None:
    """Each has an output of its own, which counts before one for all."""
    tree = build_material(bundles("lacquer"), mode="preview").node_tree
    for engine in ("CYCLES", "EEVEE"):
        assert tree.get_output_node(engine).inputs["Surface"].links[0].from_node.bl_idname == "ShaderNodeGroup"


@pytest.mark.parametrize("kind, shown", [("png16", "normal"), ("exr", "filtered")])
def test_maps_go_along(tmp_path: Path, kind: str, shown: Any) -> None:
    """The plain material of maps keeps its textures in both: colour, roughness and normals; in glTF specular too."""
    maps = read_maps_folder(write_folder(tmp_path / "maps", kind=kind, gloss=F0))
    tile(build_principled(maps, relief=shown))
    path = tmp_path / "tile.gltf"
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLTF_SEPARATE", use_selection=True)
    document = json.loads(path.read_text())
    (material,) = document["materials"]
    pbr = material["pbrMetallicRoughness"]
    assert {"baseColorTexture", "metallicRoughnessTexture"} <= pbr.keys() and "normalTexture" in material
    rough = _pixels(path, document, pbr["metallicRoughnessTexture"])[..., 1]
    assert rough.mean() == pytest.approx(ROUGHNESS, abs=0.004)
    specular = material["extensions"]["KHR_materials_specular"]
    share = specular.get("specularFactor", 1) * _pixels(path, document, specular["specularTexture"])[..., 3].mean()
    # As the extension has it, at an index of 1.5; half a step of eight bits is half a percent of F0 in PNG, 7 in EXR.
    seen = 0.04 * share * np.array(specular["specularColorFactor"])
    np.testing.assert_allclose(seen, F0, rtol=0.08 if kind == "exr" else 0.01)
    _, normals, albedo = relief()
    found = 2 * _pixels(path, document, material["normalTexture"])[..., :3] - 1
    np.testing.assert_allclose(found, normals, atol=0.01)
    if kind != "exr":  # of which the exporter takes linear numbers for sRGB: on the page
        colour = _pixels(path, document, pbr["baseColorTexture"])[..., :3]
        np.testing.assert_allclose(to_srgb(albedo), colour, atol=0.01)
    bpy.ops.wm.usd_export(filepath=str(tmp_path / "tile.usda"), selected_objects_only=True)
    text = (tmp_path / "tile.usda").read_text()
    for name in ("diffuseColor", "roughness", "normal"):
        assert f"inputs:{name}.connect" in text
    assert text.count('info:id = "UsdUVTexture"') >= 3


def _pixels(path: Path, document: dict[str, Any], texture: dict[str, int]) -> np.ndarray:
    """Of a texture's file, in [0, 1]."""
    image = document["images"][document["textures"][texture["index"]]["source"]]
    with Image.open(path.parent / unquote(image["uri"])) as opened:
        values = np.array(opened)
    return values / np.iinfo(values.dtype).max
