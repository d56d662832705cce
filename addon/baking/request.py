"""What to bake, as a value that can be sent to another process, and its bake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...bake.brdf.bake import bake_file, bake_source
from ...bake.brdf.settings import BakeSettings
from ...bake.bundle.bundle import move_bundle, read_bundle
from ...bake.bundle.result import BakeResult, Progress
from ...bake.maps.bake import MapSettings, bake_maps, move_maps
from ...bake.photographs.stack import PhotoStack
from ...bake.sampling.half_vector_cells import SamplerLayout
from ...bake.shading_maps.bake import ArcSettings, bake_arc, bake_stack
from ...bake.source import Facts
from ...bake.sources.analytic import by_name

# Texels of the longer side of a swatch's quick bake.
_QUICK_SIZE = 128
# Directions that its errors are measured at, which nobody reads.
_QUICK_PAIRS = 1024
_QUICK_BRDF: dict[str, Any] = {"basis": "half", "parameterization": "squared", "alpha": "error", "envelope": False}


@dataclass(frozen=True)
class Model:
    """A formula by its name and its parameters, of `bake.sources.analytic.by_name`."""

    name: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class BakeRequest:
    """One bake.

    Parameters
    ----------
    source : a measurement's file, a model, or photographs: their folder or a tuple of them
    settings : those of a shading map or of maps for photographs, else those of a BRDF
    quick : a quick bake comes first, for a picture of the material while it is baked
    look : of photographs: nothing is baked, they are only looked at
    """

    source: Path | Model | tuple[Path, ...]
    settings: BakeSettings | ArcSettings | MapSettings
    quick: bool = False
    look: bool = False

    @property
    def title(self) -> str:
        """Name of the source for people."""
        if isinstance(self.source, Model):
            return self.source.name
        return self.source[0].parent.name if isinstance(self.source, tuple) else self.source.name

    def photographs(self) -> Path | list[Path]:
        """The source, where it is photographs: their folder or a list of them."""
        assert not isinstance(self.source, Model)
        return list(self.source) if isinstance(self.source, tuple) else self.source


def run_request(
    request: BakeRequest,
    target: Path,
    progress: Progress | None = None,
    decoder: Any = None,
    quick: tuple[Path, Callable[[Path], None]] | None = None,
) -> BakeResult:
    """Bake to the bundle `target`, or the folder of maps. Raises BakeError; then nothing is written.

    Parameters
    ----------
    decoder : reads a photograph where no library here can
    quick : bundle of the quick bake, which the source, read once, is baked to first, and what is called with it
    """
    if isinstance(request.settings, ArcSettings):
        return _bake_photographs(request, request.settings, target, progress, decoder, quick)
    if isinstance(request.settings, MapSettings):
        made = bake_maps(request.photographs(), target, request.settings, progress, decoder)
        return BakeResult(made.path, made.facts, made.seconds)
    settings = request.settings
    if isinstance(request.source, Model):
        return bake_source(by_name(request.source.name, **request.source.parameters), target, settings, progress)
    assert isinstance(request.source, Path)

    def bake_quickly(source: Any, origin: dict[str, str]) -> None:
        if quick:
            small = bake_source(source, quick[0], quick_settings(settings), origin=origin, pairs=_QUICK_PAIRS)
            quick[1](small.path)

    return bake_file(request.source, target, settings, progress, bake_quickly)


def publish(request: BakeRequest, whole: Path, target: Path) -> Facts:
    """Have what was baked elsewhere on the disk become `target`, and return its account. Raises BakeError."""
    if isinstance(request.settings, MapSettings):
        return move_maps(whole, target)
    move_bundle(whole, target)
    return read_bundle(target).material


def quick_settings(settings: BakeSettings) -> BakeSettings:
    """Of a bake in a second, for mode Preview alone: a coarse table, and no residual."""
    return replace(settings, resolution=16, filter="trilinear", sampler=SamplerLayout(16, 16, 8), **_QUICK_BRDF)


def _bake_photographs(
    request: BakeRequest,
    settings: ArcSettings,
    target: Path,
    progress: Progress | None,
    decoder: Any,
    quick: tuple[Path, Callable[[Path], None]] | None,
) -> BakeResult:
    def bake_quickly(stack: PhotoStack, name: str, origin: dict[str, str]) -> None:
        if quick is None:
            return
        step = max(1, -(-max(stack.images.shape[1:3]) // _QUICK_SIZE))
        small = replace(stack, images=stack.images[:, ::step, ::step].copy())
        plain = replace(settings, tileable="off", compression="none")
        quick[1](bake_stack(small, quick[0], plain, name=name, origin=origin).path)

    return bake_arc(request.photographs(), target, settings, progress, decoder, bake_quickly)
