"""What the kinds of `bake` share: one job per input, each to its own bundle."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...bake.bundle.bundle import SUFFIX
from ...bake.bundle.origin import Origin, refuse_another
from ...bake.bundle.result import BakeResult
from ...bake.errors import BakeError
from ...bake.rights import RIGHTS, Rights
from ..library.names import name_key
from ..summary.quality_levels import LEVELS, STANDARD
from .console.progress import Progress

Levels = Mapping[str, Mapping[str, Any]]
Bake = Callable[[Path, Any, Progress], BakeResult]


@dataclass(frozen=True)
class Job:
    """One input: its title in the progress, the bundle's name without suffix, what bakes it, and what it is."""

    title: str
    stem: str
    bake: Bake
    origin: Callable[[], Origin]


def bake_jobs(
    jobs: Sequence[Job],
    out: Path,
    settings: Any,
    stages: Mapping[str, float],
    baked: Callable[[Job, BakeResult], None] = lambda job, result: None,
    *,
    replace: bool = False,
) -> tuple[list[BakeResult], list[BakeError]]:
    """Bake every job; a bad one is reported and does not stop the others.

    Parameters
    ----------
    out : folder, or a bundle where there is one job
    stages : of each job, with their seconds
    baked : called after each bake, while nothing else is on the terminal's line
    replace : also bundles that were baked from another source

    Raises `argparse.ArgumentTypeError` where two jobs would write one bundle, BakeError where `out` cannot be made.
    """
    targets = _targets(jobs, out)
    done, errors = [], []
    with made_folder(out.parent if out.suffix.lower() == SUFFIX else out), Progress(stages, len(jobs)) as progress:
        for job, target in zip(jobs, targets):
            progress.start(job.title)
            try:
                if not replace:
                    refuse_another(target, job.origin)
                result = job.bake(target, settings, progress)
            except BakeError as error:
                errors.append(error)
                continue
            done.append(result)
            progress.close()
            baked(job, result)
    return done, errors


def add_quality(parser: Any, levels: Levels) -> None:
    """Add the option that `chosen_quality` reads."""
    parser.add_argument(
        "--quality",
        choices=LEVELS,
        default=STANDARD,
        help=f"sets {' and '.join(f'--{name}' for name in levels[STANDARD])} where they are not given (%(default)s)",
    )


def chosen_quality(options: argparse.Namespace, levels: Levels) -> dict[str, Any]:
    """What the level sets, and in its place what was given."""
    return {
        name: value if (given := getattr(options, name)) is None else given
        for name, value in levels[options.quality].items()
    }


def add_replace(parser: Any) -> None:
    """Add the option that `bake_jobs` takes as `replace`."""
    parser.add_argument(
        "--replace",
        action="store_true",
        help="also replace a bundle of that name that was baked from another source (one of the same source always is)",
    )


_STATED = {
    "author": "who measured it or took the photographs",
    "license": "what others may do with it, for instance CC0",
    "source_url": "where it was found",
}


def add_rights(parser: Any) -> None:
    """Add the options that `stated_rights` reads."""
    group = parser.add_argument_group("author and license", "kept in the bundle, and in the asset made of it")
    for name in RIGHTS:
        group.add_argument(f"--{name.replace('_', '-')}", default="", metavar="TEXT", help=_STATED[name])


def stated_rights(options: argparse.Namespace) -> Rights:
    """What was stated. Raises BakeError."""
    return Rights(**{name: getattr(options, name) for name in RIGHTS})


def usage_error(error: BakeError, options: argparse.Namespace) -> argparse.ArgumentTypeError:
    """A setting's error as one of usage, naming the option where there is one of that name."""
    name = error.file.replace(" ", "_").replace("-", "_")
    shown = f"--{name.replace('_', '-')}" if hasattr(options, name) else error.file
    return argparse.ArgumentTypeError(f"{shown}: {error.cause}; {error.remedy}")


def _targets(jobs: Sequence[Job], out: Path) -> list[Path]:
    """Bundle of each job. Two jobs must not write the same one."""
    if out.suffix.lower() == SUFFIX:
        if len(jobs) > 1:
            raise argparse.ArgumentTypeError(
                f"--out {out} names one bundle, but there are {len(jobs)} inputs; give a folder"
            )
        return [out] * len(jobs)
    seen: set[str] = set()
    for job in jobs:
        key = name_key(job.stem)
        if key in seen:
            remedy = f"bake one of them with --out OTHER{SUFFIX}"
            raise argparse.ArgumentTypeError(f"two inputs would become {job.stem}{SUFFIX}; {remedy}")
        seen.add(key)
    return [out / (job.stem + SUFFIX) for job in jobs]


@contextlib.contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make the output folder for the block, and take back what nothing was put into."""
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
