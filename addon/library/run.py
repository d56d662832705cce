"""One job of a library in this process: skipped where it is finished, else baked; nothing it raises leaves it."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...bake.brdf.settings import BakeSettings
from ...bake.bundle.bundle import Bundle, move_bundle, read_bundle, staging
from ...bake.bundle.origin import Origin, file_origin, model_origin, photographs_origin, refuse_another
from ...bake.bundle.recipe import RECIPE, recipe_of
from ...bake.bundle.result import Progress
from ...bake.errors import BakeError
from ...bake.shading_maps.bake import ArcSettings, arc_recipe
from ...bake.shading_maps.record import ShadingMapRecord, read_record
from ...bake.sources import chosen_material
from ...bake.sources.analytic import by_name
from ..baking.request import BakeRequest, Model, run_request
from ..photographs.find_decoder import blender_decoder
from ..summary.text import one_line
from .memory import peak_bytes, resident_bytes
from .outcome import BAKED, FAILED, KEPT, Outcome, State
from .plan import LibraryJob


def run_task(
    job: LibraryJob, out: Path, progress: Progress | None = None, lies_in: Callable[[Path | None], None] | None = None
) -> Outcome:
    """Bake a job into the library `out`, unless it is there already.

    Whatever happens, the bundle is there whole, or an older one as it was. `lies_in` is called with the folder that the
    work lies in, which whoever ends the process may remove, and with None before the bundle leaves it for its place.
    """
    started = time.perf_counter()
    say_where = lies_in or (lambda folder: None)
    target, work = job.target(out), None
    try:
        if job.refused is not None:
            raise job.refused
        kept = finished(job, out)
        if kept is not None:
            return _told(job, kept, KEPT, started)
        if not job.replace:
            refuse_another(target, lambda: origin_of(job.request))
        with staging(target) as work:
            say_where(work)
            try:
                result = run_request(job.request, work / target.name, progress, blender_decoder())
            finally:
                say_where(None)
            move_bundle(result.path, target)
        return _told(job, read_bundle(target), BAKED, started)
    except BakeError as error:
        return failure(job, error, started, _is_of_machine(job, error, work))
    except MemoryError:
        error = BakeError(job.request.title, "ran out of memory", "choose a lower resolution or fewer --jobs")
        return failure(job, error, started)
    except OSError as error:
        cause = error.strerror or str(error)
        told = BakeError(error.filename or job.request.title, cause, "check the path, its permissions and free space")
        return failure(job, told, started)
    except Exception as error:
        # A defect, of ours or of a library: this material's alone.
        cause = f"was not baked: {type(error).__name__}: {one_line(str(error))}"
        told = BakeError(job.request.title, cause, "report it, with this source: the rest is baked")
        return failure(job, told, started)


def finished(job: LibraryJob, out: Path) -> Bundle | None:
    """The bundle of this job, where it is there, whole, and of this source's content, these settings, this version."""
    try:
        bundle = read_bundle(job.target(out))
        if bundle.material.get(RECIPE) != recipe_of_request(job.request):
            return None
        bundle.check()
        read_record(bundle)
    except (BakeError, OSError, ValueError):
        return None
    return bundle


def recipe_of_request(request: BakeRequest) -> str:
    """The recipe that a bundle of this request will have. Raises BakeError or OSError where the source is not read."""
    origin = origin_of(request)
    if isinstance(request.settings, ArcSettings):
        return arc_recipe(request.photographs(), request.settings, origin)
    assert isinstance(request.settings, BakeSettings)
    return recipe_of(request.settings, origin)


def origin_of(request: BakeRequest) -> Origin:
    """Where a bundle of this request comes from, by content. Raises BakeError or OSError."""
    source = request.source
    if isinstance(source, Model):
        model = by_name(source.name, **source.parameters)
        return model_origin(model.name, model.facts)
    if isinstance(request.settings, ArcSettings):
        photographs = request.photographs()
        folder = photographs if isinstance(photographs, Path) else photographs[0].parent
        return {"name": folder.resolve().name, **photographs_origin(photographs)}
    assert isinstance(source, Path) and isinstance(request.settings, BakeSettings)
    return file_origin(source, chosen_material(source, request.settings.reading))


def failure(job: LibraryJob, error: BakeError, started: float | None = None, of_machine: bool = True) -> Outcome:
    """A job that failed by this error; `started` by the clock of `time.perf_counter`, in this process."""
    told = {"file": error.file, "cause": error.cause, "remedy": error.remedy, "of_machine": of_machine}
    failed = Outcome(job.name, FAILED, job.request.title, **told)
    return failed if started is None else replace(failed, **_process(started))


def _is_of_machine(job: LibraryJob, error: BakeError, work: Path | None) -> bool:
    """Whether the source may not be read here, or an error is of what is written to `work`, or goes back to something
    that the system or this Python refuses."""
    # Libraries of images tell of a full disk, and of a file that they may not open, in words alone.
    if work is not None and work in Path(error.file).parents:
        return True
    source = job.request.source
    files = () if isinstance(source, Model) else source if isinstance(source, tuple) else (source,)
    if not all(map(_may_be_read, files)):
        return True
    behind: BaseException | None = error
    while behind is not None:
        # Libraries raise OSError without a number for what a file holds.
        if isinstance(behind, MemoryError | ImportError) or (isinstance(behind, OSError) and behind.errno is not None):
            return True
        behind = behind.__cause__ if behind.__suppress_context__ else behind.__cause__ or behind.__context__
    return False


def _may_be_read(path: Path) -> bool:
    try:
        files = [path, *path.iterdir()] if path.is_dir() else [path]
    except OSError:
        return False
    return all(os.access(file, os.R_OK) for file in files)


def _told(job: LibraryJob, bundle: Bundle, state: State, started: float) -> Outcome:
    record = read_record(bundle)
    return Outcome(
        job.name,
        state,
        job.request.title,
        record.source.format or "",
        sum(file.stat().st_size for file in bundle.path.iterdir()),
        record.errors.held_out_relative if isinstance(record, ShadingMapRecord) else record.errors.relative,
        **_process(started),
    )


def _process(started: float) -> dict[str, Any]:
    """What the process that ran a job tells of itself."""
    return {
        "seconds": round(time.perf_counter() - started, 3),
        "peak_bytes": peak_bytes(),
        "memory_bytes": resident_bytes(),
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "ended": round(time.time(), 3),
    }
