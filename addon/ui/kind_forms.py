"""How the window asks for the next bake of each kind of material: the settings, and another file to bake."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import bpy

from ...bake.brdf.samplers import kind_of_layout
from ...bake.errors import BakeError
from ...bake.photographs.light_files.spheres import Sphere
from ...bake.photographs.photograph import IMAGE_SUFFIXES
from ..material.facts import record_of
from ..material.kinds import BRDF, SHADING_MAP, Kind, Source
from .import_brdf import SUFFIXES
from .import_photographs import chosen_photographs
from .properties.bake import draw_settings, settings_of
from .properties.photographs import arc_settings_of, draw_arc_settings
from .properties.spheres import text_of_spheres


class Form(ABC):
    """Form of one kind of material."""

    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def draw(self, layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
        """Draw the settings that have an effect."""

    @abstractmethod
    def properties(self, material: bpy.types.Material) -> Any:
        """The material's own properties of its bakes."""

    @abstractmethod
    def settings(self, material: bpy.types.Material, *, own: bool = True) -> tuple[Any, bool]:
        """The settings of the next bake, and whether its textures go into the .blend. What the panel does not show
        stays as it was baked, but for what is said of pictures where others than its `own` are baked. Raises BakeError.
        """

    @abstractmethod
    def chosen(self, operator: Any) -> Source:
        """What an operator with `filepath`, `files` and `directory` was given to bake; None for nothing."""

    @abstractmethod
    def path(self, source: Path) -> str:
        """Where a file browser begins."""


class _BrdfForm(Form):
    """A file of a measurement."""

    suffixes = SUFFIXES

    def draw(self, layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
        draw_settings(layout, material.measured_materials)

    def properties(self, material: bpy.types.Material) -> Any:
        return material.measured_materials

    def settings(self, material: bpy.types.Material, *, own: bool = True) -> tuple[Any, bool]:
        properties, settings = material.measured_materials, settings_of(material.measured_materials)
        # Facts of a foreign bundle cannot be read; then all that is not shown is as usual.
        with contextlib.suppress(BakeError):
            baked = record_of(material).settings
            same = kind_of_layout(baked.sampler) == properties.sampler
            sampler = baked.sampler if same else settings.sampler
            settings = replace(settings, sampler=sampler, viewers=baked.viewers)
        return settings, properties.pack

    def chosen(self, operator: Any) -> Source:
        return Path(bpy.path.abspath(operator.filepath)) if operator.filepath else None

    def path(self, source: Path) -> str:
        return str(source)


class _ShadingMapForm(Form):
    """A folder of photographs, or some."""

    suffixes = tuple(sorted(IMAGE_SUFFIXES))

    def draw(self, layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
        draw_arc_settings(layout, material.measured_arc, material.measured_lighting)

    def properties(self, material: bpy.types.Material) -> Any:
        return material.measured_arc

    def settings(self, material: bpy.types.Material, *, own: bool = True) -> tuple[Any, bool]:
        p, mode = material.measured_arc, material.measured_quality.mode
        known: tuple[Sphere, ...] = ()
        with contextlib.suppress(BakeError):
            baked = record_of(material).settings  # None where this version cannot read them
            known = () if baked is None else baked.stack.spheres
        if own and not p.is_property_set("spheres"):
            # A file that was saved before the panel showed them.
            p.spheres = text_of_spheres(known)
        settings = arc_settings_of(p, material.measured_lighting, mode)
        if not own and known and settings.stack.spheres == known:
            # On other photographs circles are elsewhere, unless the artist has said where.
            p.spheres, settings = "", replace(settings, stack=replace(settings.stack, spheres=()))
        return settings, p.pack

    def chosen(self, operator: Any) -> Source:
        return chosen_photographs(operator)

    def path(self, source: Path) -> str:
        return f"{source}/"


_FORMS: dict[Kind, Form] = {BRDF: _BrdfForm(), SHADING_MAP: _ShadingMapForm()}


def form_of(kind: Kind) -> Form:
    """The form of a kind."""
    return _FORMS[kind]
