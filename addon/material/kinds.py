"""The kinds of measured material, a measured BRDF and a shading map: an object for each, of all that differs.

How the window asks for the settings of the next bake is in `kind_forms`.
"""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import bpy

from ...bake.brdf.common import kind_of as kind_told
from ...bake.brdf.record import BrdfRecord
from ...bake.bundle.bundle import is_bundle
from ...bake.bundle.result import Progress
from ...bake.errors import BakeError
from ...nodes.osl_script import is_one_script, is_scripted
from ..baking.request import Model
from ..summary.brdf_rows import error_rows
from ..summary.cost_estimate import NODES, RAY_SCRIPT, SCRIPT, expectation
from ..summary.text import one_line
from .bake_material import analytic_of, bake_again, error_words, exists, model_of
from .bake_photographs import bake_arc_again, map_words, photographs_of
from .choices import choices_of, is_rebuilding, show_choices, without_rebuilding
from .facts import facts_of, is_measured, record_of, source_file
from .lighting import lighting_of, show_lighting, uses_mode
from .rebuild import current_choices, current_lighting, effects_of, images_of_map, rebuild_brdf, relight
from .scene_fit import SAMPLED_EFFECT, plan_filter
from .textures.kept import bundle_path, missing_texture

Source = Path | Sequence[Path] | None


class Kind(ABC):
    """Kind of material: what the panel shows of it, and how it is rebuilt and baked again."""

    # What it is baked from, and how the panel says that it is gone.
    source_word: ClassVar[str]
    lost_words: ClassVar[str]

    @abstractmethod
    def images(self, material: bpy.types.Material) -> Sequence[str]:
        """Names of the bundle's images that the material is built of as it is. Raises BakeError."""

    @abstractmethod
    def rebuild_as_set(self, material: bpy.types.Material, changed: Any) -> None:
        """Rebuild the material as its properties say, of which a group has `changed`. Raises BakeError."""

    @abstractmethod
    def show(self, material: bpy.types.Material) -> None:
        """Set the properties to how the material is built; nothing is rebuilt. Raises BakeError."""

    @abstractmethod
    def refit(self, material: bpy.types.Material, scene: bpy.types.Scene | None = None) -> None:
        """Rebuild the material with what a scene calls for; all that was chosen stays. Raises BakeError.

        Without a scene it is the current one, and the material is prepared for lamps added later.
        """

    @abstractmethod
    def shade_by(self, material: bpy.types.Material, shader: str, scene: bpy.types.Scene) -> None:
        """Rebuild the material for a scene of nodes or with OSL, by the names of `choices`. Raises BakeError."""

    @abstractmethod
    def bake_again(
        self, material: bpy.types.Material, settings: Any, *, pack: bool, source: Source, progress: Progress | None
    ) -> None:
        """Bake what the material was baked from, or another source, and rebuild it in place. Raises BakeError."""

    @abstractmethod
    def bakeable_source(self, material: bpy.types.Material) -> Path | Model | list[Path]:
        """What the material was baked from. Raises BakeError where it does not say."""

    @abstractmethod
    def words(self, material: bpy.types.Material) -> str:
        """Short description of a bake's result. Raises BakeError."""

    @abstractmethod
    def effective(self, material: bpy.types.Material) -> tuple[str, ...]:
        """Names of the quality properties that have an effect."""

    def error(self, material: bpy.types.Material) -> str:
        """The error to compare the next bake's with; empty where there is none of the kind. Raises BakeError."""
        return ""

    def cost(self, material: bpy.types.Material) -> str:
        """Time and error of what is set, in words; empty where they are not known."""
        return ""

    def why_not_rebuildable(self, material: bpy.types.Material) -> str:
        """Why neither mode nor light can be changed; empty if they can."""
        path = bundle_path(material)
        try:
            missing = missing_texture(material, record_of(material), self.images(material))
        except BakeError as error:
            return one_line(str(error))
        return f"{missing}, and {path} is gone" if missing and not is_bundle(path) else ""

    def why_not_bakeable(self, material: bpy.types.Material) -> str:
        """Why the material cannot be baked again without being given a file; empty if it can."""
        file = source_file(material)
        if file is not None:
            return "" if exists(file) else f"The {self.source_word} {file} is not there"
        try:
            analytic_of(material)
        except BakeError:
            return "The material does not say what it was baked from"
        return ""


