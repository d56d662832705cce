"""What befalls a library while it is baked: nothing is lost, half-written, or touched outside of it.

`./run bench faults` does the same many times.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from measured_materials.addon.library.table import TABLE_SUFFIXES
from measured_materials.bake.atomic_write import staging_folder, sweep
from measured_materials.bake.bundle.bundle import read_bundle
from support.clusters import command
from support.library_faults import (
    EDITS,
    NAMES,
    Damage,
    contents,
    disk_full,
    hostile,
    killed,
    raced,
    task_where_files_cannot_grow,
)
from support.stacks import write_stack

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
NONE = {"lost": 0, "half_written": 0, "escaped": 0}


def spoiled(damage: Damage) -> dict[str, int]:
    assert damage.tried == 1
    return {name: count for name, count in vars(damage).items() if name != "tried"}


@pytest.mark.slow
@pytest.mark.parametrize("whom", ["client", "worker", "all"])
def test_killed_at_a_random_moment(whom: str, tmp_path: Path) -> None:
    assert spoiled(killed(tmp_path / "scene", random.Random(whom), whom)) == NONE


@pytest.mark.slow
def test_files_that_cannot_grow_leave_the_older_bundle(tmp_path: Path) -> None:
    assert spoiled(disk_full(tmp_path / "scene", 3000)) == NONE


def test_a_farms_task_fails_where_files_cannot_grow(tmp_path: Path) -> None:
    """Another worker may have the space: what the library of images says of it in words is no fault of the source."""
    code, told = task_where_files_cannot_grow(tmp_path, 1500)
    assert code == 1 and "cannot be written" in told


@pytest.mark.slow
def test_two_libraries_and_a_bake_to_one_folder(tmp_path: Path) -> None:
    assert spoiled(raced(tmp_path / "scene")) == NONE


@pytest.mark.slow
@pytest.mark.parametrize("edit", EDITS)
def test_a_bundle_edited_by_an_attacker(edit: str, tmp_path: Path) -> None:
    assert spoiled(hostile(tmp_path / "scene", EDITS[edit])) == NONE


@pytest.mark.slow
def test_links_out_of_the_library_are_not_followed(tmp_path: Path) -> None:
    """Two that do not hinder the bake, at once."""

    def edit(bundle: Path, outside: Path) -> None:
        EDITS["the table is a link to a file outside"](bundle, outside)
        EDITS["remains of a bake are links to a folder outside"](bundle, outside)

    assert spoiled(hostile(tmp_path / "scene", edit)) == NONE


def test_remains_of_killed_writers_are_swept(tmp_path: Path) -> None:
    """What was moved aside comes back, what was half-made goes; no link is followed, and living writers stay."""
    library, outside = tmp_path / "library", tmp_path / "outside"
    for place in (".a.mmat.0123456789ab.old", ".a.mmat.1123456789ab.partial", ".b.mmat.0123456789ab.partial"):
        (library / place).mkdir(parents=True)
        (library / place / "file").write_text(place)
    outside.mkdir()
    (outside / "diary.txt").write_text("nobody's business")
    (library / ".c.mmat.0123456789ab.old").symlink_to(outside, target_is_directory=True)
    (library / ".d.mmat.0123456789ab.partial").symlink_to(outside, target_is_directory=True)
    for name in (".0123456789ab.partial.json", ".0123456789ab.partial.blend", ".0123456789a.partial.json", ".notes"):
        (library / name).write_text("x")
    with staging_folder(library / "e.mmat") as living:
        sweep(library, *TABLE_SUFFIXES)
        left = {path.name for path in library.iterdir()}
    assert left == {"a.mmat", ".0123456789ab.partial.blend", ".0123456789a.partial.json", ".notes", living.name}
    assert (library / "a.mmat" / "file").read_text() == ".a.mmat.0123456789ab.old"
    assert contents(outside).keys() == {"diary.txt"}
    (library / ".0123456789ab.partial.csv").write_text("x")
    words = command("bake", "library", write_stack(tmp_path / "f"), "--out", library, "--jobs", "0")
    assert subprocess.run(words, capture_output=True, timeout=60).returncode == 0
    assert not (library / ".0123456789ab.partial.csv").exists()


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    library = tmp_path / "library"
    library.mkdir()
    (library / "kept.txt").write_text("as it was")
    before = contents(library)
    os.chmod(library, 0o555)
    words = command("bake", "library", "--analytic", "lambert", "--out", library)
    try:
        if os.access(library, os.W_OK):
            pytest.skip("permissions do not bind here")
        done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    finally:
        os.chmod(library, 0o755)
    assert done.returncode == 1 and "cannot be written" in done.stderr and len(done.stderr.splitlines()) == 1
    assert contents(library) == before


def test_a_small_disk_fills_up(tmp_path: Path) -> None:
    """A disk of its own, where that can be mounted: what fits is whole, the rest fails in one line each."""
    disk = tmp_path / "disk"
    disk.mkdir()
    for name in NAMES:
        write_stack(tmp_path / "swatches" / name)
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=200k", "none", str(disk)], capture_output=True)
    if mounted.returncode:
        pytest.skip("no file system may be mounted here")
    try:
        words = command("bake", "library", tmp_path / "swatches", "--out", disk / "library", "--jobs", "0")
        done = subprocess.run(words, capture_output=True, text=True, timeout=60)
        assert done.returncode == 1 and "Traceback" not in done.stderr
        assert "cannot be written" in done.stderr and "No space left on device" in done.stderr
        whole = list((disk / "library").glob("*.mmat"))
        for bundle in whole:
            read_bundle(bundle).check()
        assert 1 <= len(whole) < len(NAMES)
    finally:
        subprocess.run(["umount", str(disk)], check=True)
