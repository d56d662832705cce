"""Work done in portions, between which Blender draws and listens: what was made stays, and the work begins anew.

Making a material's groups takes from a third of a second to a whole one, most of it in Blender's own calls, which only
its main thread may make. Whoever has an interface to keep awake calls the same builder again and again: it finds what
it has made before, makes more for some hundredths of a second, and is then ended by `Pause`, until a call comes to
its end.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy

# Seconds that a portion lasts: it ends at the first place after these, but not before it has worked for a while, for
# what it does to find what it has made before brings it no further.
_LASTS, _WORKS = 0.05, 0.015
# What other programs take of a busy machine's time does not count in, where that can be told finely.
_clock = time.perf_counter if sys.platform == "win32" else time.thread_time

Block = tuple[str, int]


class Pause(BaseException):
    """The portion is over. No error, so that nothing takes back what was made."""


class Portions:
    """One piece of work.

    Attributes
    ----------
    partial : of groups that are being made, by their recipe: session_uid, and nodes that it has so far
    hashes : of trees that were met, by their session_uid
    """

    def __init__(self) -> None:
        self.partial: dict[str, tuple[int, int]] = {}
        self.hashes: dict[int, str] = {}
        self._known: dict[str, Any] = {}
        self._made: set[Block] = set()
        self._began = 0.0
        self._working: float | None = None
        self._to_the_end = False

    @contextmanager
    def portion(self) -> Iterator[None]:
        """Inside, the builder is called; it may raise `Pause`."""
        global _active
        before, self._began, self._working, self._to_the_end = datablocks(), _clock(), None, False
        outer, _active = _active, self
        try:
            yield
        finally:
            _active = outer
            self._made |= datablocks() - before

    def once(self, key: str, find: Callable[[], Any]) -> Any:
        """As the function of this name."""
        if key not in self._known:
            self.rest()
            self._known[key] = find()
        return self._known[key]

    def forget(self) -> None:
        """Undo may have taken any datablock, or made it what it was."""
        self.partial.clear()
        self.hashes.clear()

    def drop(self) -> None:
        """Remove what was made, as far as nothing uses it: users before what they use, in whatever order."""
        self.forget()
        remove_unused_blocks(self._made)
        self._made.clear()

    def made(self) -> set[Block]:
        """Images and node groups that came up during the portions."""
        return set(self._made)

    def rest(self) -> None:
        """As the function of this name."""
        now = _clock()
        if self._working is None:
            self._working = now
        elif not self._to_the_end and now > max(self._began + _LASTS, self._working + _WORKS):
            raise Pause

    def no_return(self) -> None:
        """As the function of this name."""
        self._to_the_end = True


_active: Portions | None = None


def active() -> Portions | None:
    """The work that is being done in portions, if any is."""
    return _active


def rest() -> None:
    """Call before work that lasts, where it can be begun anew. Raises Pause where the portion is over."""
    if _active is not None:
        _active.rest()


def once(key: str, find: Callable[[], Any]) -> Any:
    """What `find` gives, which is no datablock: of one work looked for in one portion alone. Raises Pause."""
    return find() if _active is None else _active.once(key, find)


def no_return() -> None:
    """Call where work can no longer be begun anew; the portion then lasts to its end."""
    if _active is not None:
        _active.no_return()


def datablocks() -> set[Block]:
    """Kind and session_uid of all that a material may bring with it."""
    return {(kind, one.session_uid) for kind in ("images", "node_groups") for one in getattr(bpy.data, kind)}


def found(kind: str, uid: int) -> Any:
    """The datablock of this number in this collection of `bpy.data`, or None."""
    return next((one for one in getattr(bpy.data, kind) if one.session_uid == uid), None)


def remove_unused_blocks(blocks: set[Block]) -> None:
    """Remove those of these that nothing uses, and then what only they used."""
    for _ in range(len(blocks)):
        unused = [one for kind, uid in blocks if (one := found(kind, uid)) is not None and not one.users]
        if not unused:
            break
        bpy.data.batch_remove(unused)
