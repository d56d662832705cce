"""The order in which a writer calls the system: content on disk, then the name, then the name on disk."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.bake import atomic_write
from measured_materials.bake.atomic_write import replacing_file
from measured_materials.bake.bundle.bundle import StoredImage, write_bundle
from measured_materials.bake.images.image_io import write_image, write_png
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.report.journal import Journal

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="folders cannot be flushed there")

State = tuple[int, int]  # size and time of the last change


class Recorder:
    """What reached the disk before each name was given, and what after.

    Attributes
    ----------
    named : for each call that names something: the place, and the names of what had changed since it was flushed
    flushed_after : the folder of the last of these names, where it was flushed after it
    """

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.named: list[tuple[Path, list[str]]] = []
        self.flushed_after: list[Path] = []
        self._flushed: dict[int, State] = {}
        fsync, replace, rename, exchange = os.fsync, os.replace, os.rename, atomic_write._exchange

        def recorded_fsync(handle: int) -> None:
            fsync(handle)
            found = os.fstat(handle)
            self._flushed[found.st_ino] = (found.st_size, found.st_mtime_ns)
            if stat.S_ISDIR(found.st_mode):
                self.flushed_after += [path.parent for path, _ in self.named[-1:] if same(path.parent, found)]

        def naming(function: Any) -> Any:
            def recorded(source: Any, target: Any) -> Any:
                missing = self._not_on_disk(Path(source))
                result = function(source, target)
                if result is not False:
                    self.named.append((Path(target), missing))
                    self.flushed_after = []
                return result

            return recorded

        patch.setattr(os, "fsync", recorded_fsync)
        patch.setattr(os, "replace", naming(replace))
        patch.setattr(os, "rename", naming(rename))
        patch.setattr(atomic_write, "_exchange", naming(exchange))

    def _not_on_disk(self, source: Path) -> list[str]:
        parts = [source, *(source.rglob("*") if source.is_dir() else ())]
        return [part.name for part in parts if self._flushed.get(part.stat().st_ino) != state(part)]


def state(path: Path) -> State:
    found = path.stat()
    return found.st_size, found.st_mtime_ns


def same(path: Path, found: os.stat_result) -> bool:
    return path.stat().st_ino == found.st_ino


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    return Recorder(monkeypatch)


@pytest.mark.parametrize("older", [False, True])
@pytest.mark.parametrize("renaming", ["exchange", "two renames"])
def test_a_bundle_is_on_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, older: bool, renaming: str
) -> None:
    path, images = tmp_path / "felt.mmat", {"table": StoredImage(np.ones((3, 9, 3)), Storage.RGBE)}
    if older:
        write_bundle(path, {"version": 1}, images)
    if renaming == "two renames":
        monkeypatch.setattr(atomic_write, "_exchange", lambda first, second: False)
    recorder = Recorder(monkeypatch)
    write_bundle(path, {"version": 2}, images, np.zeros((2, 2, 3), np.uint8))
    (missing,) = [missing for target, missing in recorder.named if target == path]
    assert missing == []
    assert recorder.flushed_after == [tmp_path]


@pytest.mark.parametrize("name", ["table.exr", "table.hdr", "preview.png", "run.json", "page.html"])
def test_a_file_is_on_disk_before_it_has_its_name(tmp_path: Path, recorder: Recorder, name: str) -> None:
    path = tmp_path / name
    for _ in range(2):
        match path.suffix:
            case ".exr":
                write_image(path, np.ones((2, 3, 3), np.float32), Storage.FLOAT32)
            case ".hdr":
                write_image(path, np.ones((2, 9, 3), np.float32), Storage.RGBE)
            case ".png":
                write_png(path, np.zeros((2, 2, 3), np.uint8))
            case ".json":
                Journal(path, {"version": 1})
            case _:
                with replacing_file(path) as temporary:
                    temporary.write_text("<html>")
        (*_, (target, missing)) = recorder.named
        assert target == path and missing == []
        assert recorder.flushed_after == [tmp_path]


def test_what_is_written_after_the_flush_is_noticed(tmp_path: Path, recorder: Recorder) -> None:
    """The recorder itself: a late write, and a name that is given without any flush."""
    late, unflushed = tmp_path / "late", tmp_path / "unflushed"
    with late.open("w") as stream:
        stream.write("early")
        stream.flush()
        os.fsync(stream.fileno())
        stream.write(", late")
    os.replace(late, tmp_path / "a")
    unflushed.write_text("never")
    os.rename(unflushed, tmp_path / "b")
    assert [missing for _, missing in recorder.named] == [["late"], ["unflushed"]]
    assert recorder.flushed_after == []
