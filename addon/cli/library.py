"""Sub-command `bake library`: many materials at once, on all cores or on a cluster."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Iterator, Sequence
from copy import copy
from functools import cache, partial
from pathlib import Path
from typing import Any, NoReturn

from ...bake.atomic_write import sweep
from ...bake.brdf.settings import BakeSettings
from ...bake.bundle.bundle import SUFFIX
from ...bake.errors import BakeError
from ..baking.hosts import hosts
from ..baking.request import BakeRequest
from ..library.inputs import LIST_SUFFIX, Source, formula, lines_of, sources_in, wanted_of
from ..library.lock import library_lock
from ..library.names import Earlier, unique_names
from ..library.outcome import BAKED, Outcome
from ..library.plan import LibraryJob, Plan
from ..library.pool import Watch, bake_by_processes, usual_count
from ..library.run import run_task
from ..library.table import TABLE_SUFFIXES, errors_of, library_document, names_kept, table_lines, write_table
from ..summary.bake_stages import bake_stages
from ..summary.quality_levels import LEVELS, STANDARD
from . import bake_brdf, bake_photographs, farm
from .bake_jobs import add_replace, add_rights
from .console.library_progress import LibraryProgress
from .console.option_words import words_of
from .console.photograph_options import add_photographs
from .console.reading_options import add_reading, reading_of
from .console.result import Result
from .lighting_options import add_lighting, known_lobes

_KIND = "library"
# Seconds between two writings of the table while materials are baked.
_PAUSE = 5.0
# Options of the library as a whole, not of a material.
_OF_LIBRARY = ("out", "jobs", "dask", "task", "exit_zero", "export", "farm_program", "assets", "json")
# Those that are not among the settings of a material.
_OF_ALL = (*_OF_LIBRARY, "analytic", "name", "help")
# Options that name a file.
_FILES = ("lights", "flat_field", "through", "through_lights")


def add_to(kinds: Any) -> None:
    """Add `library` to the kinds of `bake`."""
    parser = kinds.add_parser(
        _KIND,
        help="many materials at once, on all cores or on a cluster",
        description="Bake measurements, folders of photographs and formulas, each to a bundle in one folder. Folders "
        f"are searched, also those below them; a list (FILE{LIST_SUFFIX}) names one source on each line, with options "
        "of its own behind it. What is there already from an equal source and equal settings is kept; a library that "
        "was interrupted goes on when the same command is given again. library.json and library.csv hold a table.",
    )
    _add_options(parser)
    parser.set_defaults(run=run, command=f"bake {_KIND}")


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sources", nargs="*", type=Path, metavar=f"FILE|FOLDER|FILE{LIST_SUFFIX}", help="what to bake")
    parser.add_argument(
        "--analytic",
        action="append",
        nargs="+",
        default=[],
        metavar=("NAME", "KEY=VALUE"),
        help="bake a formula, as `bake brdf` does",
    )
    parser.add_argument("--out", type=Path, metavar="LIB", help="folder of the library")
    parser.add_argument("--name", default="", help="of the bundle, where there is one source, or in a line of a list")
    add_replace(parser)
    where = parser.add_argument_group("where it is baked")
    where.add_argument(
        "--jobs",
        type=_count,
        metavar="N",
        help="processes at once, each on one core (as many as cores and memory allow); 0 bakes in this process",
    )
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="of a Dask scheduler, such as tcp://host:8786, on whose workers to bake; they see the same folders",
    )
    where.add_argument(
        "--task",
        action="store_true",
        help="one material as a task of a farm, beside other tasks: no table",
    )
    where.add_argument(
        "--exit-zero",
        action="store_true",
        help="with --task: tell of a material that no machine could bake, but do not fail by it",
    )
    where.add_argument(
        "--export",
        choices=farm.FARMS,
        help="bake nothing, and write what that farm needs to do it into the library's folder",
    )
    where.add_argument(
        "--farm-program",
        default="",
        metavar="WORDS",
        help="with --export: what a farm's machines run (blender --background --command measured_materials)",
    )
    parser.add_argument(
        "--assets", type=Path, metavar="DIR", help="afterwards bring an asset library in line, as `assets LIB` does"
    )
    add_rights(parser)
    parser.add_argument(
        "--quality",
        choices=LEVELS,
        default=STANDARD,
        help="of tables and of shading maps, where their own options are not given (%(default)s)",
    )
    bake_brdf.add_settings(parser.add_argument_group("measurements and formulas"))
    add_reading(parser)
    add_photographs(parser.add_argument_group("photographs"))
    bake_photographs.add_through(parser.add_argument_group("against the light"))
    bake_photographs.add_map(parser.add_argument_group("shading map"), "--map-storage")
    bake_photographs.add_azimuths(parser.add_argument_group("light from every side"))
    add_lighting(
        parser.add_argument_group("lighting of shading maps, which can be changed later without baking"),
        f"base reflection (f_r): {known_lobes()}; auto fits one to the photographs; FILE{SUFFIX} is a baked BRDF "
        "(lambert)",
        f"NAME|auto|FILE{SUFFIX}",
    )
    parser.add_argument("--json", action="store_true", help="print the table as JSON")


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are the caller's."""

    def error(self, message: str) -> NoReturn:
        raise argparse.ArgumentTypeError(message)


