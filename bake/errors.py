"""The one error that bad input raises."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

# Control characters of ASCII and Latin-1, and Unicode's separators of lines and paragraphs.
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+")
_LONGEST = 500


class BakeError(Exception):
    """Input that cannot be used, reported in one line: which file, what is wrong with it, what to do.

    Parameters
    ----------
    file : path or name of the offending input
    cause : what is wrong, in a few words, without a full stop; it may quote the input, of which one line is shown
    remedy : what the user can do about it, without a full stop
    """

    def __init__(self, file: str | Path, cause: str, remedy: str) -> None:
        self.file, self.cause, self.remedy = str(file), _shown(cause), remedy
        super().__init__(f"{self.file}: {self.cause}; {remedy}")

    def __reduce__(self) -> tuple[type[BakeError], tuple[str, str, str]]:
        """It travels between processes."""
        return BakeError, (self.file, self.cause, self.remedy)


def check_setting(name: str, ok: bool, wanted: str, given: object) -> None:
    """Raise BakeError where what was given for a setting is not what is wanted, in words."""
    if not ok:
        raise BakeError(name, f"cannot be {given}", f"choose {wanted}")


def check_choice(name: str, given: object, choices: Sequence[str]) -> None:
    """Raise BakeError where what was given for a setting is none of its choices."""
    check_setting(name, given in choices, " or ".join(choices), given)


def _shown(cause: str) -> str:
    """One line of bounded length, whatever an untrusted file has put into it."""
    line = CONTROL.sub(" ", cause)
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 3]}..."