class _Brdf(Kind):
    """A measured BRDF, isotropic or anisotropic."""

    source_word, lost_words = "measurement", "The measurement is not there"

    def images(self, material: bpy.types.Material) -> Sequence[str]:
        names: tuple[str, ...] = record_of(material).images_of(current_choices(material).mode)
        return names

    def rebuild_as_set(self, material: bpy.types.Material, changed: Any) -> None:
        if changed == material.measured_quality:
            rebuild_brdf(material, choices_of(changed))

    def show(self, material: bpy.types.Material) -> None:
        show_choices(material.measured_quality, current_choices(material))

    def refit(self, material: bpy.types.Material, scene: bpy.types.Scene | None = None) -> None:
        rebuild_brdf(material, scene=scene)

    def shade_by(self, material: bpy.types.Material, shader: str, scene: bpy.types.Scene) -> None:
        choices = replace(current_choices(material), shader=shader)
        rebuild_brdf(material, choices, scene)
        show_choices(material.measured_quality, choices)

    def bake_again(
        self, material: bpy.types.Material, settings: Any, *, pack: bool, source: Source, progress: Progress | None
    ) -> None:
        bake_again(material, settings, pack=pack, file=source, progress=progress)

    def bakeable_source(self, material: bpy.types.Material) -> Path | Model | list[Path]:
        return source_file(material) or Model(*model_of(material))

    def words(self, material: bpy.types.Material) -> str:
        return error_words(material)

    def effective(self, material: bpy.types.Material) -> tuple[str, ...]:
        mode = material.measured_quality.mode
        if mode == "preview":
            return ("mode",)
        if mode != "reference":
            return ("mode", "aim", "sample", "residual", "filter", "shader")
        return ("mode", "aim", "filter", "shader")

    def error(self, material: bpy.types.Material) -> str:
        with contextlib.suppress(BakeError):
            return dict(error_rows(record_of(material)))["RMS error"]
        return ""

    def cost(self, material: bpy.types.Material) -> str:
        try:
            record, choices = record_of(material), choices_of(material.measured_quality)
            sampler = ""
            if any(effect.name == SAMPLED_EFFECT and effect.kept for effect in effects_of(material)):
                sampler = SCRIPT if is_one_script(material) else RAY_SCRIPT if is_scripted(material) else NODES
            filter = plan_filter(record, choices)[0] or record.table.filter
            return expectation(record, choices.mode, filter, sampler=sampler)
        except BakeError:
            return ""


def lets_light_through(material: bpy.types.Material) -> bool:
    """Whether a material is known to let light through: a sheet, or a swatch photographed against the light too."""
    with contextlib.suppress(BakeError):
        record = record_of(material)
        return (record.sheet if isinstance(record, BrdfRecord) else record.through) is not None
    return False


class _ShadingMap(Kind):
    """Photographs of a flat swatch under an arc of lights."""

    source_word, lost_words = "folder", "The photographs are not there"

    def images(self, material: bpy.types.Material) -> Sequence[str]:
        return images_of_map(record_of(material), current_lighting(material))

    def rebuild_as_set(self, material: bpy.types.Material, changed: Any) -> None:
        mode = material.measured_quality.mode
        if changed == material.measured_lighting:
            relight(material, lighting_of(changed, mode))
        else:
            # To all its digits, of which the properties hold seven.
            relight(material, replace(current_lighting(material), mode=mode))

    def show(self, material: bpy.types.Material) -> None:
        settings = current_lighting(material)
        show_choices(material.measured_quality, current_choices(material))
        show_lighting(material, settings)

    def refit(self, material: bpy.types.Material, scene: bpy.types.Scene | None = None) -> None:
        relight(material, current_lighting(material), scene)

    def shade_by(self, material: bpy.types.Material, shader: str, scene: bpy.types.Scene) -> None:
        properties = material.measured_quality
        before = choices_of(properties)
        show_choices(properties, replace(before, shader=shader))
        try:
            self.refit(material, scene)
        except BakeError:
            show_choices(properties, before)
            raise

    def bake_again(
        self, material: bpy.types.Material, settings: Any, *, pack: bool, source: Source, progress: Progress | None
    ) -> None:
        bake_arc_again(material, settings, pack=pack, source=source, progress=progress)

    def bakeable_source(self, material: bpy.types.Material) -> Path | Model | list[Path]:
        return photographs_of(material)

    def words(self, material: bpy.types.Material) -> str:
        return map_words(material)

    def effective(self, material: bpy.types.Material) -> tuple[str, ...]:
        if not uses_mode(material.measured_lighting.technique):
            return ("aim", "detail")
        traced = material.measured_quality.mode in ("exact", "balanced")
        sampled = ("sample", "shader") if traced else ()
        return ("mode", "aim", *sampled, "detail")


BRDF, SHADING_MAP = _Brdf(), _ShadingMap()


def kind_of(material: bpy.types.Material | None) -> Kind | None:
    """Kind of a material that was made here; None for all others."""
    if material is None or not is_measured(material):
        return None
    return SHADING_MAP if kind_told(facts_of(material)) == "shading_map" else BRDF


# Builds where a window is to stay awake, in the place of `Kind.rebuild_as_set`: called with the group that has changed
# and the context; whether it is left for later. Raises BakeError.
builders: list[Callable[[Any, bpy.types.Context | None], bool]] = []


def rebuild_or_say(changed: Any, context: bpy.types.Context | None = None) -> None:
    """Rebuild the material as its properties say, of which a group has `changed`; the update of all of these.

    Where that fails, the group says so and the properties are set back.
    """
    if not is_rebuilding():
        return
    kind = kind_of(changed.id_data)
    with without_rebuilding():
        changed.problem = ""
        if kind is None:
            return
        build = builders[-1] if builders else lambda *_: kind.rebuild_as_set(changed.id_data, changed)
        saying_why_not(changed, lambda: build(changed, context))


def saying_why_not(changed: Any, build: Callable[[], object]) -> None:
    """Call `build`; where it fails, the group of properties says so, and all are set back."""
    try:
        build()
    except BakeError as error:
        changed.problem = one_line(f"{error.cause}; {error.remedy}")
        # Facts of a foreign bundle cannot be shown; the panel reports them.
        with contextlib.suppress(BakeError):
            kind_of(changed.id_data).show(changed.id_data)
