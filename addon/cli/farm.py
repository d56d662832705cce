"""What `bake library` does beyond a bake: jobs written for a farm, and an asset library of what it has baked."""

from __future__ import annotations

import argparse
import contextlib
import shlex
from typing import Any

from ...bake.errors import BakeError
from ..exports.flamenco import write_flamenco
from ..exports.opencue import BLENDER, write_opencue
from ..library.lock import library_lock
from ..library.plan import Plan
from .assets import write_assets
from .bake_jobs import made_folder
from .console.need_blender import need_blender
from .console.result import Result

FLAMENCO, OPENCUE = FARMS = ("flamenco", "opencue")


def check(options: argparse.Namespace) -> None:
    """Before anything is baked: raise `argparse.ArgumentTypeError` where options of these do not go together, BakeError
    where there is no Blender for --assets."""
    if options.exit_zero and not options.task:
        raise argparse.ArgumentTypeError("--exit-zero is for a --task")
    if options.farm_program and not options.export:
        raise argparse.ArgumentTypeError("--farm-program is for --export")
    if options.export and (options.task or options.dask or options.jobs is not None):
        raise argparse.ArgumentTypeError("--export bakes nothing here: leave out --task, --dask and --jobs")
    if options.export == OPENCUE and options.assets:
        raise argparse.ArgumentTypeError("commands of cuecmd wait for none: run `assets LIB` when they have ended")
    if options.task and options.assets:
        raise argparse.ArgumentTypeError("--assets is for the whole library: leave out --task")
    if options.assets and not options.export:
        need_blender("bake library --assets")


def folder_of(plan: Plan, options: argparse.Namespace) -> contextlib.AbstractContextManager[None]:
    """The library's folder for the block, made unless a task is to find it there. Raises BakeError."""
    if not options.task:
        return made_folder(plan.out)
    if not plan.out.is_dir():
        remedy = "see that this machine has the shared folder; --export makes the library's, or make it by hand"
        raise BakeError(plan.out, "is no folder that this machine sees", remedy)
    return contextlib.nullcontext()


def export(plan: Plan, options: argparse.Namespace) -> Result:
    """Write a library's jobs for the farm `options.export`. Raises BakeError."""
    program = shlex.split(options.farm_program)
    with made_folder(plan.out), library_lock(plan.out):
        if options.export == FLAMENCO:
            assets = None if options.assets is None else options.assets.absolute()
            files = write_flamenco(plan, assets, program)
        else:
            files = write_opencue(plan, program or BLENDER)
    names = [str(file) for file in files]
    return Result({"command": options.command, "jobs": len(plan.jobs), "files": names}, names)


def with_assets(result: Result, plan: Plan, options: argparse.Namespace) -> Result:
    """A library's result with that of the asset library that is made of its bundles, if one is asked for."""
    if options.assets is None:
        return result
    bundles = [target for job in plan.jobs if (target := job.target(plan.out)).is_dir()]
    try:
        # --replace is of bundles here: whoever has saved a .blend shall not lose it.
        made = write_assets(bundles, plan.out, options.assets, options, replace=False)
    except BakeError as error:
        return Result(result.document, result.lines, [*result.errors, error])
    document = {**result.document, "asset_library": made.document["library"], "assets": made.document["assets"]}
    return Result(document, [*result.lines, *made.lines], [*result.errors, *made.errors])


def told(result: Result) -> Result:
    """A result whose errors, of what a source holds, are words: the exit code is 0."""
    document: dict[str, Any] = {**result.document, "told": [str(error) for error in result.errors]}
    return Result(document, [*result.lines, *map(str, result.errors)])
