"""A library's jobs as a list that `bake library` reads again, and the folder in which all of them lie."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

from ...bake.atomic_write import replacing_file
from ...bake.errors import BakeError
from ..library.inputs import LIST_SUFFIX
from ..library.plan import Plan

NAME = f"measured_library{LIST_SUFFIX}"


def write_list(plan: Plan) -> Path:
    """Write a line for each job into the library's folder, which must exist. Raises BakeError."""
    return write_lines(plan.out / NAME, [shlex.join(job.arguments) for job in plan.jobs])


def write_lines(file: Path, lines: list[str]) -> Path:
    """Write a text file as a whole. Raises BakeError, also where a line would become two."""
    for line in lines:
        if len(line.splitlines()) > 1 or "\0" in line:
            raise BakeError(line[:80], "holds a line break, which a list of commands cannot", "rename the file")
    return write_text(file, "".join(f"{line}\n" for line in lines))


def write_text(file: Path, text: str) -> Path:
    """Write a text file as a whole. Raises BakeError."""
    try:
        with replacing_file(file) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
    except (OSError, ValueError) as error:
        cause = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise BakeError(file, cause, "check its folder and the free space") from error
    return file


def common_root(plan: Plan) -> str:
    """The deepest folder that the library and all that its jobs name by an absolute path lie in; "" where that is none.

    A file system's own root is none: it says nothing of where a farm has its files.
    """
    words = [word.rpartition("=")[2] for job in plan.jobs for word in job.arguments]
    named = [word for word in words if os.path.isabs(word)]
    try:
        root = os.path.commonpath([str(plan.out), *named])
    except ValueError:  # of several drives
        return ""
    return "" if root == os.path.dirname(root) else root
