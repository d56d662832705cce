"""Small movements of the camera between photographs, measured against changing light, and their correction.

Photographs are compared in pairs by phase correlation (Kuglin and Hines 1975) of their high-passed logarithmic
luminance, in which a change of lamp or exposure is a constant that drops out. Moving shadows and highlights remain.
Four things keep them from passing for a movement of the camera: a pair of photographs counts only where enough of
the spectrum agrees in phase (its coherence); the four quarters of the frame must agree, and their
disagreement is the pair's uncertainty; the positions of all photographs follow from all pairs together, for a
camera's movement is consistent around every loop of pairs and a shadow's is not; and what is moved back must then be
foretold better by its neighbours (`held_out`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .frame import area_average
from .held_out import helpful_moves
from .radiometry.light_drift import light_drift

LARGEST_SHARE = 0.05
"""Of the frame; a larger movement is reported but not corrected."""
SMALLEST_PIXELS = 0.5
"""Movements below this are left alone: light that moves over relief feigns up to 0.3 in stacks of fixed cameras
(measured on photographs of a gilded icon and on synthetic relief), and resampling costs some sharpness."""
_LONGEST_SIDE = 512
_SHORTEST_SIDE = 64
_NEIGHBOURS = 4
_HUBS = 6
_BLUR = 1.0
_COARSE = 6.0
_COHERENCE = 0.1
_NOISE_FACTOR = 8.0
_NEARLY_AS_HIGH = 0.75
_CERTAINTY = 3.0
_FLOOR = 0.001
_INCOHERENCE = 0.02
"""Error in pixels, times coherence squared, that changed light causes all over the frame alike: the canvas stack, whose
movement all its lights together determine, shows 0.6 to 1.5 at a coherence of 0.2 and 0.05 at 0.45."""
_QUARTER_AGREEMENT = 2.0
_LEAST_UNCERTAIN = 0.02
Spectrum = NDArray[np.complex128]
Pair = tuple[int, int, float, float, float]
"""Two photographs, the displacement (x, y) of the second against the first, its standard error, pixels."""


@dataclass(frozen=True, eq=False)
class Shifts:
    """Displacement (n, 2) of every photograph's content, x right and y down, in texels, NaN where unknown.

    `uncertain` (n,) is its standard error, texels. `moved` (n,) marks displacements that are significant and, moved
    back, make the photograph fit its neighbours better; `too_far` (n,) those of them above `LARGEST_SHARE`.
    """

    displacement: NDArray[np.float64]
    uncertain: NDArray[np.float64]
    moved: NDArray[np.bool_]
    too_far: NDArray[np.bool_]

    def of_all(self, k: int, n: int) -> Shifts:
        """The shift of photograph `k` as that of n."""
        return Shifts(*(np.repeat(values[k : k + 1], n, 0) for values in vars(self).values()))


def measure(images: NDArray[np.float32], directions: NDArray[np.float64] | None) -> Shifts:
    """Displacements of (n, H, W, 3) photographs relative to the position that most of them share.

    `directions` (n, 3) choose which are paired; without them photographs are taken to follow one another.
    """
    n, height, width = images.shape[:3]
    if n < 2 or min(height, width) < _SHORTEST_SIDE:
        nothing = np.full((n, 2), np.nan)
        return Shifts(nothing, np.full(n, np.nan), np.zeros(n, bool), np.zeros(n, bool))
    factor, shape = _working_size(height, width)
    whole, quarters = zip(*(_spectra(image, shape) for image in images))
    pairs = []
    for i, j in _pairs(n, directions):
        x, y, coherence = _pair_shift(whole[i], whole[j], shape, _reach(shape))
        if coherence:
            error = _standard_error((x, y), quarters[i], quarters[j], shape) + _INCOHERENCE / coherence**2
            pairs += [(i, j, x, y, error)] if np.isfinite(error) else []
    displacement, uncertain = _positions(n, pairs)
    displacement *= [width / shape[1], height / shape[0]]
    uncertain *= factor
    bounds = np.maximum(SMALLEST_PIXELS * factor, _CERTAINTY * uncertain)
    displacement = displacement - light_drift(displacement, uncertain, directions, bounds)
    moved = np.hypot(*displacement.T) > bounds  # False for NaN
    too_far = moved & _too_far(displacement, width, height)
    near = moved & ~too_far
    if near.any():
        gray = np.array([_gray(image, shape) for image in images])
        scale = np.array([shape[1] / width, shape[0] / height])
        moves = helpful_moves(gray, np.nan_to_num(displacement) * scale, near, _apart(n, directions)) / scale
        near &= np.hypot(*moves.T) > bounds
        displacement[near] = moves[near]
        moved = too_far | near
    return Shifts(displacement, uncertain, moved, too_far)


def between(first: NDArray[np.float32], second: NDArray[np.float32]) -> Shifts:
    """Displacement of the second (H, W, 3) photograph against the first, which stays; taken from either side.

    One may be the other's negative, as cloth is whose threads are bright in reflected light and dark against the light.
    Under high lamps a fixed camera shows 0.01 texels on rendered voile, under lamps of 60 and 88 degrees 0.1.
    """
    height, width = first.shape[:2]
    unknown = Shifts(np.full((2, 2), np.nan), np.full(2, np.nan), np.zeros(2, bool), np.zeros(2, bool))
    if min(height, width) < _SHORTEST_SIDE:
        return unknown
    factor, shape = _working_size(height, width)
    (one, own), (other, others) = (_spectra(image, shape) for image in (first, second))
    found = [(_pair_shift(one, sign * other, shape, _reach(shape)), sign) for sign in (1, -1)]
    # As of peaks: of both signs where they agree almost as well the nearer, for weaves repeat.
    most = max(coherence for (_, _, coherence), _ in found)
    likely = [entry for entry in found if entry[0][2] and entry[0][2] >= _NEARLY_AS_HIGH * most]
    if not likely:
        return unknown
    (x, y, coherence), sign = min(likely, key=lambda entry: np.hypot(*entry[0][:2]))
    error = _standard_error((x, y), own, [sign * quarter for quarter in others], shape) + _INCOHERENCE / coherence**2
    if not np.isfinite(error):
        return unknown
    moves = np.array([[0.0, 0.0], [x * width / shape[1], y * height / shape[0]]])
    uncertain = np.array([0.0, factor * error])
    moved = np.hypot(*moves.T) > np.maximum(SMALLEST_PIXELS * factor, _CERTAINTY * uncertain)
    return Shifts(moves, uncertain, moved, moved & _too_far(moves, width, height))


def _too_far(moves: NDArray[np.float64], width: int, height: int) -> NDArray[np.bool_]:
    far: NDArray[np.bool_] = (np.abs(moves) > LARGEST_SHARE * np.array([width, height])).any(axis=1)
    return far


def _working_size(height: int, width: int) -> tuple[float, tuple[int, int]]:
    """Texels per pixel that movement is measured in, and the size (height, width) in those."""
    factor = max(1.0, max(height, width) / _LONGEST_SIDE)
    return factor, (max(_SHORTEST_SIDE, round(height / factor)), max(_SHORTEST_SIDE, round(width / factor)))


def correct(images: NDArray[np.float32], shifts: Shifts) -> tuple[NDArray[np.float32], tuple[int, int, int, int]]:
    """Move what has moved back, in place, and cut off the border that some photograph lacks.

    Catmull-Rom interpolation: a photograph is neither blurred by half a texel's bilinear mix nor wrapped around as a
    Fourier shift would. Returns the smaller stack and the border (left, top, right, bottom) in texels.
    """
    height, width = images.shape[1:3]
    chosen = shifts.moved & ~shifts.too_far
    moves = shifts.displacement[chosen]
    if not len(moves):
        return images, (0, 0, 0, 0)
    for k in np.flatnonzero(chosen):
        dx, dy = shifts.displacement[k]
        images[k] = np.maximum(_shift_axis(_shift_axis(images[k], dx, 1), dy, 0), 0)
    left, top = (int(np.ceil(max(0.0, -moves[:, axis].min()))) for axis in (0, 1))
    right, bottom = (int(np.ceil(max(0.0, moves[:, axis].max()))) for axis in (0, 1))
    return np.ascontiguousarray(images[:, top : height - bottom, left : width - right]), (left, top, right, bottom)


def _shift_axis(image: NDArray[np.float32], distance: float, axis: int) -> NDArray[np.float32]:
    """Values at position + distance along an axis, the border continued."""
    n = image.shape[axis]
    whole = int(np.floor(distance))
    t = distance - whole
    weights = (
        ((-t + 2) * t - 1) * t / 2,
        ((3 * t - 5) * t * t + 2) / 2,
        ((-3 * t + 4) * t + 1) * t / 2,
        (t - 1) * t * t / 2,
    )
    result = np.zeros_like(image)
    for tap, weight in enumerate(weights):
        if weight:
            places = np.clip(np.arange(n) + whole + tap - 1, 0, n - 1)
            result += np.float32(weight) * image.take(places, axis)
    return result


def _apart(n: int, directions: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(n, n) how different the lights of two photographs are; their distance in order where lights are not known."""
    if directions is None:
        return np.abs(np.subtract.outer(np.arange(n), np.arange(n))).astype(float)
    apart: NDArray[np.float64] = 1 - directions @ directions.T
    return apart


