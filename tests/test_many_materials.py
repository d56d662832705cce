"""Materials of one bundle share images and groups, and nothing that happens to one of them reaches another."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from measured_materials.addon.material import bake_material, rebuild
from measured_materials.addon.material.choices import Choices
from measured_materials.addon.material.textures.kept import image_nodes, textures_of
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, read_bundle
from measured_materials.bake.bundle.result import BakeResult
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from measured_materials.bake.sources import analytic
from measured_materials.nodes import group
from measured_materials.nodes.data_image import CONTENT_KEY, load_data_image
from measured_materials.nodes.group import HASH_KEY, content_hash, hashing_once, trees_below
from measured_materials.nodes.material import build_material
from measured_materials.nodes.shading_map_material import build_shading_map
from support.bundles import tinted
from support.clean_blend import clean_blend  # noqa: F401
from support.scenes import lit_sphere
from support.swatches import map_bundle, rough_map
from test_addon import registered  # noqa: F401

QUICK = BakeSettings(resolution=8, alpha=(0.5, 0.5), sampler=SamplerLayout(8, 8, 8), envelope=False)
# Two shapes of one kind of grid: their groups differ in numbers too.
SHAPES = {"canvas": (0.3, (0.5, 0.5)), "satin": (0.6, (0.4, 0.7))}
KINDS = ("canvas", "brushed", "swatch")


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of bundles: two isotropic ones, two anisotropic, and two shading maps."""
    folder = tmp_path_factory.mktemp("many")
    for name, (width, shape) in SHAPES.items():
        bake(analytic.Ggx(alpha=width), folder / name, replace(QUICK, alpha=shape))
    brushed = bake(
        analytic.Ward(alpha=0.4, alpha_y=0.2), folder / "brushed", BakeSettings(resolution=4, envelope=False)
    )
    tinted(read_bundle(brushed), folder / "combed", 0.5)
    for seed, name in enumerate(("swatch", "scrap")):
        map_bundle(folder / name, rough_map(seed=seed), RenderSettings())
    return folder


def bake(source: Any, path: Path, settings: BakeSettings = QUICK) -> Path:
    object.__setattr__(source, "name", path.name)
    return bake_source(source, path, settings).path


def build(bundle: Bundle, **more: Any) -> bpy.types.Material:
    make: Callable[..., bpy.types.Material] = (
        build_shading_map if bundle.material["kind"] == "shading_map" else build_material
    )
    return make(bundle, **more)


def imported(path: Path, *, pack: bool = True) -> bpy.types.Material:
    """As an operator makes it, with all that it keeps."""
    return bake_material.material_from(BakeResult(path, read_bundle(path).material, 0.0), pack=pack)


