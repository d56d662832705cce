"""Do two renderers agree? A comparison of noisy pictures whose false alarms and blind spots are known.

Each picture is rendered under K independent seeds and reduced to means over tiles. Two families of Welch t-tests look
at the K values of both sides: every tile in every channel (finds local differences), and the mean of the whole mask
in every channel (finds small differences spread over all of it). Each family is Sidak-corrected and the two share
the level evenly (Bonferroni), so a pair of equal renderers is called different with probability `level` at most.
Channels of one pixel rise and fall together, which Sidak's correction survives on the safe side.

Tile size. The t-test needs noise close to normal. A mirror that rarely meets a small lamp gives the opposite: most
tiles see nothing, with no variance to warn of it, and every one of them would be an alarm. So the skewness of the
difference is measured (k-statistics pooled over small tiles; it falls as one over the edge) and the edge is
doubled from 8 pixels until it is below 0.2. (Rare flashes on one side only, level 5 %: 100 % false alarms without this
step.) Noise too skewed even for the whole mask is reported as such by `assert_agree`.

Detectable effect. Multiply side b by 1 + d. A t statistic with df degrees of freedom then moves by d m / s, with m the
mean and s the standard error (b's part of it grown by 1 + d), and passes its critical value c with probability
P(t_df > c - d m / s). Two lower bounds of the combined test's power follow: that of the whole mask, and that of the
tiles together, 1 - prod(1 - P), each in the middle one of its channels (the best would often be one whose noise was
underestimated by luck). The smallest d for which one of them reaches 95 % is `detectable_effect`. The statistic is
that of these very renders, hence "plant d here and it is found with 95 % probability" needs no further knowledge of
the noise. The product takes tiles as independent; only the pixel filter's reach of 1.5 pixels joins them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

Array = NDArray[Any]

POWER = 0.95
SKEWNESS_LIMIT = 0.2
_SMALLEST_EDGE = 8  # pixels
_SMALLEST_SHARE = 0.25  # of a tile's pixels; tiles of which the mask leaves less count in the whole mask only


@dataclass(frozen=True)
class Result:
    """Outcome of `compare`; differences are (b - a) / a.

    Attributes
    ----------
    p_value : of the combined test; p_tiles and p_mask of its two families, corrected
    relative_difference : (3,) of the mean over the mask
    worst_tile : row, column, channel of the smallest p; worst_tile_difference its relative difference
    detectable_effect : smallest relative change of the whole picture found with 95 % probability
    tile : edge in pixels
    skewness : of the difference of the means over the mask
    """

    p_value: float
    p_tiles: float
    p_mask: float
    relative_difference: Array
    worst_tile: tuple[int, int, int]
    worst_tile_difference: float
    detectable_effect: float
    level: float
    tile: int
    skewness: float

    @property
    def passed(self) -> bool:
        """Whether no difference was found."""
        return self.p_value > self.level

    def __str__(self) -> str:
        row, column, channel = self.worst_tile
        mean = ", ".join(f"{d:+.3%}" for d in self.relative_difference)
        return (
            f"p = {self.p_value:.2g} (tiles {self.p_tiles:.2g}, mask {self.p_mask:.2g}; level {self.level:g}), "
            f"mean {mean}, worst {self.tile}-pixel tile ({row}, {column}) channel {channel} "
            f"{self.worst_tile_difference:+.2%}, skewness {self.skewness:.2f}, "
            f"changes from {self.detectable_effect:.2%} would be found"
        )


def compare(
    renders_a: Array,
    renders_b: Array,
    mask: Array | None = None,
    *,
    level: float = 0.01,
    tolerance: float = 0.0,
) -> Result:
    """Test whether two sets of renders have the same expectation.

    Parameters
    ----------
    renders_a, renders_b : (K, H, W, 3) linear pictures of K >= 3 independent seeds; the two K may differ
    mask : (H, W) bool, pixels that count; all by default
    tolerance : relative difference that is accepted everywhere, for renderers with a stated bias

    Raises
    ------
    ValueError : shapes that do not fit, an empty mask, values that are not finite
    """
    a, b = np.asarray(renders_a, np.float64), np.asarray(renders_b, np.float64)
    mask = np.ones(a.shape[1:3], bool) if mask is None else np.asarray(mask, bool)
    _require_sane(a, b, mask)
    edge, skewness = _tile_edge(a, b, mask)
    tiles_a, kept = _tile_means(a, mask, edge)
    tiles_b, _ = _tile_means(b, mask, edge)
    tiles = _Welch.of(tiles_a, tiles_b, tolerance)
    whole = _Welch.of(a[:, mask].mean(axis=1), b[:, mask].mean(axis=1), tolerance)
    p_tiles, p_mask = _sidak(tiles.p), _sidak(whole.p)
    index, channel = np.unravel_index(np.argmin(tiles.p), tiles.p.shape)
    row, column = np.argwhere(kept)[index]
    return Result(
        p_value=min(1.0, 2 * min(p_tiles, p_mask)),
        p_tiles=p_tiles,
        p_mask=p_mask,
        relative_difference=whole.relative,
        worst_tile=(int(row), int(column), int(channel)),
        worst_tile_difference=float(tiles.relative[index, channel]),
        detectable_effect=_detectable_effect(tiles, whole, level / 2, tolerance),
        level=level,
        tile=edge,
        skewness=skewness,
    )


def assert_agree(result: Result, finds: float) -> None:
    """Fail when a difference was found, or when the renders are too noisy to find a change by `finds` at all."""
    assert result.passed, f"renders differ: {result}"
    assert result.skewness < SKEWNESS_LIMIT, f"noise too skewed for a t-test, take more seeds or samples: {result}"
    assert result.detectable_effect <= finds, f"too noisy to find a change by {finds:.2%}: {result}"


def assert_same(expected: Array, found: Array, mask: Array, tolerance: float, finds: float) -> None:
    """`assert_agree` of two sets of pictures, and that a planted error of 2 % is found in them."""
    result = compare(expected, found, mask, tolerance=tolerance)
    print(result)
    assert_agree(result, finds)
    planted = compare(expected, found * 1.02, mask, tolerance=tolerance)
    assert not planted.passed, f"a planted 2 % was not found: {planted}"


@dataclass(frozen=True)
class _Welch:
    """Welch t-tests of many quantities at once: arrays of one shape."""

    p: Array
    df: Array
    mean: Array  # of side a
    variance_a: Array  # of the mean of side a
    variance_b: Array
    relative: Array

    @classmethod
    def of(cls, a: Array, b: Array, tolerance: float) -> _Welch:
        """Tests along axis 0."""
        mean, difference = a.mean(axis=0), b.mean(axis=0) - a.mean(axis=0)
        va, vb = a.var(axis=0, ddof=1) / len(a), b.var(axis=0, ddof=1) / len(b)
        # Pictures are float32: where both sides are free of noise, their rounding is what remains.
        rounding = (np.finfo(np.float32).eps * np.abs(mean)) ** 2 + np.finfo(np.float64).tiny
        with np.errstate(invalid="ignore", divide="ignore"):
            df = (va + vb) ** 2 / (va**2 / (len(a) - 1) + vb**2 / (len(b) - 1))
            relative = np.where(difference == 0, 0.0, difference / mean)
        df = np.where(np.isfinite(df), df, len(a) + len(b) - 2.0)
        excess = np.maximum(np.abs(difference) - tolerance * np.abs(mean), 0)
        return cls(2 * stats.t.sf(excess / np.sqrt(va + vb + rounding), df), df, mean, va + rounding, vb, relative)

    def power(self, change: float, critical_p: float) -> Array:
        """Probability that each test finds side b multiplied by 1 + change; of the channels the middle one."""
        critical = stats.t.isf(critical_p / 2, self.df)
        error = np.sqrt(self.variance_a + (1 + change) ** 2 * self.variance_b)
        return np.median(stats.t.sf(critical - change * np.abs(self.mean) / error, self.df), axis=-1)


def _detectable_effect(tiles: _Welch, whole: _Welch, family_level: float, tolerance: float) -> float:
    at_tile = -np.expm1(np.log1p(-family_level) / tiles.p.size)
    at_mask = -np.expm1(np.log1p(-family_level) / whole.p.size)

    def lacking(change: float) -> float:
        by_tiles = 1 - np.prod(1 - tiles.power(change, at_tile))
        return float(POWER - max(whole.power(change, at_mask), by_tiles))

    highest = 1e-9
    while lacking(highest) > 0:
        highest *= 4
        if highest > 1e3:  # so noisy that growing noise outruns the change
            return float("inf")
    return tolerance + float(optimize.brentq(lacking, 0.0, highest, xtol=1e-9))


def _sidak(p: Array) -> float:
    """Probability that the smallest of so many p is as small as this."""
    with np.errstate(divide="ignore"):
        return float(-np.expm1(p.size * np.log1p(-p.min())))


def _tile_edge(a: Array, b: Array, mask: Array) -> tuple[int, float]:
    """Edge of tiles whose difference is close enough to normal, and the skewness over the whole mask."""
    (a, kept), (b, _) = _tile_means(a, mask, _SMALLEST_EDGE), _tile_means(b, mask, _SMALLEST_EDGE)
    second, third = 0.0, 0.0
    for renders, sign in ((a, -1), (b, 1)):
        count = len(renders)
        second = second + renders.var(axis=0, ddof=1).mean(axis=0) / count
        deviations = renders - renders.mean(axis=0)
        third_cumulant = count / ((count - 1) * (count - 2)) * (deviations**3).sum(axis=0)
        third = third + sign * third_cumulant.mean(axis=0) / count**2
    with np.errstate(invalid="ignore", divide="ignore"):
        skewness = float(np.nan_to_num(np.abs(third) / second**1.5, nan=0.0, posinf=0.0).max())
    edge = _SMALLEST_EDGE
    while skewness * _SMALLEST_EDGE / edge > SKEWNESS_LIMIT and edge < max(mask.shape):
        edge *= 2
    return edge, skewness / np.sqrt(kept.sum())


def _tile_means(renders: Array, mask: Array, tile: int) -> tuple[Array, Array]:
    """(K, T, 3) masked means of the kept tiles, and which tiles (rows, columns) were kept."""
    count, height, width, channels = renders.shape
    rows, columns = -(-height // tile), -(-width // tile)
    padded = np.zeros((count, rows * tile, columns * tile, channels))
    padded[:, :height, :width] = renders * mask[:, :, None]
    weight = np.zeros((rows * tile, columns * tile))
    weight[:height, :width] = mask
    sums = padded.reshape(count, rows, tile, columns, tile, channels).sum(axis=(2, 4))
    pixels = weight.reshape(rows, tile, columns, tile).sum(axis=(1, 3))
    kept = pixels >= min(_SMALLEST_SHARE * tile * tile, pixels.max())
    return sums[:, kept] / pixels[kept][:, None], kept


def _require_sane(a: Array, b: Array, mask: Array) -> None:
    if a.ndim != 4 or a.shape[1:] != b.shape[1:] or mask.shape != a.shape[1:3]:
        raise ValueError(f"renders {a.shape} and {b.shape} with mask {mask.shape} do not fit together")
    if min(len(a), len(b)) < 3:
        raise ValueError("three seeds are the least that shows how skewed the noise is")
    if not mask.any():
        raise ValueError("the mask is empty")
    if not (np.isfinite(a[:, mask]).all() and np.isfinite(b[:, mask]).all()):
        raise ValueError("renders hold values that are not finite")
