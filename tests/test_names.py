"""Names of datablocks are cut only where Blender must, and an import says where its material went."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from measured_materials.addon.material import bake_material
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.sources import analytic
from measured_materials.nodes.compat import longest_name
from measured_materials.nodes.material import build_material
from measured_materials.nodes.material_tree import part_name, safe_name


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    settings = BakeSettings(resolution=8, alpha=(0.5, 0.5), sampler=SamplerLayout(8, 8, 8), envelope=False)
    return read_bundle(bake_source(analytic.Lambert(), tmp_path_factory.mktemp("names") / "a", settings).path)


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    kinds = ("objects", "materials", "images", "node_groups", "meshes", "curves", "volumes", "lights")
    known = {kind: set(getattr(bpy.data, kind)) for kind in kinds}
    yield
    for kind, before in known.items():
        bpy.data.batch_remove(set(getattr(bpy.data, kind)) - before)


SIXTY = "a very long name of a paint that a library of swatches has_A"


@pytest.mark.parametrize(
    "given, name",
    [
        (SIXTY, SIXTY),
        ("x" * 300, "x" * longest_name()),
        ("\u00e9" * 300, "\u00e9" * (longest_name() // 2)),
        ("a\nb", "a_b"),
        ("\ud800", "?"),
        ("", "measured"),
    ],
)
def test_names_are_whole_as_far_as_blender_takes_them(bundle: Bundle, given: str, name: str) -> None:
    assert longest_name() >= 63 and safe_name(given) == name
    renamed = Bundle(bundle.path, {**bundle.material, "source": {**bundle.material["source"], "name": given}})
    before = set(bpy.data.images)
    first, second = build_material(renamed), build_material(renamed)
    assert first.name == name
    # Blender numbers it, or takes a letter away.
    assert second.name != name and name.startswith(second.name.split(".0")[0])
    assert len(second.name.encode()) <= longest_name()
    # What a part is, said behind the name, is not cut away.
    made = [image.name.split(".00")[0] for image in set(bpy.data.images) - before]
    kinds = {next(word for word in ("sampler", "table", "preview weights") if part.endswith(word)) for part in made}
    assert kinds == {"sampler", "table", "preview weights"}
    assert all(image.startswith(part_name(given)) for image in made)


def data_of(kind: str) -> Any:
    """A datablock for an object of this type; None for an empty; skips what this Blender has not."""
    if kind in ("CURVE", "SURFACE", "FONT"):
        return bpy.data.curves.new(kind, kind)
    if kind == "LIGHT":
        return bpy.data.lights.new(kind, "POINT")
    if kind == "LIGHT_PROBE":
        return bpy.data.lightprobes.new(kind, "SPHERE")
    places = {
        "MESH": "meshes", "META": "metaballs", "CURVES": "hair_curves", "POINTCLOUD": "pointclouds",
        "VOLUME": "volumes", "GREASEPENCIL": "grease_pencils_v3", "ARMATURE": "armatures", "LATTICE": "lattices",
        "CAMERA": "cameras", "SPEAKER": "speakers",
    }  # fmt: skip
    if kind == "GREASEPENCIL" and not hasattr(bpy.data, "grease_pencils_v3"):
        return bpy.data.grease_pencils.new(kind)
    return getattr(bpy.data, places[kind]).new(kind) if kind in places else None


TAKES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD"}
TYPES = [item.identifier for item in bpy.types.Object.bl_rna.properties["type"].enum_items]


@pytest.mark.parametrize("kind", sorted({*TYPES} - {"GPENCIL"}))
def test_an_import_says_where_its_material_is(bundle: Bundle, kind: str, tmp_path: Path) -> None:
    """For every type of object: in its slot and reported so, or kept by a fake user and refused in one line."""
    obj = bpy.data.objects.new(kind, data_of(kind))
    assert obj.type == kind
    material = build_material(bundle)
    told: list[tuple[str, str]] = []
    operator: Any = SimpleNamespace(report=lambda level, text: told.append((*level, text)))
    place = bake_material.told_place(operator, material, obj)
    if kind in TAKES:
        assert obj.active_material == material and place == f" on {kind}" and not told
        assert not material.use_fake_user
        return
    assert obj.active_material is None and place == "" and material.use_fake_user
    ((level, text),) = told
    assert level == "WARNING" and f"is not on {kind}: an object of type " in text and "\n" not in text


def test_without_an_object_there_is_no_warning(bundle: Bundle) -> None:
    material = build_material(bundle)
    operator: Any = SimpleNamespace(report=lambda level, text: pytest.fail(text))
    assert bake_material.told_place(operator, material, None) == "" and material.use_fake_user
