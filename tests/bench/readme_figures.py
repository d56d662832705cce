"""Which bench prints each figure of the README: sentences and rows as templates, and numbers that are no figures.

A field `{name|form}` is a figure that the bench keeps under that name (`record.put`). The form says how it is
printed: `2` with two digits after the point, `2s` with two significant ones, a following `%` in parts of a hundred.
`a ÷ b` for a name is the ratio of two. A claim is what words say of figures without printing them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from detail_rows import ROWS, SAME, SAME_CLAIMS
from gantry_figures import EVERY_SIDE, GANTRY
from light_figures import LIGHT
from no_figures import NO_FIGURES

ROOT = Path(__file__).resolve().parents[2]
FIELD = re.compile(r"\{([^{}|]+)\|([^{}|]+)\}")


@dataclass(frozen=True)
class Stated:
    """Text of a file with figures of one bench.

    Parameters
    ----------
    template : the text, spaces and line breaks alike, with fields
    claims : "a < b" of two names, or of a name and a number
    """

    bench: str
    template: str
    file: str = "README.md"
    claims: tuple[str, ...] = ()

    @property
    def fields(self) -> list[tuple[str, str]]:
        """Names and forms."""
        return FIELD.findall(self.template)

    def pattern(self) -> re.Pattern[str]:
        """Of the text, however its lines are broken, with a group for each figure."""
        parts = FIELD.split(" ".join(self.template.split()))[::3]
        return re.compile(r"(\d+(?:\.\d+)?)".join(r"\s+".join(map(re.escape, part.split(" "))) for part in parts))

    def filled(self, text: str, values: dict[str, float]) -> str:
        """The text with these figures in place of its own. KeyError: one is missing; ValueError: the text is."""
        match = self.pattern().search(text)
        if match is None:
            raise ValueError(f"{self.file} has no such text: {self.template}")
        for number, (name, form) in reversed(list(enumerate(self.fields, 1))):
            start, stop = match.span(number)
            text = text[:start] + printed(looked_up(values, name), form) + text[stop:]
        return text


def looked_up(values: dict[str, float], name: str) -> float:
    """A figure, or the ratio of two; KeyError where the bench kept none of that name."""
    first, _, second = name.partition(" ÷ ")
    return values[first] / values[second] if second else values[first]


def printed(value: float, form: str) -> str:
    """As the README prints it."""
    scaled, digits = value * (100 if form.endswith("%") else 1), form.rstrip("%")
    if not digits.endswith("s"):
        return f"{scaled:.{int(digits)}f}"
    significant = int(digits[:-1])
    if scaled == 0:
        return "0"
    after = significant - 1 - int(f"{scaled:.{significant - 1}e}".split("e")[1])
    return f"{round(scaled, after):.{max(after, 0)}f}"


def holds(values: dict[str, float], claim: str) -> bool:
    """Whether "a < b" is so."""
    sides = []
    for side in claim.split(" < "):
        try:
            sides.append(float(side))
        except ValueError:
            sides.append(looked_up(values, side))
    return sides[0] < sides[1]


def words(file: str = "README.md") -> str:
    """A file of the repository on one line."""
    return " ".join((ROOT / file).read_text(encoding="utf-8").split())


def page_figures(page: str) -> dict[str, float]:
    """Numbers of the page of hard cases that a run measures, by row and column: worst errors, and what bakes gave."""
    found = {}
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        for column, cell in enumerate(cells[1:], 1):
            # "worst / bound", or a number alone; the last column of a case is the number of its note.
            number = re.match(r"(\d[\d.]*(?:e[+-]\d+)?)( / |$)", cell)
            if number and not (column == len(cells) - 1 and re.fullmatch(r"\d+", cell)):
                found[f"{cells[0]} | {cells[1]} | {column}"] = float(number[1])
    return found


def unregistered(text: str) -> list[str]:
    """What of a file's text holds digits, but is neither stated here nor code, a year or `NO_FIGURES`."""
    lines = [line for line in text.splitlines() if not line.startswith("    ")]
    rest = " ".join(" ".join(lines).split())
    for pattern in [*(stated.pattern() for stated in STATED), *map(re.compile, map(re.escape, NO_FIGURES)), *_NEVER]:
        rest = pattern.sub(" ~ ", rest)
    return [part.strip() for part in rest.split("~") if re.search(r"\d", part)]


