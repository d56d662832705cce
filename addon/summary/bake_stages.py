"""Stages of a bake and the time each takes, for estimates."""

from __future__ import annotations

from collections.abc import Mapping

from ...bake.brdf.bake import KIND_OF_STAGE
from ...bake.brdf.settings import BakeSettings
from ...bake.brdf.sheet_bake import KIND_OF_SHEET, STAGE
from ...bake.maps.bake import STAGES as STAGES_OF_MAPS
from ...bake.maps.bake import MapSettings
from ...bake.shading_maps.against_light import STAGE as STAGE_BEHIND
from ...bake.shading_maps.bake import ArcSettings

# Texels of a swatch's longer side where nothing is said: camera photographs would otherwise make textures of hundreds
# of megabytes.
USUAL_SIZE = 1024


def bake_stages(settings: BakeSettings | ArcSettings | MapSettings) -> dict[str, float]:
    """Typical seconds of the stages of `bake_file`, of `bake_arc` or of `bake_maps`, in their order.

    Only reading it shows whether a BRDF is anisotropic, or a sheet: the stages of all kinds are listed one kind behind
    the other, and `share_done` keeps to the kind that it is asked for.
    """
    if isinstance(settings, ArcSettings):
        return _arc_stages(settings)
    if isinstance(settings, MapSettings):
        return dict(STAGES_OF_MAPS)
    usual, anisotropic = _brdf_stages(settings), _anisotropic_stages(settings)
    kinds = {
        "": usual,
        KIND_OF_STAGE: anisotropic,
        KIND_OF_SHEET: _of_sheet(usual),
        KIND_OF_STAGE + KIND_OF_SHEET: _of_sheet(anisotropic),
    }
    return {stage + kind: seconds for kind, stages in kinds.items() for stage, seconds in stages.items()}


def kind_of(stage: str) -> str:
    """What kind of BRDF a stage is of, "" for the usual one."""
    _, comma, kind = stage.partition(",")
    return comma + kind


def _of_sheet(stages: Mapping[str, float]) -> dict[str, float]:
    """The same, and before they are written the other sides: three more parts, which take as long each."""
    own = {stage: seconds for stage, seconds in stages.items() if stage != "writing"}
    return {**own, STAGE: 3 * sum(own.values()), "writing": stages["writing"]}


def _brdf_stages(settings: BakeSettings) -> dict[str, float]:
    size = (settings.usual_resolution / 64) ** 3
    # One descent in the normal-vector basis, two in the half-vector basis.
    descents = ("normal" in settings.bases) + 2 * ("half" in settings.bases)
    given = settings.spacing in ("identity", "uniform", "squared") or not isinstance(settings.alpha, str)
    fits = settings.tries_spline and settings.spline != "plain"
    # Of sizes that are tried: seconds from 2.7 to 131 kB.
    tried = 0.02 * settings.table_bytes**0.5 if settings.table_bytes else 0.0
    return {
        "reading": 0.5,
        "choosing grid": 0.3 if given else 1.0 * descents,
        "tabulating": 0.5 * size + tried,
        "fitting spline": 2.6 * size if fits else 0.0,
        "sampler": 0.9 + 0.3 * size,
        "measuring": 0.4,
        "envelope": 5.0 + 1.2 * size + tried if settings.envelope else 0.0,
        "writing": 0.4 + 0.2 * size,
    }


def _anisotropic_stages(settings: BakeSettings) -> dict[str, float]:
    """As `_brdf_stages`: sampler and envelope have sizes of their own, and take most of the time."""
    size = (settings.usual_resolution / 64) ** 3
    fits = settings.filter == "bspline" and settings.spline != "plain"
    kinds = 6 if len(settings.bases) > 1 else 2
    return {
        "choosing grid": 0.5 * kinds,
        "tabulating": 0.6 * size,
        "fitting spline": 6.0 * size if fits else 0.0,
        "sampler": 4.5,
        "measuring": 2.0,
        "envelope": 22.0 if settings.envelope else 0.0,
        "writing": 0.3 + 0.5 * size,
    }


def _arc_stages(settings: ArcSettings) -> dict[str, float]:
    """Of ten photographs of 2 megapixels; only the proportions matter."""
    reading = {"reading": 2.0, "aligning": 1.5 if settings.stack.align != "off" else 0.0}
    return {
        **reading,
        **({} if settings.through is None else {stage + STAGE_BEHIND: seconds for stage, seconds in reading.items()}),
        "averages and slices": 0.3,
        "predicting photographs": 0.5,
        "making it tile": 8.0 if settings.tileable != "off" else 0.0,
        "compressing": {"none": 0.4, "power": 1.0, "basis": 1.5}[settings.compression],
        "measuring": 0.5,
        "writing": 0.6,
    }


# What a person reads of those stages whose names are the workshop's.
_WORDS = {
    "choosing grid": "choosing the table",
    "tabulating": "filling the table",
    "sampler": "preparing directions",
    "envelope": "fitting Cycles' shaders",
    STAGE: "what the sheet lets through",
    "averages and slices": "sorting by light",
}


def stage_words(stage: str) -> str:
    """A stage as a person reads it."""
    plain = stage.removesuffix(kind_of(stage))
    return _WORDS.get(plain, plain)


def share_done(stages: Mapping[str, float], stage: str, share: float) -> float:
    """Share of the whole, given the share of one stage; 0 for a stage that is not known."""
    if stage not in stages:
        return 0.0
    names = [name for name in stages if kind_of(name) == kind_of(stage)]
    before = sum(stages[name] for name in names[: names.index(stage)])
    return (before + share * stages[stage]) / max(sum(stages[name] for name in names), 1e-9)
