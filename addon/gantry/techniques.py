"""The four techniques of Kautz et al. 2004, figure 6, on a flat swatch under distant lights, without noise.

A flat patch seen by parallel rays has one wi per light and one wo: what a shading map's material shows is then a sum
over the lights, which numpy evaluates as the shader nodes do. Beside it stands what the gantry sees of the geometry
itself, lit and viewed alike; `errors` measures how far they are apart.

Where the lights agree with those of the photographs, "lookup" and "final_radiance" are the same; a light of another
strength parts them, since the second takes a bright light for one that stands high.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...bake.brdf.preview_sphere import to_srgb
from ...bake.bundle.bundle import Bundle
from ...bake.errors import BakeError
from ...bake.images.bilinear import sampled
from ...bake.lobes.lobe_fit import fit_lobe
from ...bake.lobes.lobes import Lobe
from ...bake.shading_maps.albedo import resolved_scale
from ...bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.shading_maps.render_settings import TECHNIQUES, RenderSettings
from ...bake.shading_maps.shading_map import Above, ShadingMap
from ...bake.source import luminance

Array = NDArray[Any]
Angles = tuple[float, float]

# In the order of the figure, from the simplest to the paper's own.
LABELS = {
    "lit_texture": "lit texture",
    "final_radiance": "final radiance",
    "angular": "angular lookup",
    "lookup": "lookup by r",
}
IN_ORDER = tuple(LABELS)
_DARKEST_LEVEL = 1e-4  # of "angular", as in the nodes
_MIDDLE_GREY = 0.18


@dataclass(frozen=True, eq=False)
class MappedSwatch:
    """A shading map and how it is lit.

    Parameters
    ----------
    lobe : f_r
    sigma : r = sigma f_r cos(theta_i)
    a_max : r at the last slice, in 1/sr
    level_by_cosine : x of the photograph at even cosines of the light's angle from 0 to 1, for "angular"
    above : beyond the last slice
    around : of a swatch lit from every side the map over azimuth, by which all but "lit_texture" go; `map` is then its
        mean
    """

    map: ShadingMap
    lobe: Lobe
    sigma: float
    a_max: float
    level_by_cosine: Sequence[float]
    above: Above = "clamp"
    around: AzimuthBasis | None = None

    @property
    def gain(self) -> float:
        """x per f_r cos(theta_i)."""
        return self.sigma / self.a_max


@dataclass(frozen=True)
class Light:
    """A distant light: unit direction to it, and its irradiance on a plane facing it, grey or (3,)."""

    wi: tuple[float, float, float]
    irradiance: float | tuple[float, float, float] = 1.0


def mapped_swatch(bundle: Bundle, settings: RenderSettings | None = None, *, through: bool = False) -> MappedSwatch:
    """The bundle's map as its material shows it, that of reflected light or of what is let `through`.

    Raises BakeError, also where f_r is measured, or the swatch was not photographed against the light.
    """
    whole = ShadingMapRecord.read(bundle)
    record = whole.transmitted() if through else whole
    if record is None:
        raise BakeError(bundle.path, "was not photographed against the light", "bake it with --through FOLDER")
    settings = settings or whole.render
    stored, settings = record.map, settings.of_transmission(record.map.a_max is not None) if through else settings
    if settings.lobe is None:
        raise BakeError(bundle.path, "takes f_r from a measured BRDF", "choose a lobe")
    sigma, a_max = resolved_scale(settings, stored.a_max)
    around = record.load_azimuth() if stored.model == "azimuth" else None
    return MappedSwatch(record.load_map(), settings.lobe, sigma, a_max, stored.level_by_cosine, settings.above, around)


def shade(
    technique: str,
    swatch: MappedSwatch,
    lights: Iterable[Light],
    wo: Sequence[float],
    uv: Array,
    light_level: float = 1.0,
) -> NDArray[np.float64]:
    """Radiance (..., 3) that leaves a flat patch of the swatch towards wo.

    Parameters
    ----------
    technique : one of `RenderSettings.technique`; "final_radiance" as EEVEE shows it, but with f_r itself
    wo : unit direction to the viewer
    uv : (..., 2)
    light_level : irradiance that the photographs' light stands for, of "final_radiance"

    Raises
    ------
    ValueError : unknown technique
    """
    if technique not in TECHNIQUES:
        raise ValueError(f"there is no technique {technique!r}")
    lights = list(lights)
    lit = [(light.wi, _f_cos(swatch.lobe, light, wo), np.asarray(light.irradiance)) for light in lights]
    if technique == "final_radiance":
        radiance = sum((f_cos * irradiance * np.ones(3) for _, f_cos, irradiance in lit), np.zeros(3))
        brightness = float(luminance(radiance))
        texel = _texels(swatch, uv, brightness * swatch.gain / light_level, _azimuth_on_the_whole(lights), "scale")
        return texel * radiance * (light_level * swatch.a_max / max(brightness, 1e-30))
    total = np.zeros((*np.shape(uv)[:-1], 3))
    for wi, f_cos, irradiance in lit:
        total += irradiance * _reflected(technique, swatch, wi, f_cos, uv)
    return total


def _f_cos(lobe: Lobe, light: Light, wo: Sequence[float]) -> float:
    return float(lobe.value(np.array(light.wi), np.array(wo))) * max(float(light.wi[2]), 0.0)


def _reflected(technique: str, swatch: MappedSwatch, wi: Sequence[float], f_cos: float, uv: Array) -> Array:
    """Of one light of irradiance 1."""
    phi = math.atan2(wi[1], wi[0])
    if technique == "lookup":
        return swatch.a_max * _texels(swatch, uv, f_cos * swatch.gain, phi, swatch.above)
    if technique == "lit_texture":
        return _slices_at(swatch.map, 1.0, uv) * (swatch.sigma * f_cos)
    knots = np.linspace(0, 1, len(swatch.level_by_cosine))
    level = max(float(np.interp(wi[2], knots, swatch.level_by_cosine)), _DARKEST_LEVEL)
    return _texels(swatch, uv, level, phi, "clamp") * (swatch.sigma * f_cos / level)


def _texels(swatch: MappedSwatch, uv: Array, x: float, phi: float, above: Above) -> Array:
    """The map at one level, lit from one azimuth where it knows of any.

    What is linear comes first: the swatch at that level once, then its texels at every uv.
    """
    if swatch.around is None:
        value = _slices_at(swatch.map, x, uv)
    else:
        value = np.maximum(sampled(swatch.around.coefficients @ swatch.around.weights(x, phi), uv), 0)
    return value * max(x, 1.0) if above == "scale" else value


def _slices_at(shading_map: ShadingMap, x: float, uv: Array) -> Array:
    position = min(x, 1.0) * (len(shading_map.slices) - 1)
    base = min(int(position), len(shading_map.slices) - 2)
    low, high = (sampled(one, uv) for one in shading_map.slices[base : base + 2])
    return low + (position - base) * (high - low)


def _azimuth_on_the_whole(lights: Iterable[Light]) -> float:
    """Of the lights above the plane together, each by its luminance, as EEVEE finds it."""
    towards = np.zeros(2)
    for light in lights:
        if light.wi[2] > 0:
            towards += np.array(light.wi[:2]) * float(luminance(light.irradiance * np.ones(3)))
    return math.atan2(towards[1], towards[0])


# --- frames of the gantry -------------------------------------------------------------------------------


def direction(elevation: float, azimuth: float) -> tuple[float, float, float]:
    """Unit vector of an elevation above the plane and an azimuth from +u towards +v, in degrees."""
    e, a = math.radians(elevation), math.radians(azimuth)
    return math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)


def frame_uv(size: int, view: Angles = (0.0, 0.0), over: int = 1) -> NDArray[np.float64]:
    """Texture coordinates of the gantry's pixels on the plane of the swatch, (size over, size over, 2).

    Parameters
    ----------
    view : (theta, phi) in radians, as in `gantry.Gantry.set_view`
    over : points along a pixel's edge; `pixels` averages them
    """
    theta, phi = view
    towards = np.array((math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)))
    up = np.array((0.0, 1.0, 0.0)) - towards[1] * towards
    up /= np.linalg.norm(up)
    right = np.cross(up, towards)
    offset = (np.arange(size * over) + 0.5) / (size * over) - 0.5
    point = offset[None, :, None] * right - offset[:, None, None] * up
    return 0.5 + (point - towards * (point[..., 2:] / towards[2]))[..., :2]


def pixels(picture: Array, over: int) -> Array:
    """Means over blocks of over x over points."""
    height, width = picture.shape[0] // over, picture.shape[1] // over
    return picture.reshape(height, over, width, over, -1).mean(axis=(1, 3))


class SeesFrames(Protocol):
    """Interface that `photograph` needs of a `gantry.Gantry`."""

    def set_light(self, theta: float, phi: float) -> None:
        """Place the light at a polar angle and azimuth, radians."""
        ...

    def set_view(self, theta: float, phi: float) -> None:
        """Place the camera at a polar angle and azimuth, radians."""
        ...

    def render(self, seed: int = 0) -> NDArray[np.float32]:
        """Render the frame as linear values (H, W, 3)."""
        ...


@dataclass(frozen=True)
class Case:
    """A picture to compare.

    Parameters
    ----------
    group : what it is a case of
    lights : (elevation, azimuth, irradiance), degrees
    view : (theta, phi) of the viewer in degrees
    """

    group: str
    lights: tuple[tuple[float, float, float], ...]
    view: Angles = (0.0, 0.0)

    @property
    def frames(self) -> list[tuple[Angles, Angles]]:
        """View and light of every frame that its truth is the sum of."""
        return [(self.view, light[:2]) for light in self.lights]

    @property
    def view_radians(self) -> Angles:
        """The view as the gantry takes it."""
        return math.radians(self.view[0]), math.radians(self.view[1])


Frames = dict[tuple[Angles, Angles], NDArray[np.float32]]


def photograph(gantry: SeesFrames, cases: Iterable[Case], seed: int = 0) -> Frames:
    """Frames of all the cases; light adds up, so that each is rendered under one sun of irradiance 1."""
    found: Frames = {}
    for view, light in sorted({frame for case in cases for frame in case.frames}):
        gantry.set_view(math.radians(view[0]), math.radians(view[1]))
        gantry.set_light(math.radians(90 - light[0]), math.radians(light[1]))
        found[view, light] = gantry.render(seed)
    return found


def truth(case: Case, frames: Frames) -> NDArray[np.float64]:
    """Picture of the geometry itself, (H, W, 3)."""
    parts = [np.float64(light[2]) * frames[case.view, light[:2]] for light in case.lights]
    return np.sum(parts, axis=0)


def shown(technique: str, swatch: MappedSwatch, case: Case, size: int) -> NDArray[np.float64]:
    """Picture of the map by a technique in the same frame, (size, size, 3)."""
    lights = [Light(direction(elevation, azimuth), irradiance) for elevation, azimuth, irradiance in case.lights]
    theta, phi = case.view
    # From above a pixel is a texel of the photographs; obliquely it covers parts of several.
    over = 1 if theta == 0 else 4
    uv = frame_uv(size, case.view_radians, over)
    return pixels(shade(technique, swatch, lights, direction(90 - theta, phi), uv), over)


def at_own_level(swatch: MappedSwatch, case: Case, frames: Frames, size: int) -> NDArray[np.float64]:
    """The lookup with r taken from the truth's own average: what an f_r that fits perfectly would show."""
    over = 1 if case.view[0] == 0 else 4
    uv = frame_uv(size, case.view_radians, over)
    total = np.zeros((size, size, 3))
    for light in case.lights:
        x = float(frames[case.view, light[:2]].mean()) / swatch.a_max
        total += light[2] * swatch.a_max * pixels(_slices_at(swatch.map, x, uv) * max(x, 1.0), over)
    return total


