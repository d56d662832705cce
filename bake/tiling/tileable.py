"""Making a stack of slices tile: one common set of seams, so that the mesostructure stays the same in each slice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from ..errors import BakeError, check_choice, check_setting
from ..source import Array, Facts
from .offset import OffsetPlan, plan_offset
from .quilt import QuiltPlan, patch_count, plan_quilt
from .seams import shrink, stack_features
from .straighten import find_shear
from .visibility import seam_facts

Method = Literal["auto", "offset", "quilt"]
Progress = Callable[[str, float], None]

SMALLEST_SIDE = 16
LARGEST_SIDE = 8192
_BRIGHTEST = 1e30  # keeps sums of single-precision values finite
MAX_VALUES = 1 << 29  # numbers in a stack, 2 GiB; about thrice that is needed while tiling
_GOOD_ENOUGH = 1.15  # visibility of seams up to which "auto" is content with offset and cut
_WORTH_STRAIGHTENING = 0.8  # visibility over what it was: resampling costs sharpness
_WORTH_QUILTING = 0.85  # likewise: quilting repeats texels and mixes up yarns of different tone
_DRIFT = 0.1  # of the means: as much as quilting may change a swatch unless "offset" changes it more
_MOST_PATCHES = 2048
_SMALLEST_PATCH = 32
_LEVEL_FLOOR = 0.2  # share of the mean below which a surface fit is not believed
_NAME = "slices"


@dataclass(frozen=True)
class TileSettings:
    """Settings of tiling.

    Parameters
    ----------
    method : "offset" overlaps the swatch with itself at the period that fits best and cuts once in either direction:
        nearly all of it stays as photographed. "quilt" joins patches from all over the swatch. "auto" quilts only
        where the seams of "offset" show, and takes that if it is clearly better and keeps the means
    keep : smallest share of width and height that may be left, 0.5 to 0.9
    feather : texels; blends over about twice as much to either side of a cut, 0 for none
    patch : texels of a quilting patch, by default a quarter of the tile's shorter side and at least 32; should exceed
        the largest structure that must stay whole
    straighten : let a swatch whose threads run up to 2 degrees off the frame be sheared straight (bilinear) where it
        does not tile without
    level : remove each slice's slow change of brightness over the frame first, as uneven light leaves it
    seed : of the quilting's random choices
    """

    method: Method = "auto"
    keep: float = 0.6
    feather: int = 1
    patch: int | None = None
    straighten: bool = True
    level: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("method", self.method, get_args(Method))
        check_setting("keep", _is_number(self.keep) and 0.5 <= self.keep <= 0.9, "from 0.5 to 0.9", self.keep)
        check_setting(
            "feather", _is_whole(self.feather) and 0 <= self.feather <= 32, "from 0 to 32 texels", self.feather
        )
        patch_ok = self.patch is None or (_is_whole(self.patch) and 8 <= self.patch <= LARGEST_SIDE)
        check_setting("patch", patch_ok, f"from 8 to {LARGEST_SIDE} texels, or none", self.patch)
        check_setting("seed", _is_whole(self.seed) and self.seed >= 0, "a whole number from 0", self.seed)


@dataclass(frozen=True)
class Tiled:
    """The result.

    Parameters
    ----------
    slices : (N, H', W', 3) float32 that tile in both directions; not larger than the swatch
    source : (H', W', 2) int32, texel (y, x) of the swatch that each texel mostly shows
    facts : JSON-ready: "method"; "straightened"; "size" (width, height); "seams" ("before", the swatch simply repeated,
        and "after", see `seam_facts`); "used", the share of the swatch's texels that the tile shows; "repeated", the
        share of the tile that shows a texel again; "variance_seen", the share of the stack's variance that cuts are
        chosen by; "means", after over before of each slice that is not black; "means_spread", the largest over the
        smallest of these minus 1: how far slices have come apart. Photographs tiled before their radiance is averaged
        do not come apart at all
    """

    slices: Array
    source: Array
    facts: dict[str, Any]


def make_tileable(slices: Array, settings: TileSettings | None = None, progress: Progress | None = None) -> Tiled:
    """Tile all slices of a swatch, or all photographs of a stack, with the same cuts and the same blends.

    Every texel of the result is a convex combination of texels of the swatch, the same in each slice: values stay
    non-negative and slices keep their order. (With `level` a slowly varying gain per slice comes first.) Means are not
    set back to what they were: the values are right as measured, and `facts` say how far the means have moved.

    Parameters
    ----------
    slices : (N, H, W, 3) linear values, finite and not negative, H and W from 16 to 8192
    progress : called with the stage's name and its share done

    Raises
    ------
    BakeError : unusable slices
    """
    settings = settings or TileSettings()
    say = progress or _silent
    original = _checked(slices)
    say("tiling: features", 0.0)
    features, held = stack_features(original)
    places = _places(*original.shape[1:3])
    # The swatch repeated as it is has its own borders for seams.
    before = seam_facts(original, places, features, features, settings.seed)
    slices = original
    if settings.level:
        slices = _levelled(original)
        features, held = stack_features(slices)
    # A blend needs room in the overlap.
    settings = replace(settings, feather=min(settings.feather, min(slices.shape[1:3]) // 16))
    best = _Tiler(_Frame(slices, features, places), settings, say).run()
    source = np.ascontiguousarray(best.plan.source(best.frame.places))
    shown = len(np.unique(source[..., 0].astype(np.int64) * slices.shape[2] + source[..., 1]))
    facts = {
        "method": best.method,
        "straightened": best.frame.slices is not slices,
        "size": [best.slices.shape[2], best.slices.shape[1]],
        "seams": {"before": before, "after": best.seams},
        "used": round(shown / (slices.shape[1] * slices.shape[2]), 4),
        "repeated": round(1 - shown / (source.shape[0] * source.shape[1]), 4),
        "variance_seen": round(held, 4),
        **_mean_facts(original, best.slices),
    }
    say("tiling: done", 1.0)
    return Tiled(best.slices, source, facts)


@dataclass(frozen=True)
class _Frame:
    """What is cut: the swatch as photographed or set straight; `places` are the texels of the swatch in it."""

    slices: Array
    features: Array
    places: Array


@dataclass(frozen=True)
class _Trial:
    method: Method
    frame: _Frame
    plan: OffsetPlan | QuiltPlan
    slices: Array
    seams: dict[str, Any]

    @property
    def visibility(self) -> float:
        """Visibility of the seams; up to 1 nothing is seen."""
        return float(self.seams["visibility"])

    @property
    def drift(self) -> float:
        """Largest relative change of a slice's mean."""
        return max(abs(ratio - 1) for ratio in _mean_ratios(self.frame.slices, self.slices))


