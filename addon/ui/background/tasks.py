"""What is baked beside the window, and what becomes of each bundle: a material made, or one rebuilt in place."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import bpy

from ....bake.brdf.record import BrdfRecord
from ....bake.brdf.settings import BakeSettings
from ....bake.bundle.bundle import read_bundle
from ....bake.bundle.result import BakeResult
from ....bake.errors import BakeError
from ....bake.shading_maps.bake import ArcSettings
from ....bake.shading_maps.record import ShadingMapRecord
from ....nodes.portions import Block, found, remove_unused_blocks
from ...baking.hosts import hosts
from ...baking.job import BakeJob
from ...baking.request import BakeRequest, Model, run_request
from ...material.bake_material import assign, free_bundle, material_from, target_of
from ...material.bake_photographs import folder_of, set_repeat, swatch_from
from ...material.build_brdf import usual_choices
from ...material.facts import record_of
from ...material.kinds import kind_of
from ...material.together import built_together
from ...photographs.find_decoder import blender_decoder
from ...summary.bake_stages import bake_stages
from ...summary.quality_levels import learn_pace
from ...summary.shading_map_rows import all_warnings
from ...summary.text import one_line
from . import kept_pace

# What a material shown while it is baked says of itself: FRESH in the undo step that shows it first, BAKING after that.
STATE_KEY = "measured_materials_bake"
FRESH, BAKING = "fresh", "baking"


class Job(Protocol):
    """What the queue follows: `baking.job.BakeJob`, or a bundle that is there already."""

    state: str
    stage: str
    share: float
    preview: Path | None
    error: BakeError | None

    def start(self) -> None: ...
    def poll(self) -> str: ...
    def cancel(self) -> None: ...
    def finish(self) -> BakeResult: ...
    def close(self) -> None: ...


class Task(ABC):
    """One material to be made or changed.

    `is_new` says that its bundle is made for it, and `replaces` that this lies in the place of another from then on;
    `doing` is what the status bar says of it.
    """

    is_new = replaces = False
    doing = "Baking"
    label: str

    @property
    @abstractmethod
    def title(self) -> str:
        """Name of its source for people."""

    @abstractmethod
    def stages(self) -> dict[str, float]:
        """Stages of its job and their typical seconds."""

    @abstractmethod
    def new_job(self) -> Job:
        """The job, asked when it is to begin. Raises BakeError."""

    @abstractmethod
    def is_wanted(self) -> bool:
        """Whether there still is something that the bake is for."""

    def show(self, bundle: Path) -> None:  # noqa: B027
        """Show a quick bake. Raises BakeError."""

    def shown(self, made: set[Block]) -> None:  # noqa: B027
        """Called with what was made, when the step of undo that shows the quick bake has been closed."""

    @abstractmethod
    def finish(self, result: BakeResult) -> str:
        """Use the bundle; returns words on it. Raises BakeError, and Pause where this is done in portions."""

    def bake_here(self, job: Job) -> BakeResult:
        """Do the job where no process can be started. Raises BakeError."""
        raise NotImplementedError

    def drop(self) -> bool:
        """Take back what `show` made; whether there was anything."""
        return False


class BakeTask(Task):
    """A bake, and what becomes of its bundle."""

    request: BakeRequest

    @property
    def title(self) -> str:
        return self.request.title

    def stages(self) -> dict[str, float]:
        return bake_stages(self.request.settings)

    @abstractmethod
    def target(self) -> Path:
        """The bundle to bake to, asked when the bake begins. Raises BakeError."""

    def new_job(self) -> Job:
        return BakeJob(self.request, self.target(), hosts(self.request, bpy.app.binary_path))

    def learn(self, result: BakeResult, material: bpy.types.Material) -> None:
        """How long bakes take here; of anisotropic ones, of sheets and of maps over azimuth the stages are others than
        were expected.
        """
        record = record_of(material)
        if isinstance(record, BrdfRecord):
            other = record.anisotropic or record.sheet is not None
        else:
            other = record.map.model == "azimuth"
        if not other:
            assert isinstance(self.request.settings, BakeSettings | ArcSettings)
            learn_pace(self.request.settings, result.seconds)
            kept_pace.keep()

    def bake_here(self, job: Job) -> BakeResult:
        assert isinstance(job, BakeJob)
        return run_request(self.request, job.target, decoder=blender_decoder())


@dataclass(eq=False)
class ImportTask(BakeTask):
    """A material made of a measurement or of photographs.

    Parameters
    ----------
    folder, stem : of the bundle
    obj : gets the material; None for none
    settled : called with the finished material
    """

    request: BakeRequest
    folder: Path
    stem: str
    pack: bool
    obj: bpy.types.Object | None
    settled: Callable[[bpy.types.Material], None]
    label: str = "Import Measured Material"
    is_new = True
    _obj: int = 0
    _material: int = 0
    _before: tuple[int, int] = (0, 0)
    _scale: tuple[float, ...] = ()
    _made: set[Block] = field(default_factory=set)

    def __post_init__(self) -> None:
        # Undo makes all pointers to datablocks invalid, and keeps these numbers.
        self._obj, self.obj = (self.obj.session_uid if self.obj else 0), None

    def target(self) -> Path:
        return free_bundle(self.folder, self.stem)

    def is_wanted(self) -> bool:
        return not self._material or found("materials", self._material) is not None

    def show(self, bundle: Path) -> None:
        with built_together():
            material = self._build(BakeResult(bundle, {}, 0.0), None, quick=True)
        material[STATE_KEY] = FRESH
        self._scale = _scale_of(material)
        self._material = material.session_uid
        obj = found("objects", self._obj)
        if obj is not None and obj.active_material is not None:
            self._before = obj.active_material_index, obj.active_material.session_uid
        assign(material, obj)

    def shown(self, made: set[Block]) -> None:
        self._made = made
        if material := found("materials", self._material):
            material[STATE_KEY] = BAKING

    def finish(self, result: BakeResult) -> str:
        material = found("materials", self._material) if self._material else None
        fresh = material is None
        with built_together():
            material = self._build(result, material, quick=False)
        if STATE_KEY in material:
            del material[STATE_KEY]
        obj = found("objects", self._obj)
        why = assign(material, obj) if fresh else ""
        self.settled(material)
        self.learn(result, material)
        told = obj is not None and (why or obj.active_material == material)
        place = place_words(obj, why) if told else ""
        return f"{material.name}{place}: {kind_of(material).words(material)}"

    def drop(self) -> bool:
        material = found("materials", self._material) if self._material else None
        if material is None:
            remove_unused_blocks(self._made)
            return False
        obj, (slot, uid) = found("objects", self._obj), self._before
        before = found("materials", uid) if uid else None
        if obj is not None and slot < len(obj.material_slots) and obj.material_slots[slot].material == material:
            obj.material_slots[slot].material = before
        bpy.data.materials.remove(material)
        remove_unused_blocks(self._made)
        return True

    def _build(self, result: BakeResult, material: Any, *, quick: bool) -> bpy.types.Material:
        source, pack = self.request.source, self.pack or quick
        if isinstance(self.request.settings, ArcSettings):
            untouched = material is not None and _scale_of(material) == self._scale
            given: Any = list(source) if isinstance(source, tuple) else source
            material = swatch_from(result, given, material, pack=pack)
            if untouched:
                set_repeat(material, 1.0, ShadingMapRecord.read(read_bundle(result.path)).map.layout)
            return material
        mode = "preview" if quick else None
        if material is not None and material.measured_quality.mode == "preview":
            mode = usual_choices(BrdfRecord.read(read_bundle(result.path))).mode
        assert isinstance(source, Path)
        return material_from(result, material, pack=pack, file=source, mode=mode)


@dataclass(eq=False)
class AgainTask(BakeTask):
    """A material baked again in place.

    Parameters
    ----------
    material : to bake again
    told : called with the material when it is done, of what is doubtful
    """

    request: BakeRequest
    material: bpy.types.Material | None
    pack: bool
    told: Callable[[bpy.types.Material], None]
    label: str = "Bake Again"
    replaces = True
    _material: int = 0

    def __post_init__(self) -> None:
        assert self.material is not None
        self._material, self.material = self.material.session_uid, None

    def target(self) -> Path:
        source = self.request.source
        material = found("materials", self._material)
        if isinstance(source, Model):
            return target_of(material, None)
        file = source if isinstance(source, Path) else folder_of(source)
        return target_of(material, file)

    def is_wanted(self) -> bool:
        return found("materials", self._material) is not None

    def finish(self, result: BakeResult) -> str:
        material, source = found("materials", self._material), self.request.source
        before = kind_of(material).error(material)
        if isinstance(self.request.settings, ArcSettings):
            given: Any = list(source) if isinstance(source, tuple) else source
            swatch_from(result, given, material, pack=self.pack)
        else:
            with built_together():
                material_from(result, material, pack=self.pack, file=source if isinstance(source, Path) else None)
        with contextlib.suppress(KeyError):
            del material[STATE_KEY]
        self.told(material)
        self.learn(result, material)
        return f"{material.name}: {kind_of(material).words(material)}" + (f", was {before}" if before else "")


def place_words(obj: bpy.types.Object, why: str) -> str:
    """Where a material is, or why it is not there."""
    return f" is not on {one_line(obj.name)}: {why}" if why else f" on {one_line(obj.name)}"


def warnings_of(material: bpy.types.Material) -> tuple[str, ...]:
    """What is doubtful about a swatch's photographs."""
    record = record_of(material)
    return all_warnings(record) if isinstance(record, ShadingMapRecord) else ()


def with_source(request: BakeRequest, source: Any) -> BakeRequest:
    """The same bake of another source."""
    return replace(request, source=tuple(source) if isinstance(source, list) else source)


def _scale_of(material: bpy.types.Material) -> tuple[float, ...]:
    mapping = [node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeMapping"]
    return tuple(tuple(node.inputs["Scale"].default_value) for node in mapping)
