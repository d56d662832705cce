"""Sub-command `bake`: measurements or analytic models to bundles."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from ..bake.bake_brdf import BakeResult, BakeSettings, SplineFit, bake_file, bake_source
from ..bake.bundle import SUFFIX
from ..bake.errors import BakeError
from ..bake.parameterization import PARAMETERIZATIONS
from ..bake.sources import known_formats
from ..bake.sources.analytic import ANALYTIC, by_name
from ..bake.storage import Storage
from ..bake.table import FILTERS
from .cli_result import Result
from .describe import bake_summary
from .progress import Progress
from .stages import bake_stages

Bake = Callable[[Path, BakeSettings, Progress], BakeResult]


@dataclass(frozen=True)
class _Job:
    title: str
    stem: str
    bake: Bake


def add_to(commands: Any) -> None:
    """Add `bake` with what can be baked."""
    bake = commands.add_parser("bake", help="bake a measurement to a bundle", description="Bake to a bundle.")
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
    _add_settings(brdf)
    brdf.add_argument("--json", action="store_true", help="print the result as JSON")
    brdf.set_defaults(run=run, command="bake brdf")


def _add_settings(parser: argparse.ArgumentParser) -> None:
    usual = BakeSettings()
    parser.add_argument(
        "--resolution", type=int, default=usual.resolution, metavar="N", help="of the N x N x 2N table (%(default)s)"
    )
    parser.add_argument(
        "--parameterization", choices=PARAMETERIZATIONS, default=usual.parameterization, help="(%(default)s)"
    )
    parser.add_argument(
        "--alpha",
        type=_alpha,
        default=usual.alpha,
        metavar="error|intensity|A,B",
        help="Bezier shape: of least measured error, of largest table intensity, or given for theta, phi (%(default)s)",
    )
    parser.add_argument(
        "--storage",
        choices=[str(kind) for kind in Storage],
        default=str(usual.storage),
        help="of the texels (%(default)s)",
    )
    parser.add_argument("--filter", choices=FILTERS, default=usual.filter, help="(%(default)s)")
    parser.add_argument(
        "--spline",
        choices=get_args(SplineFit),
        default=usual.spline,
        help="coefficients for --filter bspline: the plain samples, fitted ones, or the better (%(default)s)",
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
    """Bake every input; a bad one is told and does not keep the others from being baked."""
    settings = _settings(options)
    jobs, errors = _jobs(options)
    targets = _targets(jobs, options.out)
    done: list[BakeResult] = []
    with _made(options.out if options.out.suffix.lower() != SUFFIX else None):
        with Progress(bake_stages(settings), len(jobs)) as progress:
            for job, target in zip(jobs, targets):
                progress.start(job.title)
                try:
                    done.append(job.bake(target, settings, progress))
                except BakeError as error:
                    errors.append(error)
    document = {
        "command": options.command,
        "bundles": [{"path": str(result.path), **result.facts} for result in done],
    }
    return Result(document, [bake_summary(result.path, result.facts, result.seconds) for result in done], errors)


def _settings(options: argparse.Namespace) -> BakeSettings:
    try:
        return BakeSettings(
            resolution=options.resolution,
            parameterization=options.parameterization,
            alpha=options.alpha,
            storage=Storage(options.storage),
            filter=options.filter,
            spline=options.spline,
        )
    except BakeError as error:
        raise argparse.ArgumentTypeError(f"--{error}") from None


def _jobs(options: argparse.Namespace) -> tuple[list[_Job], list[BakeError]]:
    if not options.files and not options.analytic:
        raise argparse.ArgumentTypeError("nothing to bake: give a FILE or --analytic NAME")
    jobs, errors = [], []
    for file in options.files:
        jobs.append(_Job(file.name, file.stem, _file_baker(file)))
    for name, *pairs in options.analytic:
        parameters = dict(_parameter(pair) for pair in pairs)
        try:
            source = by_name(name, **parameters)
        except BakeError as error:
            errors.append(error)
        else:
            jobs.append(_Job(source.name, source.name, _source_baker(source)))
    return jobs, errors


def _file_baker(file: Path) -> Bake:
    return lambda target, settings, progress: bake_file(file, target, settings, progress)


def _source_baker(source: Any) -> Bake:
    return lambda target, settings, progress: bake_source(source, target, settings, progress)


def _parameter(pair: str) -> tuple[str, Any]:
    key, equals, text = pair.partition("=")
    if not equals or not key.isidentifier():
        raise argparse.ArgumentTypeError(f"--analytic takes KEY=VALUE after the name, not {pair!r}")
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return key, text
    return key, numbers if len(numbers) > 1 else numbers[0]


def _targets(jobs: list[_Job], out: Path) -> list[Path]:
    """Bundle of each job. Two jobs must not write the same one."""
    if out.suffix.lower() == SUFFIX:
        if len(jobs) > 1:
            raise argparse.ArgumentTypeError(
                f"--out {out} names one bundle, but there are {len(jobs)} inputs; give a folder"
            )
        return [out] * len(jobs)
    seen: set[str] = set()
    for job in jobs:
        # Many file systems do not tell upper from lower case.
        if job.stem.casefold() in seen:
            raise argparse.ArgumentTypeError(f"two inputs would become {job.stem}{SUFFIX}; bake them one at a time")
        seen.add(job.stem.casefold())
    return [out / (job.stem + SUFFIX) for job in jobs]


@contextlib.contextmanager
def _made(folder: Path | None) -> Iterator[None]:
    """Make the output folder for the block, and take back what nothing was put into."""
    missing: list[Path] = []
    if folder is not None:
        missing = [place for place in (folder, *folder.parents) if not place.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            cause = f"cannot be made ({getattr(error, 'strerror', None) or error})"
            raise BakeError(folder, cause, "choose a folder you may write to") from error
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            for place in missing:
                place.rmdir()
