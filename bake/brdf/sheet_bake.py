"""The parts of a sheet beside its front's reflection: transmission of both sides, and the back's reflection."""

from __future__ import annotations

from ..bundle.bundle import StoredImage
from ..bundle.result import Progress
from ..source import Json, SheetSource
from ..tables.accuracy import direction_pairs
from ..tables.sheet import sheet_views
from .part_bake import PartBake
from .reflection import reflection_of, transmission_of
from .settings import BakeSettings

STAGE = "other sides"
# Behind the names of the stages of a sheet's bake, of which this one takes most.
KIND_OF_SHEET = ", sheet"
# Shares of a part's time at the end of each of its stages, without an envelope and with one.
_ENDS = {
    "choosing grid": (0.3, 0.1),
    "tabulating": (0.45, 0.15),
    "fitting spline": (0.7, 0.25),
    "sampler": (0.85, 0.35),
    "measuring": (1.0, 0.4),
    "envelope": (1.0, 1.0),
}
_FEW = 512


def sheet_parts(
    sheet: SheetSource, settings: BakeSettings, say: Progress, pairs: int
) -> tuple[dict[str, Json], dict[str, StoredImage]]:
    """The entry "sheet" of a material.json, and images behind the names of their parts.

    A part is what a BRDF's bake has but for source and settings. One that is black is left out.

    Parameters
    ----------
    pairs : of directions that errors are measured at

    Raises
    ------
    BakeError : as `bake_source`
    """
    views, found = sheet_views(sheet), dict[str, dict[str, Json]]()
    column = int(settings.envelope)
    images: dict[str, StoredImage] = {}
    few = direction_pairs(_FEW, turned=not sheet.isotropic)
    for done, (part, view) in enumerate(views.items()):
        say(STAGE, done / len(views))
        if not view.evaluate(few.wi, few.wo).any():
            continue
        bake = PartBake(view, settings, _within(say, done, len(views), column), pairs)
        baked = bake.baked(reflection_of if part == "behind" else transmission_of, front=False)
        found[part] = {**baked.facts, "treatment": bake.treatment}
        images |= {f"{part}_{name}": image for name, image in baked.images.items()}
    return {"alike": sheet.alike, **found}, images


def _within(say: Progress, done: int, count: int, column: int) -> Progress:
    """Progress of the bake of one part, as a share of all parts."""
    ends = {stage: end[column] for stage, end in _ENDS.items()}
    begins = dict(zip(ends, (0.0, *ends.values())))

    def told(stage: str, share: float) -> None:
        say(STAGE, (done + begins[stage] + share * (ends[stage] - begins[stage])) / count)

    return told