_NEVER = [re.compile(p) for p in (r"`[^`]*`", r"\]\([^)]*\)", r"\b(?:19|20)\d\d\b", r"(?<= )\d\. (?=[A-Z*])")]
_ENGINE = ("sky", "small lamp", "sun and sky", "HDR world")


def _row(label: str, *fields: str) -> str:
    return f"| {label} | " + " | ".join(fields) + " |"


def _engine(label: str, variant: str) -> Stated:
    fields = [f"{{noise, {variant}, {light}|2s}}" for light in _ENGINE]
    return Stated("engine", _row(label, *fields, f"{{time, {variant}|1}}"))


def _arc(label: str, material: str) -> Stated:
    name = f"noise at equal time, {material}"
    ranges = [
        f"{{{name}, {light}, least|2s}} to {{{name}, {light}, most|2s}}" for light in ("studio light", "small lamp")
    ]
    return Stated("arc", _row(label, *ranges))


def _bytes(label: str, size: int) -> Stated:
    return Stated("bytes", _row(label, *(f"{{RMS share, {s}, {size}|2s%}} %" for s in ("half", "rgbe", "log"))))


def _anisotropic(label: str, name: str) -> Stated:
    kinds = ("half auto", "normal fitted", "normal bezier", "normal uniform", "normal identity")
    return Stated("anisotropic", _row(label, *(f"{{RMS, {name}, {kind}, 48|2s}}" for kind in kinds)))


def _kind(label: str, name: str) -> Stated:
    times = [f"{{kind, {name}, {mode}, time|2}}" for mode in ("Exact", "mirror only")]
    rest = [f"{{kind, {name}, Exact, {what}|2s}}" for what in ("textures", "bake")]
    return Stated("speed", _row(label, *times, *rest))


def _azimuth(label: str, stack: str, form: str) -> Stated:
    models = ("PTM, 6 terms", "HSH, 16 terms", "RBF, 16 components", "map over azimuth")
    best = [f"RMS, {stack}, map over azimuth < RMS, {stack}, {model}" for model in models[:-1]]
    size = f"bytes, {stack} < 97"
    return Stated("azimuth", _row(label, *(f"{{RMS, {stack}, {m}|{form}}} %" for m in models)), claims=(*best, size))


def _format(label: str, name: str) -> Stated:
    return Stated("formats", f"| {label} | {{round trip, {name}|2s%}} % |", "addon/docs/formats.md")


_STACKS = (
    "canvas, hand-held lamp; canvas; 0%",
    "painted wood, dome; painted_wood; 0%",
    "gilded icon, dome; gold_icon; 0%",
    "rendered plate, matte; rendered_plate/single1; 1%",
    "rendered plate, some gloss; rendered_plate/single3; 1%",
    "rendered plate, glossy; rendered_plate/single5; 0%",
    "rendered plate, several materials; rendered_plate/multi2; 1%",
)
_BASES = (
    "median {{{0}, gain, median|0}} times, glossy half {{{0}, gain, glossy half|0}} times, "
    "least {{{0}, gain, least|{1}}}"
)
_B_SPLINE = "{0}, bezier, B-spline fitted, {1} ÷ {0}, bezier, trilinear, {1}"
_NODES, _OSL = "nodes, n varies", "OSL, n varies"
_MERL, _RGL = "MERL reconstructions", "RGL measurements"

