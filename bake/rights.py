"""Who measured what is baked, what others may do with it, and where it was found: as an artist states it."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import asdict, dataclass, fields

from .errors import check_setting

# Letters of one statement; a licence's whole text belongs into a file of its own.
MOST_LETTERS = 1000
# What pages put between words: non-breaking, thin and wide blanks.
_SPACES = re.compile("[\u00a0\u1680\u2000-\u200a\u202f\u205f\u3000]")
# Control characters, halves of a letter, which no file can hold, and ends of lines.
_REFUSED = {"Cc", "Cs", "Zl", "Zp"}


@dataclass(frozen=True)
class Rights:
    """What no file of measurements says, kept in the bundle as it was given; empty where nobody said.

    Parameters
    ----------
    author : who measured it or took the photographs
    license : what others may do with it, for instance "CC0"
    source_url : where it was found, an address or a citation
    """

    author: str = ""
    license: str = ""
    source_url: str = ""

    def __post_init__(self) -> None:
        for field in fields(self):
            words = _SPACES.sub(" ", getattr(self, field.name)).strip()
            object.__setattr__(self, field.name, words)
            shown = words[:20] + ("" if len(words) < 20 else "...")
            size = f"one line of at most {MOST_LETTERS} letters"
            check_setting(field.name, len(words) <= MOST_LETTERS, size, f"{len(words)} letters, {shown!r}")
            control = next((c for c in words if unicodedata.category(c) in _REFUSED), None)
            text = f"{size} without control characters"
            check_setting(field.name, control is None, text, f"{shown!r} with {control!r}")

    def facts(self) -> dict[str, str]:
        """What was stated, JSON-ready."""
        return {name: words for name, words in asdict(self).items() if words}

    def entry(self) -> dict[str, dict[str, str]]:
        """The entry "rights" of a bundle's material.json; none where nothing was stated."""
        return {"rights": facts} if (facts := self.facts()) else {}


RIGHTS = tuple(field.name for field in fields(Rights))
