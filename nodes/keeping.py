"""A memory that lasts as long as a context does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


class Keeping(Generic[Key, Value]):
    """What has been found, by what it was found for.

    Attributes
    ----------
    found : None outside of `kept`, where nothing is kept
    """

    def __init__(self) -> None:
        self.found: dict[Key, Value] | None = None

    @contextmanager
    def kept(self, known: dict[Key, Value] | None = None) -> Iterator[None]:
        """Inside, what is found is kept; entered again inside, it stays until the outermost ends.

        Where that begins with what is `known`, it goes there.
        """
        before = self.found
        self.found = before if before is not None else {} if known is None else known
        try:
            yield
        finally:
            self.found = before
