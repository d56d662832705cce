"""Text files of numbers that nobody has checked: bounded, decoded, and refused by the line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from ...errors import BakeError
from ...source import Array

MAX_LINE_BYTES = 1 << 18
LARGEST_VALUE = 1e8
"""Above any mirror that a goniometer can resolve (1e-8 sr); a larger BRDF value is damage."""


class NamedFile:
    """A file of samples, and the errors that name it. `remedy`: what to do about one that is damaged."""

    def __init__(self, path: str | Path, remedy: str) -> None:
        self.path, self.remedy = Path(path), remedy

    def error(self, cause: str, remedy: str = "") -> BakeError:
        """An error of the file as a whole."""
        return BakeError(self.path, cause, remedy or self.remedy)

    def check_values(self, values: Array, what: str = "a BRDF value") -> None:
        """Refuse numbers that no measurement can be."""
        if values.size and np.abs(values).max() > LARGEST_VALUE:
            raise self.error(f"{what} exceeds {LARGEST_VALUE:g} 1/sr")


class TextFile(NamedFile):
    """The lines of a text file, and the errors that name them.

    Parameters
    ----------
    path : the file
    remedy : what to do about one that is damaged
    most : bytes that such a file may have
    comment : what begins a comment, to the end of its line

    Raises
    ------
    BakeError : unreadable, empty, too large, not text
    """

    def __init__(self, path: str | Path, remedy: str, most: int = 64 << 20, comment: str = "#") -> None:
        super().__init__(path, remedy)
        self.comment = comment
        self.lines = _lines(self.path, remedy, most)

    def refuse(self, line: int, cause: str, remedy: str = "") -> NoReturn:
        """Raise an error of one line, counted from 1."""
        raise self.error(f"line {line}: {cause}", remedy)

    def split(self, separators: str = "") -> Iterator[tuple[int, list[str], str]]:
        """Number, words and comment of every line; `separators` divide words as blanks do."""
        table = str.maketrans(dict.fromkeys(separators, " "))
        for number, line in enumerate(self.lines, 1):
            content, _, comment = line.partition(self.comment) if self.comment else (line, "", "")
            yield number, content.translate(table).split(), comment

    def numbers(self, line: int, words: Sequence[str]) -> Array:
        """Words as finite numbers."""
        try:
            return finite_numbers(words)
        except ValueError as error:
            self.refuse(line, str(error))

    def count(self, line: int, words: Sequence[str], most: int, what: str) -> int:
        """One word as a whole number from 1 to `most`."""
        value = self.numbers(line, words)
        if value.size != 1 or value[0] != np.floor(value[0]) or not 1 <= value[0] <= most:
            self.refuse(line, f"the number of {what} (1 to {most}) is expected here")
        return int(value[0])


def finite_numbers(words: Sequence[str]) -> Array:
    """Words as numbers. Raises ValueError, which names the word that is none."""
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        first = next(word for word in words if not _is_number(word))
        raise ValueError(f"{first[:20]!r} is not a number") from None
    if not np.isfinite(values).all():
        raise ValueError(f"{words[int(np.argmin(np.isfinite(values)))][:20]!r} is not finite")
    return values


def checked_bytes(path: Path, remedy: str, most: int) -> bytes:
    """A file's content. Raises BakeError: unreadable, empty, larger than `most`."""
    try:
        size = path.stat().st_size
        if size > most:
            raise BakeError(path, f"has {size >> 20} MiB, more than {most >> 20}", remedy)
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise BakeError(path, f"cannot be read ({error})", "check the path and its permissions") from error
    if not data.strip():
        raise BakeError(path, "is empty", remedy)
    return data


def widened(values: Array) -> Array:
    """A file's numbers as float64. Its bytes may be a NaN that signals, which numpy would warn of: it stays NaN."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64, copy=False)


def beginning(path: Path, count: int = 1 << 14) -> bytes:
    """The first bytes of a file that may be a text, to recognise it by; none where it is not one or cannot be read."""
    try:
        with path.open("rb") as stream:
            data = stream.read(count)
    except (OSError, ValueError):
        return b""
    return b"" if b"\0" in data else data


def file_name_of(words: str) -> str:
    """Words out of a file as a file's name without its suffix: no path, no hidden file; "" where nothing is left."""
    return "".join(c if c.isalnum() or c in "-_. " else "_" for c in words).strip(" .")


def printable(text: str, most: int = 200) -> str:
    """A text from a file, fit for a line of an account."""
    return "".join(c if c.isprintable() else " " for c in text).strip()[:most]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _lines(path: Path, remedy: str, most: int) -> list[str]:
    lines = checked_bytes(path, remedy, most).splitlines()
    for number, line in enumerate(lines, 1):
        if len(line) > MAX_LINE_BYTES:
            raise BakeError(path, f"line {number}: is longer than {MAX_LINE_BYTES} bytes", remedy)
        # Names of samples and operators come in any encoding, numbers do not.
        if b"\0" in line:
            raise BakeError(path, f"line {number}: is not text", remedy)
    return [line.decode("utf-8", "replace").lstrip("\ufeff") for line in lines]
