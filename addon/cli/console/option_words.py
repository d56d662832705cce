"""Options as the words that would give them again, for a command line that somebody else runs."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path
from typing import Any


def words_of(parser: argparse.ArgumentParser, options: argparse.Namespace, without: Collection[str] = ()) -> list[str]:
    """Words of all options that are not as usual, but for positional arguments and those named in `without`.

    Files are named by their absolute paths: the words may be read in another folder.
    """
    words: list[str] = []
    for action in parser._actions:
        value = getattr(options, action.dest, None)
        if not action.option_strings or action.dest in without or value == action.default:
            continue
        option = next(name for name in action.option_strings if name.startswith("--"))
        if isinstance(action, argparse.BooleanOptionalAction):
            words.append(option if value else f"--no-{option[2:]}")
        elif action.nargs == 0:
            words.append(option)
        elif action.nargs is None:
            # As one word: a value may begin with a hyphen, as a negative number does.
            words.append(f"{option}={_word(value)}")
        else:
            words += [option, *map(_word, value)]
    return words


def _word(value: Any) -> str:
    if isinstance(value, Path):
        return str(value.absolute())
    return ",".join(map(_word, value)) if isinstance(value, tuple | list) else str(value)
