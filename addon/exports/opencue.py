"""A library's jobs for OpenCue: commands for `cuecmd`, which reads one on each line."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from ..library.plan import Plan
from .library_list import write_lines, write_list

COMMANDS = "measured_library.cuecmd"
# Before the words of a command where Blender runs it.
BLENDER = ("blender", "--background", "--command", "measured_materials")


def write_opencue(plan: Plan, program: Sequence[str] = BLENDER) -> list[Path]:
    """Write the commands and the list of all into the library's folder, which must exist, and return the files.

    Each line is for a POSIX shell, as `cuecmd` hands it to one. Raises BakeError.
    """
    lines = [shlex.join([*program, *plan.command(job)]) for job in plan.jobs]
    return [write_lines(plan.out / COMMANDS, lines), write_list(plan)]
