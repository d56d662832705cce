"""The queue of bakes: one after the other beside the window, followed by a timer that never waits.

A material that is shown while it is baked is a step of undo, and its end is another; `_skip` goes over the former where
nothing lies between, so that an artist meets one.
"""

from __future__ import annotations

import atexit
import contextlib
import shutil
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ....bake.bundle.result import BakeResult
from ....bake.errors import BakeError
from ....nodes.portions import Pause, Portions
from ... import events
from ...baking.job import DONE, FAILED, NO_HOST
from ...summary.progress_estimate import ProgressEstimate
from ...summary.text import one_line
from . import warm_worker
from .tasks import FRESH, STATE_KEY, BakeTask, Job, Task
from .window import is_dragging, push, tell, window

_PAUSE = 0.05
# Between portions of a material that is being made.
_BREATH = 0.01
_TOLD_EVERY = 0.2
# Seconds that a drag of the artist is waited for.
_PATIENCE = 30.0


class Queue:
    """Bakes to come, the one that runs, and what is to be said at the end.

    `listening` says whether Esc is heard somewhere, by the operator of `watch_bakes`; `told`,
    whether the status bar shows our words.
    """

    def __init__(self) -> None:
        self.waiting: list[Task] = []
        self.listening = self.told = False
        self.task: Task | None = None
        self.job: Job | None = None
        self._estimate: ProgressEstimate | None = None
        self._problems: list[str] = []
        self._shown, self._total, self._number = False, 0, 0
        self._told_at, self._held_since = 0.0, 0.0
        self._result: BakeResult | None = None
        self._work = Portions()
        self._is_making = False

    def is_busy(self) -> bool:
        """Whether anything is left to do."""
        return self.task is not None or bool(self.waiting)

    def pause(self) -> float:
        """Seconds until the next step."""
        return _BREATH if self._is_making else _PAUSE

    def undone(self) -> None:
        """Undo or redo has exchanged the datablocks."""
        self._work.forget()

    def add(self, tasks: Sequence[Task]) -> None:
        """Bake these after all others."""
        if not self.is_busy():
            self._total = self._number = 0
        self._total += len(tasks)
        self.waiting += tasks
        if not bpy.app.timers.is_registered(tick):
            bpy.app.timers.register(tick, first_interval=0.0)

    def stop(self) -> None:
        """End all bakes at once and touch no datablock: the file goes, or Blender does."""
        self.waiting.clear()
        self._end_job()
        self._work, self._is_making = Portions(), False
        self._problems.clear()
        self.listening = False
        _status(None)

    def cancel(self) -> None:
        """End the bake that runs, and take back what it has shown.

        A material whose new bundle lies in place of its old one already is made from it all the same.
        """
        task = self.task
        if task is None or (self._result is not None and task.replaces):
            return
        self._end_job()
        self._drop_work()
        if task.drop():
            push(f"Cancel {task.label}")
        tell(f"{task.title}: the bake was cancelled, and nothing of it was kept")

    def _end_job(self) -> None:
        """The bake and its files, no datablock."""
        if self.job is not None:
            self.job.cancel()
            self.job.close()
        self._take_back()
        self.task = self.job = None

    def _drop_work(self) -> None:
        """What was made on the way and is not needed after all."""
        self._work.drop()
        self._work, self._is_making = Portions(), False

    def _take_back(self) -> None:
        """Remove a bundle that was put in its place for a material that is not made after all."""
        result, self._result = self._result, None
        if result is not None and self.task is not None and self.task.is_new:
            shutil.rmtree(result.path, ignore_errors=True)

    def step(self) -> None:
        """Follow the bake that runs, and start the next."""
        if self.task is None and self.waiting:
            self._begin(self.waiting.pop(0))
        if self.task is None or self.job is None:
            return
        if not self.task.is_wanted():
            title = self.task.title
            self._end_job()
            self._drop_work()
            tell(f"{title}: the material is gone, and its bake was cancelled")
            return
        state = self.job.poll()
        if state == NO_HOST:
            self._bake_here()
        elif state == FAILED:
            self._fail(self.job.error)
        elif state == DONE or (self.job.preview is not None and not self._shown):
            if self._may_write():
                self._finish() if state == DONE else self._show()
        self._tell_progress()

    def _begin(self, task: Task) -> None:
        self._number += 1
        self._shown, self.task, self._result = False, task, None
        self._estimate = ProgressEstimate(task.stages())
        try:
            self.job = task.new_job()
        except BakeError as error:
            self._fail(error)
            return
        self.job.start()

    def _show(self) -> None:
        """The quick bake, as a step of undo."""
        assert self.task and self.job and self.job.preview
        task, preview = self.task, self.job.preview
        try:
            self._make(lambda: task.show(preview))
        except Pause:
            return
        except BakeError as error:  # the whole bake may be better
            print(f"measured_materials: {error}", file=sys.stderr)
            self._shown = True
            self._drop_work()
            return
        self._shown = True
        push(task.label)
        task.shown(self._work.made())
        self._work = Portions()
        if self.waiting and isinstance(follower := self.waiting[0], BakeTask):
            warm_worker.prepare(follower.request.settings)

    def _finish(self) -> None:
        """Put the bundle in its place and make the material."""
        assert self.task and self.job
        task = self.task
        try:
            result = self._result = self._result or self.job.finish()
            words = self._make(lambda: task.finish(result))
        except Pause:
            return
        except BakeError as error:
            self._fail(error)
            return
        self.task = self.job = self._result = None
        self._drop_work()
        push(task.label)
        tell(words)

    def _make(self, work: Callable[[], Any]) -> Any:
        """A portion of this work; its result, if it comes to an end. Raises Pause and BakeError."""
        self._is_making = True
        with self._work.portion():
            done = work()
        self._is_making = False
        return done

    def _bake_here(self) -> None:
        """Where no process can be started: Blender waits meanwhile."""
        assert self.task and self.job
        task, job, manager = self.task, self.job, bpy.context.window_manager
        self.task = self.job = None
        manager.progress_begin(0, 1)
        try:
            words = task.finish(task.bake_here(job))
        except BakeError as error:
            self._problems.append(one_line(str(error)))
        else:
            push(task.label)
            tell(words)
        finally:
            manager.progress_end()

    def _fail(self, error: BakeError | None) -> None:
        self._drop_work()
        if self.task is not None and self.task.drop():
            push(f"Cancel {self.task.label}")
        self.task = self.job = None
        self._problems.append(one_line(str(error)))

    def tell_problems(self) -> None:
        """All that went wrong, as one list."""
        problems, self._problems = self._problems, []
        if not problems:
            return
        for line in problems:
            tell(line, "WARNING")
        if bpy.app.background:  # where Blender crashes on a popup
            return

        def draw(popup: Any, _context: bpy.types.Context) -> None:
            for line in problems:
                for part in line.split("; "):
                    popup.layout.label(text=part)

        with window():
            bpy.context.window_manager.popup_menu(draw, title="Could not be baked", icon="ERROR")

    def _may_write(self) -> bool:
        """Whether datablocks may be made now: not during a render, and while an artist drags something, later."""
        if any(map(bpy.app.is_job_running, ("RENDER", "RENDER_PREVIEW"))):
            return False
        now = time.monotonic()
        if is_dragging():
            self._held_since = self._held_since or now
            return now - self._held_since > _PATIENCE
        self._held_since = 0.0
        return True

    def _tell_progress(self) -> None:
        now = time.monotonic()
        if self.task is None or self.job is None or self._estimate is None or now - self._told_at < _TOLD_EVERY:
            return
        self._told_at = now
        self._estimate(self.job.stage, self.job.share)
        place = f" ({self._number} of {self._total})" if self._total > 1 else ""
        _status(f"{self.task.doing} {one_line(self.task.title)}{place}: {self._estimate.words()}   |   Esc: Cancel")