def _pairs(n: int, directions: NDArray[np.float64] | None) -> list[tuple[int, int]]:
    """Each photograph with those lit most alike, and with a few hubs whose lights lie far apart.

    Without the hubs the two halves of an arc hang together by lights near the normal only, where relief changes its
    sign between neighbours; between grazing lights of both halves the surface's own colours are compared.
    """
    apart = _apart(n, directions)
    hubs = [int(np.argmax(apart.sum(axis=1)))]
    while len(hubs) < min(_HUBS, n):
        hubs.append(int(np.argmax(apart[hubs].min(axis=0))))
    np.fill_diagonal(apart, np.inf)
    nearest = np.argsort(apart, axis=1, kind="stable")[:, : min(_NEIGHBOURS, n - 1)]
    partners = [{*nearest[i].tolist(), *hubs} - {i} for i in range(n)]
    return sorted({(min(i, j), max(i, j)) for i in range(n) for j in partners[i]})


def _gauss(shape: tuple[int, int], sigma: float) -> NDArray[np.float64]:
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])
    return np.exp(-2 * np.pi**2 * sigma**2 * (fx * fx + fy * fy))


def _gray(image: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float64]:
    gray = image.mean(axis=-1, dtype=np.float64).astype(np.float32)
    return area_average(area_average(gray, shape[0], 0), shape[1], 1).astype(np.float64)


