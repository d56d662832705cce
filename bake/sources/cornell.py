"""Reader of Cornell gonioreflectometer files (`.brdf`): scattered direction pairs times a spectrum.

The format is text: comments after `#`, the number of wavelengths, the wavelengths in nm, then one sample per
line: theta_i, phi_i, theta_s, phi_s in radians and one BRDF value (1/sr) per wavelength. The instrument is
described by Foo 1997 and Li et al. 2006; the file layout is the one of pbrt's measured materials.

`python -m measured_materials.bake.sources.cornell FILE...` prints how well held-out samples are predicted.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ..directions import spherical
from ..errors import BakeError
from ..reading import Illuminant, Reading
from ..source import Array, Facts, Reader
from ..spectrum import white_point, xyz_to_rec709, xyz_weights
from .lookup.scattered import MIN_SAMPLES, ScatteredBrdf, fit_scattered, sample_errors
from .lookup.text_file import LARGEST_VALUE, beginning, checked_bytes, finite_numbers

MAX_BYTES = 64 << 20
MAX_LINE_BYTES = 1 << 16
MAX_COMMENTS = 20
MAX_WAVELENGTHS = 1000
MAX_SAMPLES = 50_000
_REMEDY = "give a Cornell goniometer file as published, or export it again"


@dataclass(frozen=True)
class CornellSamples:
    """Contents of a file: comments, wavelengths (L,) in nm, unit vectors (N, 3), values (N, L) in 1/sr."""

    comments: list[str]
    wavelengths: Array
    wi: Array
    wo: Array
    values: Array


class CornellSource:
    """Goniometer samples as a smooth BRDF; see `scattered` for the interpolation.

    The spectra become CIE XYZ under D65 first, because XYZ is never negative and can be interpolated in its
    logarithm; Rec.709 follows last and may be negative where the paint is more saturated than Rec.709.
    """

    isotropic = True
    bilateral = True

    def __init__(self, path: Path, samples: CornellSamples, illuminant: Illuminant = "D65") -> None:
        self.name = path.stem
        self._fit = _fit(path, samples, np.arange(len(samples.values)), illuminant)
        self._to_rgb = xyz_to_rec709(white_point(illuminant)).T
        rgb = _xyz(path, samples, illuminant) @ self._to_rgb
        self.facts: Facts = {
            "format": "Cornell goniometer",
            "comments": samples.comments,
            "samples": len(samples.values),
            "wavelengths_nm": [float(samples.wavelengths[0]), float(samples.wavelengths[-1])],
            "wavelength_count": len(samples.wavelengths),
            "negative_share": float((samples.values < 0).mean()),
            "zero_share": float((samples.values == 0).mean()),
            "outside_rec709_share": float((rgb < 0).any(-1).mean()),
            "illuminant": illuminant,
            **self._fit.facts,
        }

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr, linear Rec.709; see `BrdfSource.evaluate`."""
        return self._fit.evaluate(wi, wo) @ self._to_rgb


def read_samples(path: Path) -> CornellSamples:
    """Parse a file without fitting anything.

    Raises
    ------
    BakeError : not text, a malformed or non-finite number, a wrong number of columns, an angle that is not
        above the horizon, too few samples; the cause names the line
    """
    comments: list[str] = []
    lines = _number_lines(path, comments)
    wavelengths = _read_wavelengths(path, lines)
    columns = 4 + wavelengths.size
    rows: list[Array] = []
    for number, tokens in lines:
        if len(tokens) != columns:
            _refuse(path, number, f"{len(tokens)} columns instead of {columns}")
        if len(rows) == MAX_SAMPLES:
            _refuse(path, number, f"more than {MAX_SAMPLES} samples")
        rows.append(_sample(path, number, tokens))
    if len(rows) < MIN_SAMPLES:
        raise BakeError(path, f"holds {len(rows)} samples, {MIN_SAMPLES} are needed", _REMEDY)
    table = np.stack(rows)
    return CornellSamples(
        comments,
        wavelengths,
        spherical(table[:, 0], table[:, 1]),
        spherical(table[:, 2], table[:, 3]),
        table[:, 4:],
    )


def _refuse(path: Path, line: int, cause: str, remedy: str = _REMEDY) -> NoReturn:
    raise BakeError(path, f"line {line}: {cause}", remedy)


