"""What a sub-command returns, and how errors are reported."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ....bake.errors import BakeError
from ...summary.text import one_line


@dataclass
class Result:
    """Outcome of a sub-command.

    Parameters
    ----------
    document : JSON-ready, for --json; "errors" is added to it
    lines : the same for people
    errors : what went wrong on the way; any makes the exit code 1
    """

    document: Mapping[str, Any]
    lines: Sequence[str]
    errors: Sequence[BakeError] = field(default_factory=list)


def complain(message: str) -> None:
    """One line on the error stream, whatever the message holds."""
    with contextlib.suppress(OSError, ValueError):
        line = f"measured_materials: {one_line(message)}\n"
        encoding = sys.stderr.encoding or "utf-8"
        sys.stderr.write(line.encode(encoding, "backslashreplace").decode(encoding))
        sys.stderr.flush()