def _spectra(image: NDArray[np.float32], shape: tuple[int, int]) -> tuple[Spectrum, list[Spectrum]]:
    """Spectra of the band-passed log luminance, of the whole frame and of its quarters."""
    gray = _gray(image, shape)
    mean = float(gray.mean())
    detail = np.log(gray / mean + 0.02) if mean > 0 else gray
    band = np.fft.irfft2(np.fft.rfft2(detail) * (_gauss(shape, _BLUR) - _gauss(shape, _COARSE)), s=shape)
    if float(np.abs(band).max()) < 1e-6:  # a flat, even surface: only rounding is left
        band[:] = 0
    h, w = _quarter(shape)
    quarters = [band[y : y + h, x : x + w] for y in (0, shape[0] - h) for x in (0, shape[1] - w)]
    return _windowed(band), [_windowed(quarter) for quarter in quarters]


def _quarter(shape: tuple[int, int]) -> tuple[int, int]:
    return shape[0] // 2, shape[1] // 2


def _windowed(band: NDArray[np.float64]) -> Spectrum:
    window = np.outer(np.hanning(band.shape[0]), np.hanning(band.shape[1]))
    return np.fft.rfft2((band - (band * window).sum() / window.sum()) * window)


def _standard_error(
    shift: tuple[float, float], first: list[Spectrum], second: list[Spectrum], shape: tuple[int, int]
) -> float:
    """Of the mean of the quarters' displacements about the whole frame's; infinite where fewer than three agree."""
    misfits = []
    for a, b in zip(first, second):
        x, y, coherence = _pair_shift(a, b, _quarter(shape), _reach(shape))
        misfit = float(np.hypot(x - shift[0], y - shift[1]))
        if coherence and misfit <= _QUARTER_AGREEMENT:
            misfits.append(misfit)
    if len(misfits) < 3:
        return float("inf")
    return max(_LEAST_UNCERTAIN, float(np.sqrt(np.mean(np.square(misfits)) / len(misfits))))


def _reach(shape: tuple[int, int]) -> tuple[int, int]:
    """How far a pair may be apart, pixels: each of the two by the largest share."""
    height, width = (max(3, int(2 * LARGEST_SHARE * side)) for side in shape)
    return height, width