@cache
def _parser() -> _Parser:
    parser = _Parser(prog=f"bake {_KIND}", add_help=False, allow_abbrev=False)
    _add_options(parser)
    return parser


def run(options: argparse.Namespace) -> Result:
    """Bake all; a bad one is reported and does not stop the others."""
    if options.out is None:
        raise argparse.ArgumentTypeError("give the folder of the library by --out LIB")
    if options.out.suffix.lower() == SUFFIX:
        raise argparse.ArgumentTypeError(f"--out {options.out} names one bundle; give a folder")
    if options.dask and options.jobs is not None:
        raise argparse.ArgumentTypeError("--jobs is of this machine's processes: leave it out beside --dask")
    farm.check(options)
    plan = plan_of(options)
    if options.export:
        return farm.export(plan, options)
    with farm.folder_of(plan, options), library_lock(plan.out, shared=options.task):
        result = _run_one(plan, options) if options.task else _run_all(plan, options)
    return farm.with_assets(result, plan, options)


def plan_of(options: argparse.Namespace) -> Plan:
    """What is to be baked, under which names. Raises BakeError or `argparse.ArgumentTypeError`."""
    out = Path(os.path.abspath(options.out))
    found = list(_found(_with_whole_paths(options, Path()), out))
    if not found:
        raise argparse.ArgumentTypeError("nothing to bake: give files, folders, a list, or --analytic NAME")
    before = names_kept(out)
    wanted = wanted_of([(source, given.name) for source, given in found], before)
    jobs = []
    for (source, given), name, one in zip(found, unique_names(wanted, before), wanted):
        # What the library baked from this very source is its own to bake again when the source has changed.
        given.replace = given.replace or before.get(one.identity) == Earlier(name, ours=True)
        jobs.append(_job(source, given, name, one.identity))
    return Plan(out, tuple(jobs), before)


def _found(options: argparse.Namespace, out: Path) -> Iterator[tuple[Source, argparse.Namespace]]:
    """Sources with the options that each is baked by, in the order in which they are given; none twice."""
    seen: set[tuple[str, ...]] = set()
    for source, given in _listed(options, out):
        given.material = source.material or given.material
        told = (*source.words, *words_of(_parser(), given, _OF_ALL), given.name)
        if told not in seen:
            seen.add(told)
            yield source, given


def _listed(options: argparse.Namespace, out: Path) -> Iterator[tuple[Source, argparse.Namespace]]:
    lists = [path for path in options.sources if path.suffix.lower() == LIST_SUFFIX]
    reading = reading_of(options)
    sources = [source for path in options.sources if path not in lists for source in sources_in(path, reading, out)]
    for name, *pairs in options.analytic:
        sources.append(formula(name, dict(map(bake_brdf.parameter, pairs)), (name, *pairs)))
    if options.name and (lists or len(sources) > 1):
        raise argparse.ArgumentTypeError(f"--name {options.name} is one bundle's, but there are more sources than one")
    if options.through and sum(source.photographs for source in sources) > 1:
        raise argparse.ArgumentTypeError(f"--through {options.through} is one swatch's; give it in a line of a list")
    for source in sources:
        yield source, copy(options)
    for file in lists:
        for number, words in lines_of(file):
            yield from _of_line(f"{file}: line {number}", words, options, file.parent, out)


def _of_line(
    where: str, words: Sequence[str], usual: argparse.Namespace, folder: Path, out: Path
) -> Iterator[tuple[Source, argparse.Namespace]]:
    """Sources of a line of a list, with the usual options but for its own; paths are counted from the list's folder."""
    options = copy(usual)
    options.sources, options.analytic = [], []
    try:
        _parser().parse_args(list(words), options)
        other = next((name for name in _OF_LIBRARY if getattr(options, name) != getattr(usual, name)), None)
        if other:
            raise argparse.ArgumentTypeError(f"--{other} is the whole library's: give it beside the list")
        if any(path.suffix.lower() == LIST_SUFFIX for path in options.sources):
            raise argparse.ArgumentTypeError("a list cannot name another list")
        options = _with_whole_paths(options, folder)
        options.sources = [folder / path for path in options.sources]
        for source, given in _listed(options, out):
            _request(source, given)  # for what is wrong with its settings, while the line is known
            yield source, given
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{where}: {error}") from None


