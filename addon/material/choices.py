"""What the artist has chosen for a material beside the light: as a value, and as its properties."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any, Final, Literal

from ...bake.tables.table import Filter

AUTO: Final = "auto"
ALWAYS, NEVER = "always", "never"
NODES, OSL = "nodes", "osl"


@dataclass(frozen=True)
class Choices:
    """Choices of the artist.

    Parameters
    ----------
    mode : of `bake.brdf.modes.MODES`; of a shading map, `RenderSettings.mode` counts
    aim, sample, residual, detail : "auto", "always" or "never"
    filter : "auto" or one of `bake.tables.table.FILTERS`
    shader : "nodes" or "osl": what it is built of, and of a shading map what asks whether lamps are seen
    """

    mode: str = "exact"
    aim: str = AUTO
    sample: str = AUTO
    residual: str = AUTO
    filter: Filter | Literal["auto"] = AUTO
    detail: str = AUTO
    shader: str = NODES


NAMES = tuple(choice.name for choice in fields(Choices))
# Those that are of consequence for a measured BRDF, and for a shading map, and are kept with it.
OF_BRDF = tuple(name for name in NAMES if name != "detail")
OF_MAP = ("aim", "sample", "detail", "shader")


_quiet = False


@contextmanager
def without_rebuilding() -> Iterator[None]:
    """Inside, a change of a material's properties rebuilds nothing."""
    global _quiet
    before, _quiet = _quiet, True
    try:
        yield
    finally:
        _quiet = before


def is_rebuilding() -> bool:
    """Whether a change of a material's properties is to rebuild it."""
    return not _quiet


def choices_of(properties: Any) -> Choices:
    """The properties as choices."""
    return Choices(**{name: getattr(properties, name) for name in NAMES})


def show_choices(properties: Any, choices: Choices) -> None:
    """Set the properties to how a material is built; nothing is rebuilt."""
    with without_rebuilding():
        for name in NAMES:
            setattr(properties, name, getattr(choices, name))
