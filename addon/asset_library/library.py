"""A folder of bundles as an asset library: found, compared with what is there, and written one by one."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import bpy

from ...bake.bundle.bundle import SUFFIX, is_bundle
from ...bake.errors import BakeError
from ..assets.mark import library_folder
from ..library.lock import LOCK, library_lock
from ..material.together import built_together
from ..summary.text import one_line
from .blend_file import AssetSettings, write_asset
from .written import FILE, Written, origin_of

State = Literal["written", "unchanged", "failed"]
# Seconds of the stages of one asset, about; only the proportion matters.
STAGES = {"rendering": 3.0, "building": 0.5}
_LEFTOVER = re.compile(r"\.[0-9a-f]{12}\.partial\.(blend|json|txt)")


class AssetProgress(Protocol):
    """What is told on the way: each asset as it begins, then its stages of `STAGES` and their share done."""

    def start(self, title: str) -> None:
        """The next asset."""

    def __call__(self, stage: str, share: float) -> None:
        """Where it stands."""


@dataclass(frozen=True)
class Asset:
    """What became of one bundle.

    Parameters
    ----------
    bundle : its folder
    file : the .blend, as a path in the library
    told : words on what could not be done, empty if there is nothing
    error : why it failed; None unless `state` says so
    """

    bundle: Path
    file: str
    state: State
    seconds: float
    told: str = ""
    error: BakeError | None = None


def bundles_below(folder: Path) -> list[Path]:
    """All bundles in a folder and in the folders below it, sorted; links are not followed. Raises BakeError."""
    if is_bundle(folder):
        return [folder]
    found: list[Path] = []

    def refuse(error: OSError) -> None:
        raise BakeError(error.filename or folder, f"cannot be read ({error.strerror})", "check its permissions")

    for place, inner, _ in os.walk(folder, onerror=refuse):
        bundles = [name for name in inner if name.lower().endswith(SUFFIX)]
        found += [Path(place, name) for name in bundles if is_bundle(Path(place, name)) and not _is_link(place, name)]
        inner[:] = [name for name in inner if name not in bundles and not name.startswith(".")]
    return sorted(found)


def _is_link(place: str, name: str) -> bool:
    return Path(place, name).is_symlink()


def write_library(
    bundles: Sequence[Path],
    root: Path,
    out: Path,
    settings: AssetSettings,
    progress: AssetProgress,
    *,
    replace: bool = False,
) -> Iterator[Asset]:
    """Bring an asset library in line with bundles, each as it is done; a bad one does not keep others from it.

    Parameters
    ----------
    bundles : their folders, below `root`; the .blend of each lies as deep in the library as the bundle below `root`
    out : folder of the library, made where there is none
    replace : also files that somebody else has written, or saved since

    Whatever else lies in the folder stays, assets whose bundle is gone included. Raises BakeError where nothing can be
    written there.
    """
    _require_registered()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BakeError(out, f"cannot be written ({error.strerror})", "choose a folder you may write to") from error
    with library_lock(out), built_together():
        files = [(one.relative_to(root) if one != root else Path(root.name)).with_suffix(".blend") for one in bundles]
        _remove_leftovers(out, {(out / file).parent for file in files})
        written = Written.read(out)
        library = library_folder(out / FILE) or out
        for bundle, file in zip(bundles, map(Path.as_posix, files)):
            progress.start(bundle.stem)
            started = time.perf_counter()
            try:
                state, told = _bring(bundle, file, written, library, settings, progress, replace)
                yield Asset(bundle, file, state, time.perf_counter() - started, told)
            except BakeError as error:
                yield Asset(bundle, file, "failed", time.perf_counter() - started, error=error)


def _bring(
    bundle: Path,
    file: str,
    written: Written,
    library: Path,
    settings: AssetSettings,
    progress: AssetProgress,
    replace: bool,
) -> tuple[State, str]:
    """Write one asset if need be. Raises BakeError, whatever goes wrong."""
    target = written.folder / file
    try:
        origin = origin_of(bundle, settings)
        if written.is_current(file, origin):
            return "unchanged", ""
        if not replace and not written.is_ours(file):
            cause = "was written or saved by somebody else and is not replaced"
            raise BakeError(target, cause, "move it away, or run `assets` with --replace to replace it")
        target.parent.mkdir(parents=True, exist_ok=True)
        told = write_asset(bundle, target, library, settings, progress, lambda new: written.announce(file, new))
        written.note(file, origin)
        return "written", told
    except OSError as error:
        cause = f"cannot be read or written ({error.strerror or error})"
        raise BakeError(
            error.filename or target, cause, "check the path, its permissions and the free space"
        ) from error
    except (RuntimeError, ValueError, TypeError, KeyError, MemoryError) as error:
        # Of Blender, or a defect: either is this material's alone.
        cause = f"cannot become an asset ({type(error).__name__}: {one_line(str(error))})"
        raise BakeError(bundle, cause, "bake it again; report it if that does not help") from error


def _require_registered() -> None:
    """The extension, where it is a module of Python; Blender itself has it registered."""
    if not hasattr(bpy.types.Material, "measured_materials"):
        from .. import register

        register()


def _remove_leftovers(out: Path, below: Collection[Path]) -> None:
    """What a killed run was writing here or in folders `below`; `bake.atomic_write.replacing_file` names it.

    A folder below that has a lock of its own is a library that somebody may just be writing to.
    """
    ours = [folder for folder in below if not folder.is_symlink() and not (folder / LOCK).exists()]
    for folder in {out, *ours}:
        for file in list(folder.glob(".*.partial.*")):
            if _LEFTOVER.fullmatch(file.name) and not file.is_symlink():
                with contextlib.suppress(OSError):
                    file.unlink()