class _Tiler:
    """Tries what the settings allow, the gentlest first, until nothing is seen."""

    def __init__(self, frame: _Frame, settings: TileSettings, say: Progress) -> None:
        self.frame, self.settings, self.say = frame, settings, say

    def run(self) -> _Trial:
        """Return the first trial whose seams are not seen, or the best."""
        settings = self.settings
        self.say("tiling: period and cut", 0.1)
        best = self._offset(self.frame)
        if settings.straighten and best.visibility > _GOOD_ENOUGH:
            self.say("tiling: straightening", 0.3)
            best = self._straightened(best)
        if settings.method == "quilt" or (settings.method == "auto" and best.visibility > _GOOD_ENOUGH):
            quilt = self._quilt(best)
            if quilt and (settings.method == "quilt" or self._is_better(quilt, best)):
                return quilt
        return best

    @staticmethod
    def _is_better(quilt: _Trial, offset: _Trial) -> bool:
        # Quilting hides its seams best in the plainest corner of an uneven swatch, which it then repeats.
        return quilt.visibility < _WORTH_QUILTING * offset.visibility and quilt.drift <= max(_DRIFT, offset.drift)

    def _offset(self, frame: _Frame) -> _Trial:
        return self._attempt("offset", frame, plan_offset(frame.features, self.settings.keep, self.settings.feather))

    def _straightened(self, plain: _Trial) -> _Trial:
        shear = find_shear(self.frame.features, self.settings.keep)
        size = self.frame.slices.shape[1:3]
        left = min(side - 2 * rim for side, rim in zip(size, shear.rim(*size)))
        if not shear.is_felt(*size) or left < SMALLEST_SIDE:
            return plain
        features = shear.apply(self.frame.features[None])[0]
        straight = self._offset(_Frame(shear.apply(self.frame.slices), features, shear.nearest(*size)))
        return straight if straight.visibility < _WORTH_STRAIGHTENING * plain.visibility else plain

    def _quilt(self, offset: _Trial) -> _Trial | None:
        """In the size that "offset" found: quilting, too, needs whole periods."""
        settings, shape = self.settings, offset.plan.shape
        patch = settings.patch or max(min(shape) // 4, _SMALLEST_PATCH)
        if patch_count(shape, patch) > _MOST_PATCHES:
            if settings.method == "auto":
                return None
            cause = f"of {shape[1]} x {shape[0]} take more than {_MOST_PATCHES} patches"
            raise BakeError(_NAME, cause, "choose larger patches, or crop to a squarer swatch")
        plan = plan_quilt(
            offset.frame.features, shape, patch, settings.feather, settings.seed,
            lambda share: self.say("tiling: patches", 0.5 + 0.4 * share),
        )  # fmt: skip
        return self._attempt("quilt", offset.frame, plan)

    def _attempt(self, method: Method, frame: _Frame, plan: OffsetPlan | QuiltPlan) -> _Trial:
        tile, features = plan.apply(frame.slices), plan.apply(frame.features[None])[0]
        source = plan.source(_places(*frame.slices.shape[1:3]))
        seams = seam_facts(tile, source, features, frame.features, self.settings.seed)
        return _Trial(method, frame, plan, tile, seams)


def _places(height: int, width: int) -> Array:
    return np.moveaxis(np.indices((height, width), dtype=np.int32), 0, 2)


def _mean_facts(before: Array, after: Array) -> Facts:
    ratios = _mean_ratios(before, after)
    return {"means": [round(r, 5) for r in ratios], "means_spread": round(max(ratios) / max(min(ratios), 1e-30) - 1, 5)}


def _mean_ratios(before: Array, after: Array) -> list[float]:
    """Means of slices, after over before; black slices are left out."""
    old, new = (slices.mean(axis=(1, 2, 3), dtype=np.float64) for slices in (before, after))
    return [float(r) for r in new[old > 0] / old[old > 0]] or [1.0]


def _levelled(slices: Array) -> Array:
    """Each slice over the quadratic surface that fits it best, with its mean kept."""
    result = np.empty_like(slices)
    surfaces = _quadratics(*slices.shape[1:3])
    factor = max(1, min(slices.shape[1:3]) // 64)
    design = shrink(surfaces, factor).reshape(-1, surfaces.shape[2]).astype(np.float64)
    for out, values in zip(result, slices):
        mean = float(values.mean(dtype=np.float64))
        brightness = shrink(values, factor).mean(axis=2).ravel()
        fit = surfaces @ np.linalg.lstsq(design, brightness, rcond=None)[0].astype(np.float32)
        # A fit near 0 would blow a dark corner up.
        out[:] = values / np.maximum(fit, _LEVEL_FLOOR * mean + 1e-30)[..., None]
        out *= np.float32(mean / max(float(out.mean(dtype=np.float64)), 1e-30))
    return result


def _quadratics(height: int, width: int) -> Array:
    """1, x, y, x^2, xy, y^2 over the frame, (H, W, 6) float32."""
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2).astype(np.float32)


def _checked(slices: Array) -> Array:
    try:
        slices = np.asarray(slices)
    except ValueError as error:
        raise BakeError(_NAME, "differ in shape", "give numbers (N, H, W, 3)") from error
    if slices.ndim != 4 or slices.shape[3] != 3 or not len(slices) or slices.dtype.kind not in "fiu":
        raise BakeError(_NAME, f"cannot be {slices.dtype} of shape {slices.shape}", "give numbers (N, H, W, 3)")
    height, width = slices.shape[1:3]
    check_tileable(len(slices), height, width)
    # Also false where a value is not a number.
    if not (slices.min() >= 0 and slices.max() <= _BRIGHTEST):
        raise BakeError(_NAME, "hold values that are negative or not finite", "fix the photographs")
    return np.ascontiguousarray(slices, np.float32)


def check_tileable(count: int, height: int, width: int) -> None:
    """Raise BakeError where so many images of this size are not made to tile."""
    if min(height, width) < SMALLEST_SIDE:
        raise BakeError(_NAME, f"of {width} x {height} are too small to tile", f"give {SMALLEST_SIDE} texels or more")
    if max(height, width) > LARGEST_SIDE or count * height * width * 3 > MAX_VALUES:
        cause = f"of {count} x {width} x {height} are too large to tile"
        raise BakeError(_NAME, cause, f"scale them below {LARGEST_SIDE} texels and {MAX_VALUES // 3:.1e} texels in all")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def _is_whole(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _silent(_stage: str, _share: float) -> None:
    pass