STATED = (
    Stated(
        "readings",
        "errs by {left-out RMS, measured|1%} % RMS there in the median, *mean* by {left-out RMS, mean|1%} %, "
        "*exchanged* by {left-out RMS, exchanged|1%} %",
        "addon/docs/formats.md",
    ),
    *(
        Stated(
            "maps",
            f"| {label} | {{{label.partition(',')[0]}, least squares|2}}° | {{{label.partition(',')[0]}, maps|2}}° | "
            f"{{{label.partition(',')[0]}, level|2}}° |",
            "addon/docs/maps.md",
        )
        for label in ("single1, matte", "single3, some gloss", "single5, glossy", "multi2, several materials")
    ),
    *(
        Stated(
            "maps",
            f"| {name} | "
            + " | ".join(
                f"{{{name}, {what}, least squares|{digits}}}{unit} | {{{name}, {what}, maps|{digits}}}{unit}"
                for what, digits, unit in (("normals", 1, "°"), ("albedo", 1, ""), ("height", 2, ""))
            )
            + " |",
            "addon/docs/maps.md",
        )
        for name in ("plastic_5", "plastic_60", "suede", "cloth", "jeans", "wool", "stone")
    ),
    Stated(
        "library",
        "{materials|0} measurements at draft quality take {seconds, one process|0} s by one process and "
        "{seconds, two processes|0} s by two on two cores, {times as fast|2} times as fast; a process holds "
        "{MB of a worker at most|0} MB at most. Done again with nothing changed it takes {seconds, nothing to do|1} s. "
        "Through Dask with two workers, one of them killed half way, {seconds, Dask, one of two workers killed|0} s.",
        "addon/docs/library.md",
    ),
    Stated(
        "faults",
        "Of {all, tried|0} faults, {hostile bundles, tried|0} of them edited bundles, none lost a bundle, left one "
        "half-written, or touched a file outside.",
        "addon/docs/library.md",
        ("all, lost < 1", "all, half-written < 1", "all, escaped < 1"),
    ),
    Stated(
        "thousand",
        "whose client was killed after {finished when killed|0} and given again: {kept by the second run|0} were kept, "
        "{baked by the second run|0} baked, none twice, and none is missing. Scheduler and client take 11 ms beside "
        "the baking of each, and {MB gained over 1000|0} MB more at the end than at the start; nothing takes more than "
        "{MB at most|0} MB.",
        "addon/docs/library.md",
        ("baked twice < 1", "missing < 1", "left half-made < 1", "seconds beside baking, for each < 0.0115"),
    ),
    _format("MERL", "MERL"),
    _format("NVIDIA MBSDF", "NVIDIA MBSDF"),
    _format("numpy array", "numpy array"),
    _format("Zemax tabular BSDF", "Zemax BSDF"),
    _format("Integra DDR", "Integra DDR"),
    _format("FRED", "FRED"),
    _format("LightTools", "LightTools"),
    _format("ASTM E2387", "ASTM E2387"),
    _format("ALTA", "ALTA"),
    _format("pab-opto", "pab-opto"),
    _format("table of samples", "table of samples"),
    _format("Klems matrix", "WINDOW or Radiance XML"),
    _format("UTIA", "UTIA"),
    _format("Cornell", "Cornell"),
    _format("EPFL/RGL, brushed metal", "brushed, RGL"),
    _format("UTIA, picture of brushed metal", "brushed, UTIA picture"),
    _format("table of samples, brushed metal", "brushed, table"),
    _format("ALTA, binary", "ALTA, binary"),
    _format("tensor tree", "tensor tree"),
    _format("Klems matrix, transmission", "Klems, transmission"),
    _format("NVIDIA MBSDF, transmission", "NVIDIA MBSDF, transmission"),
    _engine("Preview", "preview"),
    _engine("Balanced", "balanced"),
    _engine("Exact", "exact"),
    _engine("Exact, not aimed", "exact, not aimed"),
    _engine("Reference", "reference"),
    _engine("Reference, not aimed", "reference, not aimed"),
    Stated(
        "engine",
        "Exact has {noise, exact, lamps sampled, small lamp|2s} times Principled's noise under the small lamp and "
        "{noise, exact, lamps sampled, sun and sky|2s} under sun and sky, at {time, exact, lamps sampled|2s} times "
        "the time of a sample",
    ),
    Stated("engine", "little noise of its own ({Principled's own noise, small lamp|1%} %)"),
    _arc("closure + mirror, aimed (default)", "envelope + residual, aimed at lamps"),
    _arc("mirror only, aimed", "mirror only, aimed at lamps"),
    _arc("closure + mirror, not aimed", "envelope + residual, not aimed"),
    _arc("mirror only, not aimed", "mirror only, not aimed"),
    Stated(
        "techniques",
        "the RMS difference is {RMS, lookup, between the photographs, least|0%} to "
        "{RMS, lookup, between the photographs, most|0%} % of the picture's (a lit texture: "
        "{RMS, lit_texture, between the photographs, least|0%} to "
        "{RMS, lit_texture, between the photographs, most|0%} %), with light from the side "
        "or from behind {RMS, lookup, aside or behind, least|0%} to "
        "{RMS, lookup, aside or behind, most|0%} %",
    ),
    Stated("techniques", EVERY_SIDE),
    *(_azimuth(*row.split("; ")) for row in _STACKS),
    *(Stated(*row) for row in (*GANTRY, *LIGHT)),
    Stated(
        "lobes",
        "| Cubic (Romanyuk 2007) | {relative, cubic|2s%} % | a wide foot, up to {of the peak, cubic|0%} % of the peak",
    ),
    Stated("lobes", "| Cosine, Lyon | {relative, cosine|2s%} %, {relative, lyon|2s%} % |"),
    Stated("lobes", "| Schlick | {relative, schlick|2s%} % | a wider foot, up to {of the peak, schlick|0%} % |"),
    Stated(
        "lobes",
        f"cos^n to its last digits and the cubic took {{ns, {_NODES}, power|0}} and {{ns, {_NODES}, cubic|0}} ns as "
        f"nodes, {{ns, {_OSL}, power|0}} and {{ns, {_OSL}, cubic|0}} ns in OSL, {{ns, numpy, one n, power|0}} and "
        "{ns, numpy, one n, cubic|0} ns in numpy, where the plain power, its base rounded, takes "
        f"{{ns, {_NODES}, power alone|0}}, {{ns, {_OSL}, power alone|0}} and {{ns, numpy, power alone|1}} ns. "
        f"Schlick's takes {{time over cos^n, {_NODES}, schlick|2}} and Lyon's {{time over cos^n, {_NODES}, lyon|2}} of "
        "the time of cos^n as nodes.",
    ),
    Stated(
        "cost",
        "The Bezier table of 64 x 64 x 128 (RMS {RMS, bezier, trilinear, 64|4}) is closer than a uniform one of "
        "{MB, uniform, trilinear, 128 ÷ MB, bezier, trilinear, 64|1} times its memory "
        "({RMS, uniform, trilinear, 128|4}); identity never gets near. By RMS the fitted B-spline errs more at "
        "every size ({RMS, bezier, B-spline fitted, 64|4} at that one); of the reflected energy, which the plot shows, "
        "it has less wrong from N = 48 on",
        claims=(
            "RMS, bezier, trilinear, 64 < RMS, uniform, trilinear, 128",
            "RMS, bezier, trilinear, 64 < RMS, identity, trilinear, 128",
            *(f"1 < {_B_SPLINE.format('RMS', n)}" for n in (16, 24, 32, 48, 64, 96, 128)),
            *(f"1 < {_B_SPLINE.format('energy off', n)}" for n in (16, 24, 32)),
            *(f"{_B_SPLINE.format('energy off', n)} < 1" for n in (48, 64, 96, 128)),
        ),
    ),
    Stated("speed", "| nearest | {time, nearest|2} |"),
    Stated("speed", "| trilinear (default) | {time, trilinear|2} |"),
    Stated("speed", "| cubic B-spline | {time, bspline|2} |"),
    Stated(
        "speed",
        "a MERL file was a finished bundle after {bake s, trilinear|0} s, {bake candidates, trilinear|0} kinds of "
        "table compared, at a peak of {bake MB, trilinear|0} MB; with B-spline coefficients fitted, after "
        "{bake s, bspline|0} s",
    ),
    Stated(
        "bases",
        "of the 82 materials below none is held worse than by the better basis, but for "
        f"{{{_MERL}, auto over best, excess|1%}} % on one",
        claims=(f"{_RGL}, auto over best, excess < 0.001",),
    ),
    Stated("bases", "| {RGL measurements, count|0} genuine RGL measurements | " + _BASES.format(_RGL, 1)),
    Stated("bases", "| {MERL reconstructions, count|0} reconstructed MERL materials | " + _BASES.format(_MERL, 2)),
    Stated(
        "tables",
        "finds the Bezier shape of least error on {MERL reconstructions, intensity found the best|0} of the "
        "{MERL reconstructions, count|0}",
    ),
    Stated(
        "bytes",
        "{bytes, log over half, least|2} to {bytes, log over half, most|2} of the file of half floats and, up to N = "
        "{N, log better up to|0}, the smaller error too",
    ),
    _bytes("2.7 kB (a neural BRDF's)", 2700),
    _bytes("10 KiB", 10240),
    _bytes("48 KiB (an RGL material's)", 49152),
    _bytes("256 KiB", 262144),
    Stated(
        "bytes",
        "A whole bundle of N = 12 (all modes) takes {bundle MiB, 12 log 64|1} MiB, nearly all of it tables that "
        "directions are drawn by; with `--sampler 16` {bundle KiB, 12 log 16|0} KiB, at {bundle noise, 12 log 16|2} "
        "instead of {bundle noise, 12 log 64|2} of noise",
    ),
    Stated(
        "within",
        "Such tables of the twelve RGL measurements err by {RGL share, log, 2700|2s%} % in the median, "
        "{RGL share, log, 2700, least|2s%} to {RGL share, log, 2700, most|2s%} %, and the published networks of that "
        "size (Sztrajman et al. 2021), in the better of their two conventions, by {RGL share, network|2s%} %. In "
        "48 KiB, what an RGL material takes, they err by {RGL share, log, 49152|2s%} %, "
        "{RGL share, log, 49152, least|2s%} to {RGL share, log, 49152, most|2s%} % (`./run bench within`)",
        claims=(
            "RGL share, log, 2700 < 0.09",
            "RGL share, log, 2700 < RGL share, network",
            "RGL share, log, 49152 < 0.01",
        ),
    ),
    Stated(
        "anisotropic",
        "| RMS in 1/sr at about 3.5 MB, `./run bench anisotropic",
        claims=("3.2 < MB, brushed metal, half auto, 48", "MB, brushed metal, normal bezier, 48 < 3.8"),
    ),
    _anisotropic("brushed metal (GGX)", "brushed metal"),
    _anisotropic("fine brushing (GGX)", "fine brushing"),
    _anisotropic("satin (Ward)", "satin"),
    _anisotropic("Ashikhmin-Shirley", "Ashikhmin-Shirley"),
    _kind("paint, normal basis, Bezier", "paint, normal, Bezier"),
    _kind("paint, half vectors, fitted", "paint, half, fitted"),
    _kind("brushed metal, normal basis", "brushed metal, normal"),
    _kind("brushed metal, half vectors", "brushed metal, half"),
    *(Stated("detail", row, "addon/docs/maps.md") for row in ROWS),
    Stated("detail", SAME, "addon/docs/maps.md", SAME_CLAIMS),
    Stated(
        "bytes",
        "{bytes, log over half, least|2} to {bytes, log over half, most|2} of the bytes of half floats",
        file="CHANGELOG.md",
    ),
)
