"""Jobs on the workers of a Dask cluster that is there already; results come back by the folder that all share."""

from __future__ import annotations

import contextlib
import importlib
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...bake import VERSION
from ...bake.errors import BakeError
from .outcome import Outcome
from .plan import LibraryJob
from .run import failure, run_task

_PATIENCE = 20.0  # seconds in which a scheduler answers, and has a worker
_ATTEMPTS = 2
_PACKAGE = "measured_materials"
_INSTALL = "install the package on every worker: pip install FOLDER, of the same clone or release as here"


def bake_by_dask(jobs: Sequence[LibraryJob], out: Path, address: str) -> Iterator[Outcome]:
    """Bake jobs into `out`, and give what became of each as soon as it is known.

    The scheduler gives the jobs of a worker that is lost to the others; what that worker had finished is kept. A job
    that the scheduler gives up, as workers were lost with it time and again, is submitted once more.

    Raises
    ------
    BakeError : dask.distributed is missing, nobody answers at `address`, there are no workers, or one of them cannot
        import this package, has another version of it or does not see the library's folder
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        remedy = "start a scheduler (dask scheduler) and give its address, such as tcp://host:8786"
        raise BakeError(address, "does not answer as a Dask scheduler", remedy) from error
    with contextlib.closing(client):
        _check_workers(client, distributed, out, address)
        yield from _completed(client, distributed, jobs, out, address)


def _completed(client: Any, distributed: Any, jobs: Sequence[LibraryJob], out: Path, address: str) -> Iterator[Outcome]:
    run = uuid.uuid4().hex[:12]  # no result of an earlier run is taken for one of this

    def submitted(k: int, attempt: int) -> Any:
        key = f"bake-{run}-{k}-{attempt}"
        future = client.submit(dask_task, jobs[k], str(out), VERSION, key=key, pure=False)
        asked[key] = k, attempt, future
        return future

    asked: dict[str, tuple[int, int, Any]] = {}
    ended = distributed.as_completed([submitted(k, 1) for k in range(len(jobs))], loop=client.loop)
    try:
        for future in ended:
            k, attempt, _ = asked.pop(future.key)
            error = _error_of(future)
            if error is None:
                yield replace(future.result(), attempts=attempt)
            elif isinstance(error, distributed.scheduler.KilledWorker) and attempt < _ATTEMPTS:
                ended.add(submitted(k, attempt + 1))
            elif future.status == "cancelled" or future.status == "lost":
                remedy = "start it and its workers, and give the same command again: what is finished is kept"
                raise BakeError(address, "has lost the jobs: the Dask scheduler has ended", remedy)
            else:
                yield replace(failure(jobs[k], _told(jobs[k], error, distributed)), attempts=attempt)
    finally:
        # Jobs that run end by themselves and are there the next time; no other begins.
        with contextlib.suppress(Exception):
            client.cancel([future for _, _, future in asked.values()], force=True)


def dask_task(job: LibraryJob, out: str, version: str) -> Outcome:
    """One job, on a worker of a cluster; a worker that came later may have another version of the package."""
    if version != VERSION:
        cause = f"was not baked: a Dask worker has version {VERSION} of {_PACKAGE}, here it is {version}"
        return failure(job, BakeError(job.request.title, cause, _INSTALL))
    return run_task(job, Path(out))


def _distributed() -> Any:
    if __name__.partition(".")[0] != _PACKAGE:
        remedy = f"run `python -m {_PACKAGE} bake library ... --dask ADDRESS` with a Python that has it installed"
        raise BakeError("--dask", "does not work inside Blender, whose package no worker knows by its name", remedy)
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        remedy = "install it (pip install distributed), or leave --dask out"
        raise BakeError("--dask", "needs dask.distributed, which this Python does not have", remedy) from error


def _check_workers(client: Any, distributed: Any, out: Path, address: str) -> None:
    """Raise BakeError where a worker cannot do what is asked of it."""
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except (TimeoutError, OSError) as error:
        raise BakeError(address, "has no worker", f"start one: dask worker {address} --nthreads 1") from error
    with _marked(out) as (file, mark):
        answers = client.run(_probe(), _PACKAGE, str(file), mark, on_error="return")
    for worker, answer in sorted(answers.items()):
        if isinstance(answer, BaseException) or not isinstance(answer, str):
            raise BakeError(worker, f"does not answer ({str(answer)[:200]})", "restart this worker")
        kind, _, words = answer.partition(" ")
        if kind == "import":
            raise BakeError(worker, f"cannot import {_PACKAGE} ({words})", _INSTALL)
        if kind == "folder":
            raise BakeError(
                worker, f"does not see the folder {out}", "choose a folder that all workers share by one path"
            )
        if words != VERSION:
            raise BakeError(worker, f"has version {words} of {_PACKAGE}, here it is {VERSION}", _INSTALL)


@contextlib.contextmanager
def _marked(out: Path) -> Iterator[tuple[Path, str]]:
    """A file in the library, closed as NFS shows it to others then, and what it says; gone after the block.

    Should this process die, `sweep` removes it. Raises BakeError.
    """
    mark = uuid.uuid4().hex
    file = out / f".{mark[:12]}.partial.json"
    try:
        try:
            file.write_text(mark, encoding="utf-8")
        except OSError as error:
            cause = f"cannot be written ({error.strerror or error})"
            raise BakeError(file, cause, "check the folder, its permissions and the free space") from error
        yield file, mark
    finally:
        with contextlib.suppress(OSError):
            file.unlink()


def _probe() -> Callable[..., str]:
    """What a worker is asked, as a function that travels by its code: the package may not be there."""

    def probe(package: str, file: str, mark: str) -> str:
        import importlib

        try:
            version: str = importlib.import_module(f"{package}.bake").VERSION
        except Exception as error:
            return f"import {type(error).__name__}: {error}"
        try:
            with open(file, encoding="utf-8", errors="replace") as stream:
                seen = stream.read()
        except OSError:
            return "folder"
        return f"version {version}" if seen == mark else "folder"

    return probe


def _error_of(future: Any) -> BaseException | None:
    try:
        error: BaseException | None = future.exception()
    except BaseException as raised:
        if isinstance(raised, KeyboardInterrupt | SystemExit | GeneratorExit):
            raise
        return raised
    return error


def _told(job: LibraryJob, error: BaseException, distributed: Any) -> BakeError:
    if isinstance(error, distributed.scheduler.KilledWorker):
        cause = "was not baked: the workers that baked it were lost, time and again"
        return BakeError(job.request.title, cause, "check the workers' memory, and start again: the rest is kept")
    cause = f"was not baked: {type(error).__name__}: {str(error)[:300]}"
    return BakeError(job.request.title, cause, "look into the worker's own messages")
