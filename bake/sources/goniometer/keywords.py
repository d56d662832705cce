"""Files of keywords and lists of numbers: Zemax' and LightTools' `.bsdf`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...source import Array
from ...spectrum import xyz_to_rec709
from ..lookup.lookup_source import grey
from ..lookup.text_file import TextFile

MAX_NODES = 2000
MAX_ENTRIES = 1 << 25


@dataclass
class Words:
    """The words of a file one after the other, each with its line."""

    file: TextFile
    words: list[tuple[int, str]]
    position: int = 0

    @classmethod
    def of(cls, file: TextFile) -> Words:
        """All words outside comments."""
        return cls(file, [(number, word) for number, words, _ in file.split() for word in words])

    @property
    def line(self) -> int:
        """Line of the next word, or of the last."""
        return self.words[min(self.position, len(self.words) - 1)][0] if self.words else 1

    def peek(self) -> str:
        """The next word in lower case, empty at the end."""
        return self.words[self.position][1].lower() if self.position < len(self.words) else ""

    def take(self, what: str) -> str:
        """The next word."""
        if self.position == len(self.words):
            raise self.file.error(f"ends where {what} is expected")
        self.position += 1
        return self.words[self.position - 1][1]

    def accept(self, keyword: str) -> bool:
        """Take a keyword if it is the next."""
        if self.peek() != keyword.lower():
            return False
        self.position += 1
        return True

    def expect(self, keyword: str) -> None:
        """Take a keyword."""
        if not self.accept(keyword):
            self.file.refuse(self.line, f"{keyword} is expected, not {self.peek()[:20]!r}")

    def choice(self, what: str, choices: dict[str, str]) -> str:
        """A word out of several, without case, as what it stands for."""
        line, word = self.line, self.take(what)
        if word.lower() not in choices:
            self.file.refuse(line, f"{what} is {word[:20]!r}, not {' or '.join(choices)}")
        return choices[word.lower()]

    def numbers(self, count: int, what: str) -> Array:
        """So many numbers."""
        left = self.words[self.position : self.position + count]
        if len(left) < count:
            raise self.file.error(f"ends after {len(left)} of {count} {what}")
        self.position += count
        try:
            values = np.array([word for _, word in left], dtype=np.float64)
        except ValueError:
            for line, word in left:
                self.file.numbers(line, [word])
            raise
        if not np.isfinite(values).all():
            self.file.refuse(left[int(np.argmin(np.isfinite(values)))][0], "a number is not finite")
        return values

    def angles(self, what: str, low: float, high: float) -> Array:
        """A count and so many ascending angles, degrees in the file and radians as a result."""
        line = self.line
        count = self.file.count(line, [self.take(what)], MAX_NODES, what)
        degrees = self.numbers(count, what)
        if (np.diff(degrees) <= 0).any() or degrees[0] < low or degrees[-1] > high:
            self.file.refuse(line, f"{what} do not ascend within {low:g} to {high:g} degrees")
        return np.radians(degrees)


def to_rgb(channels: Array) -> Array:
    """(..., 1) or (..., 3) CIE XYZ values as linear Rec.709, the white of D65 as (1, 1, 1)."""
    return grey(channels[..., 0]) if channels.shape[-1] == 1 else channels @ xyz_to_rec709().T


def head_of(file: TextFile, most: int = 400) -> Iterator[str]:
    """Words of the first lines in lower case, to recognise a format by."""
    for _, words, _ in list(file.split())[:most]:
        yield from (word.lower() for word in words)
