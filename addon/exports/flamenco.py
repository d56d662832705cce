"""A library's jobs for Flamenco: the job type for its manager, and a job to submit."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..library.plan import Plan
from .library_list import NAME, common_root, write_list, write_text

JOB_TYPE = "measured-library"
# As Flamenco makes names of job types: an underscore in the file is a hyphen there.
SCRIPT = "measured_library.js"
JOB = "measured_library.flamenco.json"
_PRIORITY = 50
_ROOT = "{root}"


def write_flamenco(plan: Plan, assets: Path | None = None, program: Sequence[str] = ()) -> list[Path]:
    """Write the job type, the job and its list into the library's folder, which must exist, and return the files.

    Parameters
    ----------
    assets : folder of the asset library that the job makes at its end, if any
    program : words before those of a command, where it is not Flamenco's `{blender}` with the extension

    Raises
    ------
    BakeError : one of them cannot be written
    """
    script = Path(__file__).with_name(SCRIPT).read_text(encoding="utf-8")
    job = json.dumps(job_of(plan, assets, program), indent=2, ensure_ascii=False) + "\n"
    return [write_text(plan.out / SCRIPT, script), write_list(plan), write_text(plan.out / JOB, job)]


def job_of(plan: Plan, assets: Path | None = None, program: Sequence[str] = ()) -> dict[str, Any]:
    """The job as Flamenco's manager takes it, at `/api/v3/jobs`: its schema `SubmittedJob`; JSON-ready."""
    root = common_root(plan)
    materials = [{"name": job.name, "arguments": [_below(word, root) for word in job.arguments]} for job in plan.jobs]
    settings: dict[str, Any] = {
        "library": str(plan.out),
        "materials": json.dumps(materials, ensure_ascii=False),
        "list": str(plan.out / NAME),
        "root": root,
        "assets": "" if assets is None else str(assets),
        "chunk_size": 1,
    }
    if program:
        settings |= {"program": program[0], "program_arguments": shlex.join(program[1:])}
    return {
        "name": f"Measured library {plan.out.name}",
        "type": JOB_TYPE,
        "priority": _PRIORITY,
        "submitter_platform": {"win32": "windows"}.get(sys.platform, sys.platform),
        "settings": settings,
        "metadata": {"program": "Measured Materials", "materials": str(len(plan.jobs))},
    }


def _below(word: str, root: str) -> str:
    """A word of a job with the folder that all lies in as a placeholder, if it begins with it, or behind a `=`."""
    option, equals, path = word.rpartition("=")
    for front, rest in (("", word), (option + equals, path)):
        if root and (rest == root or rest.startswith((root + "/", root + "\\"))):
            return front + _ROOT + rest[len(root) :]
    return word
