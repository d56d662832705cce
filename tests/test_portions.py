"""Materials built in portions, with rests in between: the same as built at once, and nothing of half of one stays."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import measured_materials
import pytest
from measured_materials.addon.material.build_brdf import build_brdf, usual_choices
from measured_materials.addon.material.together import built_together
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.sources.analytic import by_name
from measured_materials.nodes import portions
from measured_materials.nodes.group import content_hash, trees_below
from measured_materials.nodes.portions import Pause, Portions
from support.coarse_bakes import coarse  # noqa: F401


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> BrdfRecord:
    path = tmp_path_factory.mktemp("bundle") / "gold.mmat"
    bake_source(by_name("ggx", alpha=0.3, diffuse=0.2), path, BakeSettings(6, "squared", basis="half"))
    return BrdfRecord.read(read_bundle(path))


@pytest.fixture
def empty(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A file without groups, where a portion does little; what is made goes."""
    monkeypatch.setattr(portions, "_LASTS", 0.0)
    monkeypatch.setattr(portions, "_WORKS", 0.004)
    # Whatever other tests have left would number the names.
    purge()
    measured_materials.register()
    yield
    purge()
    measured_materials.unregister()


def in_portions(build: Callable[[], Any], between: Callable[[int], None] = lambda number: None) -> tuple[Any, int]:
    """What it builds, and in how many portions."""
    work, number = Portions(), 1
    while True:
        try:
            with work.portion(), built_together():
                return build(), number
        except Pause:
            between(number)
            number += 1
            assert number < 5000  # it comes to an end


def described(material: Any) -> list[Any]:
    """All of a material's groups: their names, nodes and where these lie."""
    return [
        (tree.name, content_hash(tree), [(node.name, *node.location) for node in tree.nodes])
        for tree in trees_below(material.node_tree)[1:]
    ]


def purge() -> None:
    for kind in ("materials", "node_groups", "images"):
        bpy.data.batch_remove(list(getattr(bpy.data, kind)))


@pytest.mark.parametrize("mode", ["exact", "reference"])
def test_a_material_built_in_portions_is_that_built_at_once(mode: str, record: BrdfRecord, empty: None) -> None:
    def build() -> Any:
        return build_brdf(record, choices=usual_choices(record, mode), pack=True)[0]

    expected = described(build())
    purge()
    material, count = in_portions(build)
    assert count > 8 and described(material) == expected
    assert len(bpy.data.materials) == 1
    assert [tree for tree in bpy.data.node_groups if not tree.users] == []


def test_half_a_material_goes_without_a_trace(record: BrdfRecord, empty: None) -> None:
    work, kept = Portions(), bpy.data.node_groups.new("an artist's", "ShaderNodeTree")
    while len(bpy.data.node_groups) < 6:
        with pytest.raises(Pause), work.portion(), built_together():
            build_brdf(record, choices=usual_choices(record), pack=True)
    assert not bpy.data.materials
    work.drop()
    assert list(bpy.data.node_groups) == [kept]
    assert not [image.name for image in bpy.data.images if image.name.startswith("gold")]


def test_a_group_that_undo_has_taken_is_begun_anew(record: BrdfRecord, empty: None) -> None:
    def undo(number: int) -> None:
        if number == 10:
            bpy.data.batch_remove([tree for tree in bpy.data.node_groups if not tree.users])

    def build() -> Any:
        return build_brdf(record, choices=usual_choices(record), pack=True)[0]

    expected = described(build())
    purge()
    assert described(in_portions(build, undo)[0]) == expected


def test_a_group_that_is_not_as_it_was_left_is_not_continued(record: BrdfRecord, empty: None) -> None:
    edited: list[int] = []

    def edit(number: int) -> None:
        unfinished = [tree for tree in bpy.data.node_groups if "measured_materials_hash" not in tree]
        if number > 5 and unfinished and not edited:
            unfinished[-1].nodes.new("ShaderNodeMath")
            edited.append(number)

    def build() -> Any:
        return build_brdf(record, choices=usual_choices(record), pack=True)[0]

    expected = {row[1] for row in described(build())}
    purge()
    assert {row[1] for row in described(in_portions(build, edit)[0])} == expected and edited


def test_what_is_wrong_is_told_as_at_once(record: BrdfRecord, empty: None, tmp_path: Path) -> None:
    document = json.loads(json.dumps(dict(record.document)))
    del document["envelope"]
    broken = BrdfRecord.parse(document, tmp_path)
    with pytest.raises(BakeError, match="mode exact needs"):
        in_portions(lambda: build_brdf(broken, choices=usual_choices(record, "exact")))
    assert not bpy.data.materials


def test_no_rest_without_portions() -> None:
    portions.rest()
    portions.no_return()
    assert portions.active() is None


def test_a_rest_is_never_behind_the_point_of_no_return(empty: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(portions, "_WORKS", 0.0)
    work = Portions()
    with work.portion():
        portions.rest()  # the first work of a portion is always done
        with pytest.raises(Pause):
            portions.rest()
    with work.portion():
        portions.rest()
        portions.no_return()
        portions.rest()


def test_what_is_no_datablock_is_found_once(empty: None) -> None:
    work, found = Portions(), []
    for _ in range(3):
        with work.portion():
            assert portions.once("means", lambda: found.append(1) or len(found)) == 1
    assert found == [1] and portions.once("means", lambda: 7) == 7