def _with_whole_paths(options: argparse.Namespace, folder: Path) -> argparse.Namespace:
    """Options whose files are named by absolute paths, as they are read by processes elsewhere; relative ones are
    counted from `folder`."""
    found = copy(options)
    for name in _FILES:
        if (path := getattr(options, name)) is not None:
            setattr(found, name, Path(os.path.abspath(folder / path)))
    if options.lobe and Path(options.lobe[0]).suffix.lower() == SUFFIX:  # a baked BRDF
        found.lobe = [os.path.abspath(folder / options.lobe[0]), *options.lobe[1:]]
    return found


def _job(source: Source, options: argparse.Namespace, name: str, identity: str) -> LibraryJob:
    words = [*source.words, *words_of(_parser(), options, _OF_ALL), f"--name={name}"]
    return LibraryJob(name, _request(source, options), tuple(words), options.replace, identity, source.refused)


def _request(source: Source, options: argparse.Namespace) -> BakeRequest:
    if not source.photographs:
        return BakeRequest(source.source, bake_brdf.settings_of(options))
    of_maps = copy(options)
    of_maps.storage = options.map_storage
    return BakeRequest(source.source, bake_photographs.settings_of(of_maps))


def _run_one(plan: Plan, options: argparse.Namespace) -> Result:
    """One task of a farm."""
    if len(plan.jobs) != 1 or options.dask or options.jobs:
        raise argparse.ArgumentTypeError("--task is for one material, baked by this process")
    (job,) = plan.jobs
    with LibraryProgress(1) as progress:
        outcome = run_task(job, plan.out, partial(progress.at, job.name, bake_stages(job.request.settings)))
    result = _result(plan, {job.name: outcome}, outcome.seconds, options, [])
    return farm.told(result) if options.exit_zero and not outcome.of_machine else result


def _run_all(plan: Plan, options: argparse.Namespace) -> Result:
    started = written = time.monotonic()
    outcomes: dict[str, Outcome] = {}
    errors: list[BakeError] = []
    sweep(plan.out, *TABLE_SUFFIXES)
    write_table(plan, outcomes)
    try:
        with LibraryProgress(len(plan.jobs)) as progress:

            def watch(job: LibraryJob, stage: str, share: float) -> None:
                progress.at(job.name, bake_stages(job.request.settings), stage, share)

            for outcome in _baked(plan, options, watch):
                outcomes[outcome.name] = outcome
                progress.ended(outcome.name, outcome.state == BAKED)
                if time.monotonic() - written > _PAUSE:
                    written = time.monotonic()
                    with contextlib.suppress(BakeError):  # a full disk, say; the last one tells of it
                        write_table(plan, outcomes)
    finally:
        try:
            write_table(plan, outcomes)
        except BakeError as error:
            errors.append(error)
    return _result(plan, outcomes, time.monotonic() - started, options, errors)


def _baked(plan: Plan, options: argparse.Namespace, watch: Watch) -> Iterator[Outcome]:
    if options.dask:
        from ..library.dask_cluster import bake_by_dask

        return bake_by_dask(plan.jobs, plan.out, options.dask)
    if options.jobs == 0:
        return (run_task(job, plan.out, partial(watch, job)) for job in plan.jobs)
    # Photographs may need another program than all else.
    requests = [job.request for job in plan.jobs]
    needs_most = next((one for one in requests if not isinstance(one.settings, BakeSettings)), requests[0])
    commands = hosts(needs_most, _blender())
    return bake_by_processes(plan.jobs, plan.out, options.jobs or usual_count(), commands, watch)


def _blender() -> str:
    """Path of the Blender that this runs in; "" where it is a module or is not there."""
    bpy = sys.modules.get("bpy")
    return "" if bpy is None else str(bpy.app.binary_path)


def _result(
    plan: Plan, outcomes: dict[str, Outcome], seconds: float, options: argparse.Namespace, errors: list[BakeError]
) -> Result:
    document = {"command": options.command, "out": str(plan.out), "seconds": round(seconds, 3)}
    ended = [outcomes[job.name] for job in plan.jobs if job.name in outcomes]
    lines = table_lines(plan, outcomes, seconds)
    return Result({**document, **library_document(plan, outcomes)}, lines, [*errors_of(ended), *errors])


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) > 4096:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 0 to 4096")
    return int(text)
