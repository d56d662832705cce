"""Sub-command `bake`: measurements, analytic models or photographs to bundles."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any, get_args

from ...bake.brdf.bake import bake_file, bake_source
from ...bake.brdf.record import BrdfRecord
from ...bake.brdf.samplers import KINDS, USUAL_SIZE, isotropic_layout, kind_of_layout
from ...bake.brdf.settings import FILTER_CHOICES, BakeSettings, SplineFit
from ...bake.bundle.bundle import SUFFIX, read_bundle
from ...bake.bundle.origin import Origin, file_origin, model_origin
from ...bake.bundle.result import BakeResult
from ...bake.errors import BakeError
from ...bake.images.storage import TABLE_STORAGES, Storage
from ...bake.reading import Reading
from ...bake.sources import chosen_material, known_formats, title_of
from ...bake.sources.analytic import ANALYTIC, by_name
from ...bake.tables.grids.parameterization import PARAMETERIZATIONS
from ...bake.tables.search.byte_limit import LEAST_BYTES, MOST_BYTES
from ...bake.tables.search.grid_search import BASES
from ..summary.bake_stages import bake_stages
from ..summary.brdf_rows import bake_summary
from ..summary.quality_levels import BRDF_LEVELS, by_quality
from ..summary.sheet_rows import sheet_warning
from . import bake_photographs
from .bake_jobs import (
    Bake,
    Job,
    add_quality,
    add_replace,
    add_rights,
    bake_jobs,
    chosen_quality,
    stated_rights,
    usage_error,
)
from .console.reading_options import add_reading, reading_of
from .console.result import Result, complain

_SAMPLERS = (16, 24, 32, 48, 64, 96, 128)


def add_to(commands: Any) -> Any:
    """Add `bake` with what can be baked; returns its kinds, for further ones."""
    bake = commands.add_parser(
        "bake", help="bake a measurement or photographs to a bundle", description="Bake to a bundle."
    )
    kinds = bake.add_subparsers(metavar="KIND", required=True)
    brdf = kinds.add_parser(
        "brdf",
        help="a measured BRDF, or an analytic one",
        description=f"Bake BRDFs, each to a folder NAME{SUFFIX}. Formats: {known_formats()}.",
    )
    brdf.add_argument("files", nargs="*", type=Path, metavar="FILE", help="measurement")
    brdf.add_argument(
        "--analytic",
        action="append",
        nargs="+",
        default=[],
        metavar=("NAME", "KEY=VALUE"),
        help=f"bake a model ({', '.join(ANALYTIC)}), for instance: --analytic ggx alpha=0.1 f0=0.9,0.6,0.3",
    )
    brdf.add_argument("--out", type=Path, default=Path(), metavar="DIR|NAME.mmat", help="where to (default: here)")
    add_replace(brdf)
    add_rights(brdf)
    add_quality(brdf, BRDF_LEVELS)
    add_settings(brdf)
    add_reading(brdf)
    brdf.add_argument("--json", action="store_true", help="print the result as JSON")
    brdf.set_defaults(run=run, command="bake brdf")
    bake_photographs.add_to(kinds)
    return kinds


def add_settings(parser: Any) -> None:
    """Add the options that `settings_of` reads, but for `--quality`, those of reading and of rights."""
    usual = BakeSettings()
    parser.add_argument(
        "--resolution",
        type=int,
        metavar="N",
        help=f"of an N x N x 2N table, or as many bytes ({by_quality(BRDF_LEVELS, 'resolution')})",
    )
    parser.add_argument(
        "--basis",
        choices=("auto", *BASES),
        help="angles of the table: to the normal, to the half vector, or those of less measured error "
        f"({by_quality(BRDF_LEVELS, 'basis')})",
    )
    parser.add_argument(
        "--parameterization",
        choices=("auto", *PARAMETERIZATIONS),
        help="spacing of its samples; auto is that of least measured error "
        f"({by_quality(BRDF_LEVELS, 'parameterization')})",
    )
    parser.add_argument(
        "--alpha",
        type=_alpha,
        default=usual.alpha,
        metavar="error|intensity|A,B",
        help="Bezier shape: of least measured error, of largest table intensity, or given for theta, phi; the "
        "latter two make it a Bezier table in the normal basis (%(default)s)",
    )
    parser.add_argument(
        "--storage",
        choices=TABLE_STORAGES,
        default=str(usual.storage),
        help="of the texels; log, 8 bits of the logarithm, is best for files below 100 KiB (%(default)s)",
    )
    parser.add_argument(
        "--table-bytes",
        type=int,
        metavar="BYTES",
        help="with --storage log: as many samples as the file of each table holds within so many bytes "
        f"({LEAST_BYTES} to {MOST_BYTES}), whatever the resolution, of an isotropic measurement; with Cycles' own "
        "shaders a bundle has two tables, that of a sheet up to eight",
    )
    parser.add_argument(
        "--filter",
        choices=FILTER_CHOICES,
        default=usual.filter,
        help="auto: bspline where it errs so much less that it is worth a tenth of the time, which is weighed "
        "only without Cycles' own shaders (--no-envelope); over them it is trilinear (%(default)s)",
    )
    parser.add_argument(
        "--spline",
        choices=get_args(SplineFit),
        default=usual.spline,
        help="coefficients for --filter bspline: the plain samples, fitted ones, or the better (%(default)s)",
    )
    parser.add_argument(
        "--sampler",
        type=int,
        choices=_SAMPLERS,
        default=USUAL_SIZE,
        metavar="N",
        help="how finely directions are drawn, N from 16 to 128: by warps of N/4 x 3N/4 x N/4 cells or alias tables of "
        "N x N x N/2; fewer cells, a smaller bundle and more noise (%(default)s)",
    )
    parser.add_argument(
        "--sampler-kind",
        choices=KINDS,
        default=kind_of_layout(usual.sampler),
        help="alias: four random numbers; warp: two, and a ninth of the sampler's bytes, for a little more time and "
        "up to a third more variance in mode Exact, twice in Reference of rough metals (%(default)s)",
    )
    parser.add_argument(
        "--envelope",
        action=argparse.BooleanOptionalAction,
        default=usual.envelope,
        help="also fit Cycles' own shaders under the measurement, so that the mirror has only the rest to carry: less "
        "noise, at a bias of at most 0.1 %% of the light (on)",
    )


def _alpha(text: str) -> str | tuple[float, float]:
    if text in ("error", "intensity"):
        return text
    try:
        theta, phi = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither error nor intensity nor two numbers such as 0.5,0.5"
        ) from None
    return theta, phi


def run(options: argparse.Namespace) -> Result:
    """Bake every input; a bad one is reported and does not stop the others."""
    settings = settings_of(options)
    jobs, errors = _jobs(options, settings.reading)
    done, failed = bake_jobs(jobs, options.out, settings, bake_stages(settings), _warn, replace=options.replace)
    document = {
        "command": options.command,
        "bundles": [{"path": str(result.path), **result.facts} for result in done],
    }
    lines = [bake_summary(BrdfRecord.read(read_bundle(result.path)), result.seconds) for result in done]
    return Result(document, lines, errors + failed)


def _warn(job: Job, result: BakeResult) -> None:
    if warning := sheet_warning(BrdfRecord.read(read_bundle(result.path))):
        complain(f"warning: {job.title}: {warning}")


def settings_of(options: argparse.Namespace) -> BakeSettings:
    """The settings that were asked for. Raises `argparse.ArgumentTypeError`, or BakeError for a wrong statement."""
    try:
        return BakeSettings(
            **chosen_quality(options, BRDF_LEVELS),
            alpha=options.alpha,
            storage=Storage(options.storage),
            filter=options.filter,
            spline=options.spline,
            table_bytes=options.table_bytes,
            sampler=isotropic_layout(options.sampler_kind, options.sampler),
            envelope=options.envelope,
            reading=reading_of(options),
            rights=stated_rights(options),
        )
    except BakeError as error:
        raise usage_error(error, options) from None


def _jobs(options: argparse.Namespace, reading: Reading) -> tuple[list[Job], list[BakeError]]:
    if not options.files and not options.analytic:
        raise argparse.ArgumentTypeError("nothing to bake: give a FILE or --analytic NAME")
    jobs, errors = [], []
    for file in options.files:
        jobs.append(Job(file.name, title_of(file, reading), _file_baker(file), partial(_file_origin, file, reading)))
    for name, *pairs in options.analytic:
        parameters = dict(parameter(pair) for pair in pairs)
        try:
            source = by_name(name, **parameters)
        except BakeError as error:
            errors.append(error)
        else:
            origin = partial(model_origin, source.name, source.facts)
            jobs.append(Job(source.name, source.name, _source_baker(source), origin))
    return jobs, errors


def _file_baker(file: Path) -> Bake:
    return lambda target, settings, progress: bake_file(file, target, settings, progress)


def _file_origin(file: Path, reading: Reading) -> Origin:
    try:
        return file_origin(file, chosen_material(file, reading))
    except (BakeError, OSError, ValueError):  # reported by the reader
        return {}


def _source_baker(source: Any) -> Bake:
    return lambda target, settings, progress: bake_source(source, target, settings, progress)


def parameter(pair: str) -> tuple[str, Any]:
    """KEY=VALUE of a formula: a number, several, or a word. Raises `argparse.ArgumentTypeError`."""
    key, equals, text = pair.partition("=")
    if not equals or not key.isidentifier():
        raise argparse.ArgumentTypeError(f"--analytic takes KEY=VALUE after the name, not {pair!r}")
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return key, text
    return key, numbers if len(numbers) > 1 else numbers[0]
