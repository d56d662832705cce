"""Read a stack of photographs of a flat swatch: fixed view, light from several directions.

Such a stack, sorted by its average radiance, is the input of a
shading map (Kautz et al. 2004).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..source import Facts, Json
from . import shifts
from .brackets import bracket_stem
from .calibration import calibrate_by_albedo, calibrate_by_card
from .development import Counts, Development
from .flat_field import FlatField
from .folder import find_photographs
from .frame import Placement, upright
from .light_files.spheres import DOUBTFUL_DEG, lights_on_spheres
from .lights import STRENGTHS, Lights, choose_arc, find_lights, keep_lights
from .photograph import Decoder, PhotoInfo, read_info, read_photograph
from .plan import Plan, plan_reading
from .settings import StackSettings
from .verdict import judge_brightness, judge_elevations, shift_report

Progress = Callable[[str, float], None]

# What such a source is called, in bundles and for people.
FORMAT = "photographs of a swatch"


@dataclass(frozen=True, eq=False)
class PhotoStack:
    """Linear photographs of one swatch, one per light.

    images : (n, H, W, 3), exposure divided out; f cos(theta_i) in 1/sr where `calibrated`, else relative
    names : file name per image, joined by " + " where exposures were merged
    directions : (n, 3) unit vectors to the light, x right, y up, z to the camera; None where not known
    calibrated : whether a white card or an albedo fixed the scale
    warnings : one line each, for the user
    facts : JSON-ready account of what was read, assumed and corrected
    """

    images: NDArray[np.float32]
    names: tuple[str, ...]
    directions: NDArray[np.float64] | None
    calibrated: bool
    warnings: tuple[str, ...]
    facts: dict[str, Any] = field(default_factory=dict)

    def in_order(self, averages: NDArray[np.float64], order: NDArray[np.intp]) -> Facts:
        """Names, elevations in degrees where known, and averages of the photographs in this order; JSON-ready."""
        elevations = None
        if self.directions is not None:
            sines = np.clip(self.directions[order, 2], -1, 1)
            elevations = [round(float(e), 3) for e in np.degrees(np.arcsin(sines))]
        return {
            "photographs": [self.names[k] for k in order],
            "elevations_deg": elevations,
            "before": averages[order].tolist(),
        }


@dataclass(frozen=True, eq=False)
class FoundStack:
    """Photographs whose headers and lights are known, whichever of them a stack is then planned of.

    warnings : one line each, for the user
    """

    origin: Path
    infos: dict[Path, PhotoInfo]
    lights: Lights
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PlannedStack:
    """Photographs whose headers have been read: which belong to the stack, how they are lit, decoded and placed.

    warnings, facts : of the lights
    """

    settings: StackSettings
    origin: Path
    plan: Plan
    warnings: tuple[str, ...]
    facts: dict[str, Any]


def read_stack(
    source: Path | str | Sequence[Path | str],
    settings: StackSettings | None = None,
    progress: Progress | None = None,
    decoder: Decoder | None = None,
) -> PhotoStack:
    """Photographs of a folder, or the given files, as a stack in natural order of their names.

    Parameters
    ----------
    source : folder (its subfolders are not entered) or photographs: JPEG, PNG, TIFF, EXR, HDR
    settings : see `StackSettings`
    progress : called with the stage ("reading", "aligning") and its share done
    decoder : reads a photograph where neither OpenImageIO nor numpy can; it must refuse a header above `MAX_PIXELS`

    Raises
    ------
    BakeError : a file that is no image, damaged, too large or not finite; two sizes; fewer than two lights; all black
        or all clipped; a crop or corner outside; unusable lights, exposures, card or flat field
    """
    if progress is not None:
        progress("reading", 0.0)
    return read_planned(plan_stack(source, settings, decoder), progress, decoder)


def plan_stack(
    source: Path | str | Sequence[Path | str], settings: StackSettings | None = None, decoder: Decoder | None = None
) -> PlannedStack:
    """What `read_stack` does before it reads pixels; it raises BakeError for all that headers and lights show."""
    settings = settings or StackSettings()
    return plan_found(find_stack(source, settings, decoder), settings)


def find_stack(
    source: Path | str | Sequence[Path | str], settings: StackSettings, decoder: Decoder | None = None
) -> FoundStack:
    """Photographs with their headers and lights, by mirror spheres those in the pictures. Raises BakeError."""
    paths, warnings = find_photographs(source, (settings.lights, settings.flat_field))
    origin = paths[0].parent
    infos = {path: read_info(path, decoder) for path in paths}  # also of those left out: a broken file is never silent
    if settings.spheres:
        found = lights_by_spheres(paths, [infos[path] for path in paths], settings, decoder)
    else:
        found = find_lights(paths, settings.lights, isinstance(source, str | Path), settings.behind)
    return FoundStack(origin, infos, found, tuple(warnings))


def plan_found(found: FoundStack, settings: StackSettings) -> PlannedStack:
    """A stack of those photographs that lie on the arc of the settings. Raises BakeError."""
    lights = choose_arc(found.origin, found.lights, settings.azimuth, settings.spread, settings.sides)
    headers = [found.infos[path] for path in lights.paths]
    plan = plan_reading(lights.paths, headers, lights.directions, settings, lights.intensities)
    warnings = (*found.warnings, *lights.warnings, *plan.warnings)
    return PlannedStack(settings, found.origin, plan, warnings, lights.facts)


def lights_by_spheres(
    paths: list[Path], infos: list[PhotoInfo], settings: StackSettings, decoder: Decoder | None = None
) -> Lights:
    """Directions of the lights by mirror spheres in each photograph.

    Photographs whose names differ by an exposure mark alone have the light of the shortest that shows a highlight:
    there it is the smallest. Raises BakeError.
    """
    turn = len({info.orientation for info in infos}) == 1
    # Brightness of the picture, the light, and by how much spheres differ, with the name.
    directions: dict[tuple[Path, str], tuple[float, NDArray[np.float64], float, str]] = {}
    dark: dict[tuple[Path, str], BakeError] = {}
    keys = [(path.parent, bracket_stem(path.stem)) for path in paths]
    for path, info, key in zip(paths, infos, keys, strict=True):
        pixels = upright(read_photograph(path, decoder).pixels, info.orientation if turn else 1)
        try:
            direction, off = lights_on_spheres(path, pixels, settings.spheres)
        except BakeError as error:  # of a bracket another exposure may show it
            dark[key] = error
            continue
        brightness = float(pixels.mean(dtype=np.float64))
        if key not in directions or brightness < directions[key][0]:
            directions[key] = brightness, direction, off, path.name
    for key in keys:
        if key not in directions:
            raise dark[key]
    warnings = []
    if settings.crop is None and settings.corners is None:
        warnings.append("the spheres lie in the picture that is read: crop to the swatch, or give its corners")
    off, name = max((off, name) for *_, off, name in directions.values())
    if off > DOUBTFUL_DEG:
        warnings.append(
            f"the spheres of {name} tell lights {off:.0f} degrees off their mean: the lamp was near, or a circle is "
            "not on its sphere"
        )
    facts = {"source": "spheres", "spheres": [list(sphere) for sphere in settings.spheres]}
    return keep_lights(paths[0].parent, paths, [tuple(directions[key][1].tolist()) for key in keys], warnings, facts)


def read_planned(planned: PlannedStack, progress: Progress | None = None, decoder: Decoder | None = None) -> PhotoStack:
    """The photographs themselves, as `read_stack` does."""
    say = progress or (lambda stage, share: None)
    settings, origin, plan, warnings = planned.settings, planned.origin, planned.plan, [*planned.warnings]
    images, cards, counts, flat = _read_images(plan, settings, decoder, warnings, say)
    names = plan.names
    judgement = judge_brightness(origin, names, images, counts, warnings)

    directions = plan.directions
    if directions is not None:
        warnings += judge_elevations(images, directions)
    aligned: dict[str, Any] = {"mode": settings.align}
    border = (0, 0, 0, 0)
    if settings.align != "off":
        say("aligning", 0.0)
        found = shifts.measure(images, directions)
        aligned |= shift_report(names, found, settings.align == "auto", warnings)
        if settings.align == "auto":
            images, border = shifts.correct(images, found)
        say("aligning", 1.0)
    calibration = _calibrate(origin, names, images, cards, directions, settings)
    if directions is not None and plan.placement.turn:
        directions = _turned(directions, plan.placement.turn)
    facts = {
        **plan.facts,
        "lights": planned.facts,
        "frame": _frame_facts(plan, settings, images, border),
        "flat_field": flat,
        **judgement,
        "alignment": aligned,
        "calibration": calibration,
    }
    if _divides(plan, settings):
        facts["strengths"] = STRENGTHS
    return PhotoStack(images, tuple(names), directions, bool(calibration["by"]), tuple(warnings), facts)


def _divides(plan: Plan, settings: StackSettings) -> bool:
    """Whether photographs are divided by how strong their lights were: a white card or a flat field has seen those."""
    return plan.intensities is not None and settings.white_card is None and settings.flat_field is None


def _read_images(
    plan: Plan, settings: StackSettings, decoder: Decoder | None, warnings: list[str], say: Progress
) -> tuple[NDArray[np.float32], NDArray[np.float64] | None, list[Counts], Facts | None]:
    """Images (n, H, W, 3), card means (n, 3), counts, facts of the flat field."""
    placement, card = plan.placement, settings.white_card
    flat = None
    if settings.flat_field is not None:
        flat = FlatField(settings.flat_field, settings.decode, plan.turn_upright, plan.size, decoder)
    images = np.empty((len(plan.groups), placement.height, placement.width, 3), np.float32)
    cards = np.zeros((len(plan.groups), 3))
    counts, clipped_cards = [], []
    for k, group in enumerate(plan.groups):
        view = Development(
            [plan.paths[i] for i in group],
            [read_photograph(plan.paths[i], decoder) for i in group],
            [plan.encodings[i] for i in group],
            [plan.exposures.relative[i] for i in group],
            plan.turn_upright,
        )
        if view.size != plan.size:
            raise BakeError(view.paths[0], "changed while it was read", "try again")
        if len({plan.exposures.relative[i] for i in group}) < len(group):
            view.check_repeats(placement.region)
        images[k] = view.swatch(placement)
        if plan.intensities is not None and _divides(plan, settings):
            images[k] /= plan.intensities[k].astype(np.float32)
        if card is not None:
            cards[k], clipped = view.mean(card)
            clipped_cards += [plan.names[k]] if clipped > 0.05 else []
        if flat is not None:
            gain, at_card = flat.gains(view.paths, placement, card)
            images[k] /= gain
            cards[k] /= 1 if at_card is None else at_card
        counts.append(view.counts)
        say("reading", (k + 1) / len(plan.groups))
    if clipped_cards:
        warnings.append(
            f"the {settings.card_word} is clipped, so its scale is too low a guess: {', '.join(clipped_cards[:8])}"
        )
    return images, None if card is None else cards, counts, None if flat is None else flat.facts


def _calibrate(
    origin: Path,
    names: list[str],
    images: NDArray[np.float32],
    cards: NDArray[np.float64] | None,
    directions: NDArray[np.float64] | None,
    settings: StackSettings,
) -> Facts:
    cosines = None if directions is None else directions[:, 2]
    facts: dict[str, Json]
    if cards is not None:
        facts = dict(calibrate_by_card(names, images, cards, cosines, settings.white_reflectance, settings.card_word))
    elif settings.albedo is not None:
        facts = dict(calibrate_by_albedo(images, cosines, settings.albedo, settings.share_word))
    else:
        facts = {"by": "", "how": "none: values are relative"}
    if not np.isfinite(images).all():
        remedy = f"check the {settings.card_word} or the photographs"
        raise BakeError(origin, "cannot be calibrated: the scale is out of range", remedy)
    return facts


def _turned(directions: NDArray[np.float64], turn: float) -> NDArray[np.float64]:
    """Directions in the frame of a swatch whose x axis stands at angle `turn` in the photograph."""
    x, y, z = directions.T
    return np.stack([x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn), z], axis=-1)


def _frame_facts(
    plan: Plan, settings: StackSettings, images: NDArray[np.float32], border: tuple[int, int, int, int]
) -> Facts:
    placement: Placement = plan.placement
    return {
        "photograph": list(plan.size),
        "crop": list(settings.crop) if settings.crop else None,
        "corners": [list(corner) for corner in settings.corners] if settings.corners else None,
        "turned_deg": round(float(np.degrees(placement.turn)), 3),
        "pixels_per_texel": round(placement.scale, 4),
        "border_cut": list(border),
        "size": [images.shape[2], images.shape[1]],
    }
