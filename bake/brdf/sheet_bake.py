"""The parts of a sheet beside its front's reflection: transmission of both sides, and the back's reflection."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..bundle.bundle import StoredImage
from ..bundle.result import Progress
from ..source import Facts, Json, SheetSource
from ..tables.accuracy import direction_pairs
from ..tables.sheet import sheet_views, side_energy
from .part_bake import PartBake
from .reflection import reflection_of, transmission_of
from .settings import BakeSettings

STAGE = "other sides"
_FEW = 512


def sheet_parts(
    sheet: SheetSource, front: Mapping[str, Any], settings: BakeSettings, say: Progress, pairs: int
) -> tuple[dict[str, Json], dict[str, StoredImage]]:
    """The entry "sheet" of a material.json, and images behind the names of their parts.

    A part is what a BRDF's bake has but for source and settings. One that is black is left out.

    Parameters
    ----------
    front : facts of the reflection that is baked already
    pairs : of directions that errors are measured at

    Raises
    ------
    BakeError : as `bake_source`
    """
    views, found = sheet_views(sheet), dict[str, dict[str, Json]]()
    images: dict[str, StoredImage] = {}
    few = direction_pairs(_FEW, turned=not sheet.isotropic)
    for done, (part, view) in enumerate(views.items()):
        say(STAGE, done / len(views))
        if not view.evaluate(few.wi, few.wo).any():
            continue
        bake = PartBake(view, settings, lambda stage, share: None, pairs)
        baked = bake.baked(reflection_of if part == "behind" else transmission_of, front=False)
        found[part] = {**baked.facts, "treatment": bake.treatment}
        images |= {f"{part}_{name}": image for name, image in baked.images.items()}
    return {"alike": sheet.alike, **found, "energy": _energy(front, found)}, images


def _energy(front: Mapping[str, Any], found: Mapping[str, Mapping[str, Any]]) -> Facts:
    """Of each side that lets light through, as `side_energy`."""
    sides = ("front", front, found.get("through")), ("behind", found.get("behind"), found.get("through_behind"))
    return {
        name: side_energy(reflected["albedo"], through["albedo"]) if reflected else side_energy(through["albedo"])
        for name, reflected, through in sides
        if through is not None
    }
