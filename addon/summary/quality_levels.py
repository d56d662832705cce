"""Draft, Standard and Fine: what a level sets of a bake, and what it is expected to take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...bake.brdf.samplers import kind_of_layout
from ...bake.brdf.settings import BakeSettings
from ...bake.images.storage import Storage
from ...bake.shading_maps.bake import ArcSettings
from .bake_stages import bake_stages, kind_of

LEVELS = ("draft", "standard", "fine")
STANDARD, CUSTOM = "standard", "custom"
# Settings of a BRDF's bake, and of one of photographs, by the names that both the window and the command line use.
BRDF_LEVELS: Mapping[str, Mapping[str, Any]] = {
    "draft": {"resolution": 32, "basis": "half", "parameterization": "squared"},
    "standard": {"resolution": 64, "basis": "auto", "parameterization": "auto"},
    "fine": {"resolution": 96, "basis": "auto", "parameterization": "auto"},
}
MAP_LEVELS: Mapping[str, Mapping[str, Any]] = {
    "draft": {"size": 512, "slices": 8},
    "standard": {"size": 1024, "slices": 8},
    "fine": {"size": 2048, "slices": 12},
}
# Megabytes of what a usual isotropic material holds at 64 samples and half floats: the table and the residual, and
# the samplers of both. Medians of five measured materials.
_TABLES, _SAMPLERS = 2.5, {"alias": 2.1, "warp": 0.25}
_BYTES = {Storage.HALF: 1.0, Storage.FLOAT32: 2.0, Storage.RGBE: 0.7, Storage.LOG: 0.25, Storage.BYTE: 0.3}
# Bytes that a half float takes once it is compressed, and the shorter side of a photograph in parts of the longer.
_COMPRESSED, _ASPECT = 1.5, 2 / 3
_USUAL_SIDE = 1024
# Of a map over azimuth, where as many are taken as it takes.
_CURVES = 20
# Seconds of the stages of photographs are those of swatches so large.
_SIDE_OF_STAGES = 1700
# How long bakes took here beside what was expected of them; the last ones count.
_ratios: list[float] = []
_MOST = 9


def by_quality(levels: Mapping[str, Mapping[str, Any]], name: str) -> str:
    """Words on what an option is by default."""
    values = [str(levels[level][name]) for level in LEVELS]
    return values[0] if len(set(values)) == 1 else f"by --quality {', '.join(values)}"


def level_of(values: Any, levels: Mapping[str, Mapping[str, Any]]) -> str:
    """The level that these settings are, by their attributes, or CUSTOM."""
    for name, settings in levels.items():
        if all(getattr(values, key) == value for key, value in settings.items()):
            return name
    return CUSTOM


def expected_seconds(settings: BakeSettings | ArcSettings) -> float:
    """Of a bake on this machine: those of the machine that the stages were timed on, times what bakes took here."""
    stages = bake_stages(settings)
    if isinstance(settings, ArcSettings):
        side = settings.stack.size or _SIDE_OF_STAGES
        share = (side / _SIDE_OF_STAGES) ** 2 * (_numbers(settings) if settings.azimuths == "all" else settings.slices)
        # Reading is of the photographs' own size, and stages are of eight slices.
        usual = stages.pop("reading") + sum(stages.values()) * share / 8
    else:
        usual = sum(seconds for name, seconds in stages.items() if not kind_of(name))
    return usual * pace()


def expected_megabytes(settings: BakeSettings | ArcSettings) -> float:
    """Of the bundle that is baked."""
    if isinstance(settings, ArcSettings):
        side = settings.stack.size or _USUAL_SIDE
        texels = side * side * _ASPECT
        return texels * _numbers(settings) * 3 * _COMPRESSED * _BYTES[settings.storage] / 1e6
    parts = 1.0 if settings.envelope else 0.4
    if settings.table_bytes is None:
        tables = parts * _TABLES * (settings.resolution / 64) ** 3 * _BYTES[settings.storage]
    else:
        tables = (1 + settings.envelope) * settings.table_bytes / 1e6
    return tables + parts * _SAMPLERS[kind_of_layout(settings.sampler)]


def _numbers(settings: ArcSettings) -> int:
    """Kept of each texel and channel, the line under all levels included."""
    if settings.azimuths == "all":
        return (settings.azimuth_rank or _CURVES) + 1
    return {"none": settings.slices - 1, "power": 2, "basis": settings.rank}[settings.compression] + 1


def learn_pace(settings: BakeSettings | ArcSettings, seconds: float) -> None:
    """A bake of these settings has taken so long here."""
    expected = expected_seconds(settings) / pace()
    if expected > 0 and seconds > 0:
        _ratios.append(seconds / expected)
        del _ratios[:-_MOST]


def learned() -> list[float]:
    """What `recall` takes: how long the last bakes took beside what was expected of them."""
    return list(_ratios)


def recall(ratios: Sequence[float]) -> None:
    """Expect what was learned in an earlier session."""
    _ratios[:] = list(ratios)[-_MOST:]


def pace() -> float:
    """Time that a bake takes here, in parts of that on the machine that the stages were timed on."""
    return sorted(_ratios)[len(_ratios) // 2] if _ratios else 1.0


def expectation_words(settings: BakeSettings | ArcSettings) -> str:
    """Time and size in a few characters: "about 12 s, 5 MB"."""
    seconds, megabytes = expected_seconds(settings), expected_megabytes(settings)
    time = f"{_rounded(seconds)} s" if seconds < 90 else f"{_rounded(seconds / 60)} min"
    return f"{time}, {_rounded(megabytes)} MB"


def _rounded(number: float) -> str:
    """Two digits at most: an estimate."""
    return f"{number:.1f}" if number < 1 else f"{float(f'{number:.2g}'):.0f}"
