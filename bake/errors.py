"""The one error that bad input raises."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


class BakeError(Exception):
    """Input that cannot be used, reported in one line: which file, what is wrong with it, what to do.

    Parameters
    ----------
    file : path or name of the offending input
    cause : what is wrong, in a few words, without a full stop
    remedy : what the user can do about it, without a full stop
    """

    def __init__(self, file: str | Path, cause: str, remedy: str) -> None:
        self.file, self.cause, self.remedy = str(file), cause, remedy
        super().__init__(f"{self.file}: {cause}; {remedy}")


def check_setting(name: str, ok: bool, wanted: str, given: object) -> None:
    """Raise BakeError where what was given for a setting is not what is wanted, in words."""
    if not ok:
        raise BakeError(name, f"cannot be {given}", f"choose {wanted}")


def check_choice(name: str, given: object, choices: Sequence[str]) -> None:
    """Raise BakeError where what was given for a setting is none of its choices."""
    check_setting(name, given in choices, " or ".join(choices), given)