def _number_lines(path: Path, comments: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Lines that hold numbers, as (line number, tokens); comments before the first number are collected."""
    before = True
    for number, line in enumerate(checked_bytes(path, _REMEDY, MAX_BYTES).splitlines(), 1):
        content, mark, comment = line.partition(b"#")
        if not content.isascii() or b"\0" in line:
            _refuse(path, number, "is not text")
        if len(line) > MAX_LINE_BYTES:
            _refuse(path, number, f"is longer than {MAX_LINE_BYTES} bytes")
        if tokens := content.decode("ascii").split():
            before = False
            yield number, tokens
        elif before and mark and len(comments) < MAX_COMMENTS:
            text = "".join(c for c in comment.decode("utf-8", "replace") if c.isprintable()).strip()
            comments += [text[:200]] if text and text != "num wls" else []


def _numbers(path: Path, line: int, tokens: Sequence[str]) -> Array:
    try:
        return finite_numbers(tokens)
    except ValueError as error:
        _refuse(path, line, str(error))


def _read_wavelengths(path: Path, lines: Iterator[tuple[int, list[str]]]) -> Array:
    """The count and then the list, which may go over several lines."""
    number, tokens = next(lines, (1, []))
    count = _numbers(path, number, tokens)
    if count.size != 1 or count[0] != np.floor(count[0]) or not 1 <= count[0] <= MAX_WAVELENGTHS:
        _refuse(path, number, f"the number of wavelengths (1 to {MAX_WAVELENGTHS}) is expected here")
    wavelengths = np.zeros(0)
    while wavelengths.size < count[0]:
        following = next(lines, None)
        if following is None:
            _refuse(path, number, f"ends after {wavelengths.size} of {int(count[0])} wavelengths")
        number, tokens = following
        wavelengths = np.append(wavelengths, _numbers(path, number, tokens))
    if wavelengths.size > count[0]:
        _refuse(path, number, f"{wavelengths.size} wavelengths instead of {int(count[0])}")
    try:
        xyz_weights(wavelengths)
    except ValueError as error:
        _refuse(path, number, str(error))
    return wavelengths


def _sample(path: Path, line: int, tokens: Sequence[str]) -> Array:
    row = _numbers(path, line, tokens)
    for name, theta in (("theta_i", row[0]), ("theta_s", row[2])):
        if not 0 <= theta < np.pi / 2 - 1e-6:
            remedy = "angles must be in radians, above the horizon; convert degrees, remove transmission"
            _refuse(path, line, f"{name} = {theta:g} is not between 0 and pi/2", remedy)
    if np.abs(row[[1, 3]]).max() > 4 * np.pi:
        _refuse(path, line, "an azimuth exceeds two turns", "angles must be in radians; convert degrees")
    if np.abs(row[4:]).max() > LARGEST_VALUE:
        _refuse(path, line, f"a BRDF value exceeds {LARGEST_VALUE:g} 1/sr")
    return row


def _xyz(path: Path, samples: CornellSamples, illuminant: Illuminant) -> Array:
    return samples.values @ xyz_weights(samples.wavelengths, illuminant)


def _fit(path: Path, samples: CornellSamples, chosen: Array, illuminant: Illuminant = "D65") -> ScatteredBrdf:
    try:
        return fit_scattered(samples.wi[chosen], samples.wo[chosen], _xyz(path, samples, illuminant)[chosen])
    except ValueError as error:
        raise BakeError(path, str(error), _REMEDY) from error


def held_out_error(path: Path, share: float = 0.1, seed: int = 0) -> dict[str, Any]:
    """Fit on part of the samples and predict the rest.

    Parameters
    ----------
    path : file
    share : held-out share of the samples, 0 < share <= 0.5
    seed : of the random choice

    Returns
    -------
    `sample_errors` of linear Rec.709 on the held-out samples, and `method`, `held_out` (their number),
    `relative_rms` (`cos_rms` over the RMS of f cos).

    Raises
    ------
    BakeError : as `read_samples`
    """
    samples = read_samples(Path(path))
    order = np.random.default_rng(seed).permutation(len(samples.values))
    out = order[: max(1, round(share * len(order)))]
    fit = _fit(Path(path), samples, np.sort(order[len(out) :]))
    to_rgb = xyz_to_rec709().T
    rgb = _xyz(Path(path), samples, "D65") @ to_rgb
    wi, wo = samples.wi[out], samples.wo[out]
    cosine = np.minimum(wi[:, 2], wo[:, 2])
    typical = max(float(np.median(np.abs(rgb).mean(-1))), 1e-9)
    errors: dict[str, Any] = dict(sample_errors(rgb[out], fit.evaluate(wi, wo) @ to_rgb, cosine, typical))
    signal = float(np.sqrt(np.mean((rgb[out] * cosine[:, None]) ** 2)))
    return errors | {
        "relative_rms": errors["cos_rms"] / max(signal, 1e-30),
        "method": fit.method,
        "held_out": len(out),
    }


def _matches(path: Path, head: bytes) -> bool:
    """The phrase that precedes the wavelength count may come after a long comment, hence the longer look."""
    if not head.lstrip().startswith(b"#"):
        return False
    return b"num wls" in beginning(path)


def _read(path: Path, reading: Reading) -> CornellSource:
    return CornellSource(path, read_samples(path), reading.illuminant)


READER = Reader("Cornell goniometer", (".brdf",), _matches, _read)


def main(arguments: Sequence[str]) -> int:
    """Print a table of held-out errors; 0 done, 1 bad input, 2 usage."""
    if not arguments:
        print("usage: python -m measured_materials.bake.sources.cornell FILE...", file=sys.stderr)
        return 2
    print(f"{'file':20} {'method':13} {'held out':>8} {'log RMS':>8} {'cos RMS':>9} {'rel RMS':>8} {'median':>7}")
    for argument in arguments:
        try:
            e = held_out_error(Path(argument))
        except BakeError as error:
            print(error, file=sys.stderr)
            return 1
        print(
            f"{Path(argument).stem[:20]:20} {e['method']:13} {e['held_out']:8d} {e['log_cos_rms']:8.4f} "
            f"{e['cos_rms']:9.5f} {e['relative_rms']:8.4f} {e['median_relative']:7.4f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
