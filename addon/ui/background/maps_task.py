"""Maps baked beside the window, and the Principled BSDF material made of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy

from ....bake.bundle.result import BakeResult
from ....bake.maps.folder import read_maps_folder
from ....bake.maps.relief import Relief
from ....nodes.portions import found
from ....nodes.principled_maps import build_principled
from ...baking.request import BakeRequest
from ...material.bake_material import assign, free_bundle
from .tasks import BakeTask, place_words


@dataclass(eq=False)
class MapsTask(BakeTask):
    """Maps of photographs, and their material.

    Parameters
    ----------
    folder, stem : of the folder of maps
    relief, width : as of `build_principled`
    obj : gets the material; None for none, which keeps it by a fake user
    settled : called with the finished material and what is doubtful about the maps
    """

    request: BakeRequest
    folder: Path
    stem: str
    relief: Relief
    width: float
    pack: bool
    obj: bpy.types.Object | None
    settled: Callable[[bpy.types.Material, tuple[str, ...]], None]
    label: str = "Maps of Photographs"
    is_new = True
    _obj: int = 0

    def __post_init__(self) -> None:
        # Undo makes all pointers to datablocks invalid, and keeps these numbers.
        self._obj, self.obj = (self.obj.session_uid if self.obj else 0), None

    def target(self) -> Path:
        return free_bundle(self.folder, self.stem, "")

    def is_wanted(self) -> bool:
        return True

    def finish(self, result: BakeResult) -> str:
        maps = read_maps_folder(result.path)
        material = build_principled(maps, relief=self.relief, width=self.width, pack=self.pack)
        obj = found("objects", self._obj) if self._obj else None
        why = assign(material, obj)
        self.settled(material, tuple(str(warning) for warning in result.facts.get("warnings", ())))
        place = "" if obj is None else place_words(obj, why)
        return f"{material.name}{place}: maps in {result.path}"
