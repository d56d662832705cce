"""Text for one line of a terminal, a report or a panel, whatever files are called."""

from __future__ import annotations

from collections.abc import Sequence

from ...bake.errors import CONTROL


def one_line(text: str) -> str:
    """The text without line breaks and other control characters, which a file's name may hold."""
    return CONTROL.sub(" ", text).strip()


def capital(text: str) -> str:
    """The text with a capital at its beginning and all else as it is: names of datablocks stay."""
    return text[:1].upper() + text[1:]


def columns(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Label and value pairs as aligned lines; an empty label continues the one above."""
    width = max((len(label) for label, _ in rows), default=0)
    return [f"{label:<{width}}  {one_line(value)}" for label, value in rows]
