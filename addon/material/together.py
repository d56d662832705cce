"""Many materials built in a row, at the cost of what differs between them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ...nodes.group import hashing_once
from ..lights.kept_surveys import surveys_kept


@contextmanager
def built_together() -> Iterator[None]:
    """Inside, a scene is surveyed where it has changed, and each node group looked at once for an artist's edits.

    For operators and scripts that build or rebuild materials there, and change no node group otherwise.
    """
    with surveys_kept(), hashing_once():
        yield