# --- f_r ------------------------------------------------------------------------------------------------


def fitted_render(lobe: str, elevations: Array, averages: Array) -> RenderSettings:
    """Lighting by the named lobe with the parameters and the sigma that fit calibrated averages. Raises BakeError.

    Averages seen from above say little of other views: the kind of lobe is better left to who knows the material.

    Parameters
    ----------
    elevations : (n,) of the light, radians
    averages : (n,) of the photographs, in 1/sr
    """
    best = fit_lobe(elevations, averages).candidates.get(lobe)
    if best is None:
        raise BakeError(f"lobe {lobe}", f"does not fit {len(averages)} photographs", "name another, or take more")
    return RenderSettings(best.lobe, scale_of(best.lobe, elevations, averages))


def scale_of(lobe: Lobe, elevations: Array, averages: Array) -> float:
    """sigma by which sigma f_r cos(theta_i) is nearest to the averages, all errors taken in parts of the average.

    So dim light counts as the eye counts it; by absolute errors a swatch that is bright from one side only would be
    too bright from all others.
    """
    seen = np.asarray(averages) > 0
    cosines = np.sin(np.asarray(elevations, np.float64)[seen])
    wi = np.stack([np.sqrt(1 - cosines**2), np.zeros_like(cosines), cosines], -1)
    ratio = lobe.value(wi, np.array([0.0, 0.0, 1.0])) * cosines / np.asarray(averages, np.float64)[seen]
    return float(ratio.sum() / np.square(ratio).sum())


