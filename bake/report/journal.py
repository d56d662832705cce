"""What a report has measured so far, kept on disk: a stopped run is taken up where it ended."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..atomic_write import replacing_file
from ..errors import BakeError


class Journal:
    """Measurements by key, each written as soon as it is made.

    Parameters
    ----------
    path : a file of one JSON object per line; its first line holds `about`
    about : what the measurements depend on (version, inputs, machine); those of another run are not taken up

    Raises
    ------
    BakeError : the file cannot be written
    """

    def __init__(self, path: Path, about: dict[str, Any]) -> None:
        self.path, self.found = path, {}
        head = json.dumps(about, sort_keys=True)
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        if lines and lines[0] == head:
            self.found = dict(_entries(lines[1:]))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Without what was cut short: the next line would be appended to it.
            whole = [head, *(json.dumps([key, value]) for key, value in self.found.items())]
            with replacing_file(path) as temporary:
                temporary.write_text("\n".join(whole) + "\n", encoding="utf-8")
        except OSError as error:
            raise BakeError(path, error.strerror or str(error), "choose another folder by --out") from error

    found: dict[str, Any]

    def measure(self, key: str, function: Callable[[], Any]) -> Any:
        """The JSON-ready result of `function`, from the file where it was measured before."""
        if key not in self.found:
            value = function()
            with self.path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([key, value]) + "\n")
            self.found[key] = value
        return self.found[key]


def _entries(lines: list[str]) -> list[tuple[str, Any]]:
    """Whole entries; the last line may have been cut short."""
    entries = []
    for line in lines:
        try:
            key, value = json.loads(line)
        except (ValueError, TypeError):
            continue
        if isinstance(key, str):
            entries.append((key, value))
    return entries