queue = Queue()


@events.timer
def tick() -> float | None:
    """The timer's function: one step, and whether there are more."""
    try:
        with window():
            queue.step()
    except Exception:  # a defect, which must not leave a process behind
        traceback.print_exc()
        queue.stop()
    if queue.is_busy():
        _watch()
        return queue.pause()
    _status(None)
    queue.tell_problems()
    return None


def _watch() -> None:
    """Have Esc heard in a window, also after the one that heard it was closed."""
    windows = bpy.context.window_manager.windows
    if not windows or queue.listening:
        return
    with window():
        bpy.ops.measured_materials.watch_bakes("INVOKE_DEFAULT")


def _status(words: str | None) -> None:
    """Show this in the status bar of every workspace, or Blender's own words again."""
    # Without a window, or before one was drawn, Blender crashes on this.
    if (words is None and not queue.told) or not bpy.context.window_manager.windows:
        return
    queue.told = words is not None
    with window():
        for workspace in bpy.data.workspaces:
            workspace.status_text_set(words)


def _skip(direction: str) -> None:
    """Go on in the history where it stands at a quick bake that nobody waits for any more."""

    @events.timer
    def go() -> None:
        if queue.is_busy() or not any(material.get(STATE_KEY) == FRESH for material in bpy.data.materials):
            return
        with window():
            operator = getattr(bpy.ops.ed, direction)
            if operator.poll():
                operator()

    bpy.app.timers.register(go, first_interval=0.0)


@persistent
def _after_undo(*_: Any) -> None:
    queue.undone()
    _skip("undo")


@persistent
def _after_redo(*_: Any) -> None:
    queue.undone()
    _skip("redo")


@persistent
def _before_load(*_: Any) -> None:
    queue.stop()


_HANDLERS = {"load_pre": _before_load, "undo_post": _after_undo, "redo_post": _after_redo}


def register() -> None:
    """Called by `addon.register`."""
    events.listen(_HANDLERS)
    atexit.register(_end)


def unregister() -> None:
    """Called by `addon.unregister`; what is being baked ends."""
    atexit.unregister(_end)
    _end()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    events.stop_listening(_HANDLERS)


def _end() -> None:
    # At the end of Python nothing of the window may be left.
    with contextlib.suppress(Exception):
        queue.stop()