# --- errors ---------------------------------------------------------------------------------------------


def errors(picture: Array, target: Array) -> dict[str, float]:
    """Errors of a picture against the truth, (H, W, 3) both.

    Returns
    -------
    "rms" : of the difference, in parts of the truth's RMS
    "mean" : of the picture relative to the truth's, minus 1
    "tones" : as "rms", of the values of each channel in rising order: how bright how much of it is, wherever it lies
    "display" : RMS of the difference as displayed in sRGB, 0 to 1, the truth exposed to middle grey
    """
    picture, target = np.asarray(picture, np.float64), np.asarray(target, np.float64)
    scale = max(_rms(target), 1e-30)
    exposure = _MIDDLE_GREY / max(float(target.mean()), 1e-30)
    tones = np.sort(picture.reshape(-1, 3), axis=0) - np.sort(target.reshape(-1, 3), axis=0)
    return {
        "rms": _rms(picture - target) / scale,
        "mean": float(picture.mean()) / max(float(target.mean()), 1e-30) - 1,
        "tones": _rms(tones) / scale,
        "display": _rms(to_srgb(picture * exposure) - to_srgb(target * exposure)),
    }


def mean_errors(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Over several pictures: root mean squares, the sign of a "mean" being lost."""
    return {key: float(np.sqrt(np.mean([row[key] ** 2 for row in rows]))) for key in rows[0]}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.square(values).mean()))