def top(material: bpy.types.Material) -> bpy.types.NodeTree:
    return next(node.node_tree for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeGroup")


def images(material: bpy.types.Material) -> set[bpy.types.Image]:
    return {node.image for node in image_nodes(material.node_tree)}


def there() -> tuple[int, int]:
    kept = [image for image in bpy.data.images if image.type != "RENDER_RESULT"]  # no file keeps that
    return len(kept), len(bpy.data.node_groups)


@pytest.fixture
def no_copies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every group is made node by node."""
    monkeypatch.setattr(group, "copy_as_recorded", lambda *_: None)


# --- sharing ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pack", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_materials_of_one_bundle_share_all(baked: Path, kind: str, pack: bool) -> None:
    first = build(read_bundle(baked / f"{kind}.mmat"), pack=pack)
    before = there()
    second = build(read_bundle(baked / f"{kind}.mmat"), pack=pack)
    assert there() == before and first != second
    assert top(first) == top(second) and images(first) == images(second)
    assert all(bool(image.packed_files) == pack for image in images(first))


def test_packed_and_unpacked_are_not_mixed(baked: Path) -> None:
    bundle = read_bundle(baked / "canvas.mmat")
    beside, inside = build(bundle), build(bundle, pack=True)
    assert not images(beside) & images(inside)
    assert all(image.packed_files for image in images(inside))
    assert not any(image.packed_files for image in images(beside))


def test_the_same_files_elsewhere_are_others(baked: Path, tmp_path: Path) -> None:
    """One of the folders may go."""
    shutil.copytree(baked / "canvas.mmat", tmp_path / "canvas.mmat")
    here, elsewhere = build(read_bundle(baked / "canvas.mmat")), build(read_bundle(tmp_path / "canvas.mmat"))
    assert not images(here) & images(elsewhere)
    assert {Path(image.filepath).parent for image in images(elsewhere)} == {tmp_path / "canvas.mmat"}


@pytest.mark.parametrize("kind, other", [("canvas", "satin"), ("brushed", "combed"), ("swatch", "scrap")])
def test_a_copied_group_is_as_if_made_node_by_node(
    baked: Path, kind: str, other: str, request: pytest.FixtureRequest
) -> None:
    """The second bundle's groups are copies of the first's in which numbers, images and inner groups are exchanged."""
    build(read_bundle(baked / f"{kind}.mmat"))
    copied = [content_hash(tree) for tree in trees_below(top(build(read_bundle(baked / f"{other}.mmat"))))]
    for kept in (bpy.data.materials, bpy.data.node_groups, bpy.data.images):
        for block in list(kept):
            kept.remove(block)
    request.getfixturevalue("no_copies")
    made = [content_hash(tree) for tree in trees_below(top(build(read_bundle(baked / f"{other}.mmat"))))]
    assert len(made) > 3 and copied == made


def test_groups_are_copied_rather_than_made(baked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    making = group._made
    monkeypatch.setattr(group, "_made", lambda name, *rest: made.append(name) or making(name, *rest))
    build(read_bundle(baked / "canvas.mmat"))
    assert made
    made.clear()
    build(read_bundle(baked / "satin.mmat"))
    assert not [name for name in made if name.startswith("MM")]


# --- edits ------------------------------------------------------------------------------------------------


def edit(tree: bpy.types.NodeTree) -> None:
    """A constant of a Math node."""
    node = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeMath" and not all(s.is_linked for s in n.inputs))
    next(socket for socket in node.inputs if not socket.is_linked).default_value += 0.25


def test_an_edited_group_is_not_taken(baked: Path) -> None:
    """Its edit is seen wherever it was used, as Blender's count of users says, and nowhere else."""
    bundle = read_bundle(baked / "canvas.mmat")
    first, second = build(bundle), build(bundle)
    lookup = next(tree for tree in trees_below(top(first)) if "Lookup" in tree.name)
    edit(lookup)
    third = build(bundle)
    assert lookup in trees_below(top(first)) and lookup in trees_below(top(second))
    assert lookup not in trees_below(top(third)) and images(third) == images(first)
    assert all(tree[HASH_KEY] == content_hash(tree) for tree in trees_below(top(third)))
    assert top(build(bundle)) == top(third)


def test_an_edited_group_is_not_copied(baked: Path) -> None:
    """Nor one that is animated, which a copy would be too."""
    first = build(read_bundle(baked / "canvas.mmat"))
    for tree in trees_below(top(first)):
        if "Lookup" in tree.name:
            edit(tree)
        elif tree != top(first):
            next(s for n in tree.nodes for s in n.inputs if s.type == "VALUE").driver_add("default_value")
    second = build(read_bundle(baked / "satin.mmat"))
    own = [tree for tree in trees_below(top(second)) if "satin" in tree.name]
    assert own and all(tree[HASH_KEY] == content_hash(tree) and tree.animation_data is None for tree in own)


def paint(image: bpy.types.Image) -> None:
    image.pixels[0] = 0.5


CHANGES: dict[str, Callable[[bpy.types.Image], object]] = {
    "painted": paint,
    "colour space": lambda image: setattr(image.colorspace_settings, "name", "sRGB"),
    "alpha": lambda image: setattr(image, "alpha_mode", "STRAIGHT"),
    "precision": lambda image: setattr(image, "use_half_precision", not image.use_half_precision),
    "another file": lambda image: setattr(image, "filepath", image.filepath.replace("canvas", "satin")),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_image_is_not_taken(baked: Path, change: str) -> None:
    bundle = read_bundle(baked / "canvas.mmat")
    changed = next(iter(sorted(images(build(bundle)), key=lambda image: image.name)))
    CHANGES[change](changed)
    second = build(bundle)
    assert changed not in images(second)
    (own,) = (image for image in images(second) if image[CONTENT_KEY] == changed[CONTENT_KEY])
    assert own.colorspace_settings.name == "Non-Color" and own.alpha_mode == "CHANNEL_PACKED" and not own.is_dirty


def test_a_file_exchanged_after_it_was_checked_is_refused(baked: Path, tmp_path: Path) -> None:
    """Pixels are checked once for each content; that the file still is of that content, every time."""
    bundle = read_bundle(shutil.copytree(baked / "canvas.mmat", tmp_path / "canvas.mmat"))
    build(bundle)
    shutil.copy(read_bundle(baked / "satin.mmat").image_path("table"), bundle.image_path("table"))
    with pytest.raises(BakeError, match="changed after it was baked"):
        build(bundle)


def test_another_bake_under_the_same_path(registered: None, tmp_path: Path) -> None:  # noqa: F811
    """Each material keeps the numbers that it was built with."""
    first = imported(bake(analytic.Ggx(alpha=0.3), tmp_path / "again"))
    kept = pixels(first)
    second = imported(bake(analytic.Ggx(alpha=0.7), tmp_path / "again"))
    assert textures_of(first)["table"] != textures_of(second)["table"] and top(first) != top(second)
    assert np.array_equal(pixels(first), kept) and not np.array_equal(pixels(second), kept)


def pixels(material: bpy.types.Material) -> np.ndarray:
    return np.array(textures_of(material)["table"].pixels[:])


# --- one goes, another stays ------------------------------------------------------------------------------


def rendered(material: bpy.types.Material) -> np.ndarray:
    with lit_sphere(material, 12, ground=False, resolution=12) as scene:
        return scene.render(4, [0])


def removed(first: bpy.types.Material) -> None:
    bpy.data.materials.remove(first)
    bpy.data.orphans_purge(do_recursive=True)


def rebaked(first: bpy.types.Material) -> None:
    bake_material.bake_again(first, QUICK, pack=True)


GOINGS: dict[str, Callable[[bpy.types.Material], object]] = {
    "removed": removed,
    "another mode": lambda first: rebuild.rebuild_brdf(first, Choices(mode="preview")),
    "another filter": lambda first: rebuild.rebuild_brdf(first, Choices(mode="reference", filter="nearest")),
    "baked again": rebaked,
}


@pytest.mark.parametrize("going", GOINGS)
def test_what_happens_to_one_is_not_seen_in_another(
    registered: None,  # noqa: F811
    tmp_path: Path,
    going: str,
) -> None:
    path = bake(analytic.Ggx(alpha=0.3), tmp_path / "paint")
    first, second = imported(path), imported(path)
    second.use_fake_user = True
    assert top(first) == top(second) and textures_of(first) == textures_of(second)
    before, parts = rendered(second), textures_of(second)
    GOINGS[going](first)
    assert textures_of(second) == parts and all(image.packed_files for image in parts.values())
    assert np.array_equal(rendered(second), before)
    rebuild.rebuild_brdf(second, Choices(mode="preview"))
    rebuild.rebuild_brdf(second, Choices(mode="reference"))
    assert np.array_equal(rendered(second), before)


@pytest.mark.parametrize("pack", [False, True])
def test_a_saved_file_is_built_on(registered: None, baked: Path, tmp_path: Path, pack: bool) -> None:  # noqa: F811
    """Materials made after it was opened again take what those before have left."""
    for _ in range(2):
        imported(baked / "canvas.mmat", pack=pack).use_fake_user = True
    before = there()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    try:
        assert there() == before
        again = imported(baked / "canvas.mmat", pack=pack)
        assert there() == before and len({top(m) for m in bpy.data.materials if m.users or m == again}) == 1
    finally:
        bpy.ops.wm.read_homefile(use_empty=True)


def test_undo_of_one_leaves_the_other(registered: None, baked: Path) -> None:  # noqa: F811
    """And redo brings back one that shares with it; what came back so is built on."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    try:
        for step in ("first", "second"):
            imported(baked / "canvas.mmat").use_fake_user = True
            bpy.ops.ed.undo_push(message=step)
        before = there()
        bpy.ops.ed.undo()
        (first,) = bpy.data.materials
        assert there() == before and top(first)[HASH_KEY] == content_hash(top(first))
        assert all(min(image.size) > 1 and image.packed_files for image in textures_of(first).values())
        bpy.ops.ed.redo()
        assert there() == before and len({top(material) for material in bpy.data.materials}) == 1
        imported(baked / "canvas.mmat")
        assert there() == before and len(bpy.data.materials) == 3
    finally:
        bpy.ops.wm.read_factory_settings(use_empty=False)


def test_images_of_a_library_are_not_taken(registered: None, baked: Path, tmp_path: Path) -> None:  # noqa: F811
    imported(baked / "canvas.mmat").use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    try:
        with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (has, wanted):
            wanted.materials = has.materials
        own = imported(baked / "canvas.mmat")
        assert len(bpy.data.materials) == 2 and not any(image.library for image in images(own))
        assert not any(tree.library for tree in trees_below(own.node_tree))
    finally:
        bpy.ops.wm.read_homefile(use_empty=True)


def test_a_build_that_fails_takes_nothing_from_another(baked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bundle = read_bundle(baked / "canvas.mmat")
    build(bundle)
    before = there()
    monkeypatch.setattr("measured_materials.nodes.material_tree.assemble", lambda *_: load_data_image(Path("gone"), ""))
    with pytest.raises(BakeError, match="cannot be loaded"):
        build(bundle)
    assert there() == before


# --- the cost ---------------------------------------------------------------------------------------------


@pytest.fixture
def hashed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """Nodes of the trees that were hashed."""
    counted: list[int] = []
    counting = group._properties
    monkeypatch.setattr(group, "_properties", lambda node, *rest: counted.append(1) or counting(node, *rest))
    yield counted


def test_a_build_hashes_no_more_the_more_there_are(baked: Path, hashed: list[int]) -> None:
    """Each group below it once, and none of another material's; nothing again where several are built together."""
    bundle = read_bundle(baked / "canvas.mmat")
    build(bundle)
    hashed.clear()
    found = build(bundle)
    own = sum(len(tree.nodes) for tree in trees_below(top(found)))
    assert len(hashed) <= own
    for name in ("satin", "brushed", "swatch"):
        build(read_bundle(baked / f"{name}.mmat"))
    hashed.clear()
    build(bundle)
    assert len(hashed) <= own
    with hashing_once():
        build(bundle)
        hashed.clear()
        build(bundle)
    assert hashed == []
