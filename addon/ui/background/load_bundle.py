"""Materials of bundles that are there already: which folders are meant, and what is made of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import bpy

from ....bake.bundle.bundle import SUFFIX, is_bundle, read_bundle
from ....bake.bundle.result import BakeResult
from ....bake.errors import BakeError
from ...baking.job import CANCELLED, DONE
from ...material.bake_material import assign
from ...material.kinds import kind_of
from ...material.load_bundle import load_bundle
from ...material.together import built_together
from .tasks import Task, found


class LoadJob:
    """A bundle that is there already, as a job that is done."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.state, self.stage, self.share = DONE, "loading", 0.0
        self.preview: Path | None = None
        self.error: BakeError | None = None

    def start(self) -> None:
        """Nothing is to be done."""

    def poll(self) -> str:
        """That it is done."""
        return self.state

    def cancel(self) -> None:
        """Not to be asked for the bundle any more."""
        self.state = CANCELLED

    def finish(self) -> BakeResult:
        """The bundle. Raises BakeError."""
        bundle = read_bundle(self.path)
        return BakeResult(bundle.path, bundle.material, 0.0)

    def close(self) -> None:
        """Nothing is left behind."""


@dataclass(eq=False)
class LoadTask(Task):
    """A material of a bundle that is there already, made in portions.

    Parameters
    ----------
    obj : gets the material; None for none
    settled : called with the finished material
    """

    path: Path
    pack: bool
    obj: bpy.types.Object | None
    settled: Callable[[bpy.types.Material], None]
    label: str = "Import Measured Material"
    doing = "Loading"
    _obj: int = 0

    def __post_init__(self) -> None:
        # Undo makes all pointers to datablocks invalid, and keeps these numbers.
        self._obj, self.obj = (self.obj.session_uid if self.obj else 0), None

    @property
    def title(self) -> str:
        return self.path.name

    def stages(self) -> dict[str, float]:
        return {"loading": 1.0}

    def new_job(self) -> LoadJob:
        return LoadJob(self.path)

    def is_wanted(self) -> bool:
        return True

    def finish(self, result: BakeResult) -> str:
        with built_together():
            material = load_bundle(result.path, pack=self.pack)
        obj = found("objects", self._obj)
        why = assign(material, obj)
        self.settled(material)
        place = "" if obj is None else f" is not on {obj.name}: {why}" if why else f" on {obj.name}"
        return f"{material.name}{place}: {kind_of(material).words(material)}"


def bundles_meant(chosen: Iterable[Path]) -> tuple[list[Path], list[BakeError]]:
    """Bundles that an artist means by these paths, each once, and what is none.

    A path may be a bundle, a file in it, as a file browser cannot choose a folder without entering it, or a folder with
    bundles.
    """
    found: dict[Path, None] = {}
    errors = []
    for path in chosen:
        meant = _meant(path)
        if not meant:
            errors.append(BakeError(path, f"is not a bundle (a folder NAME{SUFFIX})", "choose a baked material"))
        found |= dict.fromkeys(meant)
    return list(found), errors


def _meant(path: Path) -> list[Path]:
    if is_bundle(path):
        return [path]
    try:
        if path.is_dir():
            return sorted(inner for inner in path.iterdir() if inner.suffix.lower() == SUFFIX and is_bundle(inner))
    except (OSError, ValueError):
        return []
    return [path.parent] if is_bundle(path.parent) else []