def _pair_shift(
    first: Spectrum, second: Spectrum, shape: tuple[int, int], reach: tuple[int, int]
) -> tuple[float, float, float]:
    """Displacement (x, y) of the second against the first, in pixels, and their coherence, 0 where it says nothing.

    Frequencies count alike, as phase correlation has it, save those that hold next to nothing. A higher floor would
    help surfaces that repeat exactly, but lets a few strong frequencies of relief outvote the rest: floors from 0.003
    on gave false movements of 7 pixels on renders. The coherence, 1 where all phases agree, must exceed what chance
    yields from so many frequencies.
    """
    cross = second * np.conj(first)
    strength = np.abs(cross)
    mean = float(strength.mean())
    if not mean > 0:
        return 0.0, 0.0, 0.0
    weight = _gauss(shape, _BLUR) / (strength + _FLOOR * mean)
    surface = np.fft.irfft2(cross * weight, s=shape) * (shape[0] * shape[1])
    weight *= strength
    twice = np.full(weight.shape[1], 2.0)  # the half of the plane that rfft2 leaves out
    twice[0] = 1
    twice[-1] = 2 if shape[1] % 2 else 1
    total, chance = float((weight @ twice).sum()), float(np.sqrt((weight**2 @ twice).sum()))
    near = np.roll(surface / total, reach, (0, 1))[: 2 * reach[0] + 1, : 2 * reach[1] + 1]
    y, x = _peak(near)
    coherence = float(near[y, x])
    return (
        x - reach[1] + _refine(near[y, x - 1], near[y, x], near[y, x + 1]),
        y - reach[0] + _refine(near[y - 1, x], near[y, x], near[y + 1, x]),
        coherence if coherence >= max(_COHERENCE, _NOISE_FACTOR * chance / total) else 0.0,
    )


def _peak(near: NDArray[np.float64]) -> tuple[int, int]:
    """The highest peak; of peaks almost as high the nearest to the centre, for weaves repeat."""
    inner = near[1:-1, 1:-1]
    height, width = inner.shape
    top = np.ones_like(inner, bool)
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            top &= inner >= near[dy : dy + height, dx : dx + width]
    peaks = np.where(top, inner, -np.inf)
    places = (
        np.argwhere(peaks >= _NEARLY_AS_HIGH * peaks.max()) if peaks.max() > 0 else np.argwhere(peaks == peaks.max())
    )
    centre = np.array([height - 1, width - 1]) / 2
    y, x = places[np.argmin(np.linalg.norm(places - centre, axis=1))] + 1
    return int(y), int(x)


def _refine(before: float, peak: float, after: float) -> float:
    """Offset of a sampled Gaussian's maximum: the parabola through the logarithms."""
    if min(before, peak, after) <= 0:
        return 0.0
    a, b, c = np.log([before, peak, after])
    bend = a - 2 * b + c
    return float(np.clip((a - c) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0


def _positions(n: int, pairs: list[Pair]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions (n, 2) that explain all pairs, by reweighted least squares (L1), and their standard errors (n,)."""
    positions, uncertain = np.full((n, 2), np.nan), np.full(n, np.nan)
    members = _largest_component(n, pairs)
    place = {member: k for k, member in enumerate(members)}
    used = [pair for pair in pairs if pair[0] in place]
    if not used:
        return positions, uncertain
    rows = np.zeros((len(used) + 1, len(members)))
    target, error = np.zeros((len(used) + 1, 2)), np.ones(len(used) + 1)
    for k, (i, j, x, y, pair_error) in enumerate(used):
        rows[k, place[i]], rows[k, place[j]] = -1, 1
        target[k], error[k] = (x, y), pair_error
    rows[-1] = 1 / len(members)  # fixes the origin
    misfit = np.zeros(len(error))
    for _ in range(20):
        weights = 1 / np.sqrt(error * (error + misfit))
        solution = np.linalg.lstsq(rows * weights[:, None], target * weights[:, None], rcond=None)[0]
        misfit = np.hypot(*(rows @ solution - target).T)
    # The origin is where most photographs stand, so that most stay untouched.
    apart = np.linalg.norm(solution[:, None] - solution, axis=-1)
    origin = int(np.argmin(np.minimum(apart, 2 * SMALLEST_PIXELS).sum(axis=1)))
    weighted = rows / np.maximum(error, misfit)[:, None]
    covariance = np.linalg.pinv(weighted.T @ weighted)
    spread = np.diag(covariance) + covariance[origin, origin] - 2 * covariance[origin]
    positions[members] = solution - solution[origin]
    uncertain[members] = np.sqrt(np.maximum(spread, 0))
    return positions, uncertain


def _largest_component(n: int, pairs: list[Pair]) -> list[int]:
    label = list(range(n))
    for i, j, *_ in pairs:
        old, new = label[j], label[i]
        label = [new if value == old else value for value in label]
    largest = max(set(label), key=lambda value: (label.count(value), -value))
    return [k for k in range(n) if label[k] == largest]
