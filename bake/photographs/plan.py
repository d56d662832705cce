"""What the headers of all photographs say together, before a pixel is read."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Facts
from .brackets import Exposures, find_exposures, group_by_light, report
from .encoding import Encoding, choose_encoding
from .folder import list_names
from .frame import Placement, check_inside, place
from .photograph import PhotoInfo
from .radiometry.color_marks import NOTHING
from .settings import StackSettings

MAX_STACK_BYTES = 4 << 30
_JPEG_NOTE = "the tone curve of a camera's JPEG is not documented: decoding it by a standard curve is an assumption"


@dataclass
class Plan:
    """Photographs, which of them share a light, how strong that was, and how each is to be decoded and placed."""

    paths: list[Path]
    groups: list[list[int]]
    names: list[str]
    directions: NDArray[np.float64] | None
    encodings: list[Encoding]
    exposures: Exposures
    turn_upright: bool
    size: tuple[int, int]
    placement: Placement
    intensities: NDArray[np.float64] | None = None
    warnings: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)


def plan_reading(
    paths: list[Path],
    infos: list[PhotoInfo],
    directions: NDArray[np.float64] | None,
    settings: StackSettings,
    intensities: NDArray[np.float64] | None = None,
) -> Plan:
    """Judge the headers together. Raises BakeError on two sizes, a single light, or too large a stack."""
    warnings: list[str] = []
    turn_upright = len({info.orientation for info in infos}) == 1
    if not turn_upright:
        warnings.append("orientation tags differ between the photographs and are ignored")
    size = _common_size(paths, infos, turn_upright)
    groups = group_by_light(paths, directions)
    if len(groups) < 2:
        what = "one photograph" if len(paths) == 1 else f"{len(paths)} photographs of one light"
        raise BakeError(paths[0].parent, f"holds {what} only", "a shading map needs two lights or more, better ten")
    exposures = find_exposures(paths, infos, groups)
    groups = [sorted(group, key=lambda k: exposures.relative[k]) for group in groups]
    chosen = [choose_encoding(path, info, settings.decode) for path, info in zip(paths, infos)]
    placement = place(paths[0], *size, settings)
    if settings.white_card is not None:
        check_inside(paths[0], settings.card_word, settings.white_card, *size)
    needed = len(groups) * placement.width * placement.height * 12
    if needed > MAX_STACK_BYTES:
        cause = f"needs {needed / 2**30:.1f} GiB as {len(groups)} x {placement.width} x {placement.height} texels"
        raise BakeError(paths[0].parent, cause, "give a smaller size or crop")
    warnings += _doubts(paths, infos, settings, exposures) + _said_of(paths, chosen)
    facts = {
        "photographs": len(paths),
        "decoding": _decoding_facts(infos, chosen, settings.decode),
        "exposure": report(paths, groups, exposures, infos),
    }
    return Plan(
        paths=paths,
        groups=groups,
        names=[" + ".join(paths[k].name for k in group) for group in groups],
        directions=None if directions is None else directions[[group[0] for group in groups]],
        encodings=chosen,
        exposures=exposures,
        turn_upright=turn_upright,
        size=size,
        placement=placement,
        intensities=None if intensities is None else intensities[[group[0] for group in groups]],
        warnings=warnings,
        facts=facts,
    )


def _common_size(paths: list[Path], infos: list[PhotoInfo], turn_upright: bool) -> tuple[int, int]:
    sizes = [
        (info.height, info.width) if turn_upright and info.orientation >= 5 else (info.width, info.height)
        for info in infos
    ]
    for path, size in zip(paths, sizes):
        if size != sizes[0]:
            cause = f"is {size[0]} x {size[1]}, but {paths[0].name} is {sizes[0][0]} x {sizes[0][1]}"
            raise BakeError(path, cause, "give photographs of one size, from one fixed camera")
    return sizes[0]


def _doubts(paths: list[Path], infos: list[PhotoInfo], settings: StackSettings, exposures: Exposures) -> list[str]:
    warnings = []
    alpha = [path.name for path, info in zip(paths, infos) if info.channels in (2, 4)]
    if alpha:
        warnings.append(f"alpha is ignored: {list_names(alpha)}")
    for doubt in dict.fromkeys(info.pages for info in infos if info.pages):
        warnings.append(
            f"{doubt}: {list_names([path.name for path, info in zip(paths, infos) if info.pages == doubt])}"
        )
    if any(info.automatic_white for info in infos):
        warnings.append("the camera chose the white balance itself, so colours may differ between the photographs")
    if settings.decode != "auto" and all(info.format in ("openexr", "hdr") for info in infos):
        warnings.append(f"decode {settings.decode} has no effect on EXR and HDR, which are linear")
    assumed = [path.name for path, info in zip(paths, infos) if info.format == "tiff" and not info.is_float]
    if assumed and settings.decode == "auto" and all(info.color == NOTHING for info in infos):
        warnings.append("TIFF files that do not say so are taken as sRGB; RAW developed linearly needs decode linear")
    if exposures.rule.startswith(("Exif:", "EV")):
        low, high = min(exposures.relative), max(exposures.relative)
        warnings.append(f"exposures differ by a factor of {high / low:.3g} and were divided out ({exposures.rule})")
    return warnings


def _said_of(paths: list[Path], encodings: list[Encoding]) -> list[str]:
    """Warnings of the encodings, each once, with the photographs that it concerns."""
    names: dict[str, list[str]] = {}
    for path, encoding in zip(paths, encodings):
        for warning in encoding.warnings:
            names.setdefault(warning, []).append(path.name)
    return [warning.format(list_names(concerned)) for warning, concerned in names.items()]


def _decoding_facts(infos: list[PhotoInfo], chosen: list[Encoding], rule: str) -> Facts:
    used = Counter((encoding.name, encoding.why, encoding.space) for encoding in chosen)
    matrices = {encoding.space: encoding.matrix for encoding in chosen if encoding.matrix is not None}
    facts: dict[str, Any] = {"asked": rule, "used": []}
    for (name, why, space), count in used.items():
        entry: dict[str, Any] = {"rule": name, "why": why, "photographs": count}
        if space in matrices:
            entry["converted"] = f"{space} to linear Rec.709"
            entry["matrix"] = np.round(matrices[space], 6).tolist()
        facts["used"].append(entry)
    if any(info.format == "jpeg" for info in infos):
        facts["note"] = _JPEG_NOTE
    return facts
