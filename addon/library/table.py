"""The table of a library: for people, and as library.json and library.csv for programs."""

from __future__ import annotations

import contextlib
import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...bake import VERSION
from ...bake.atomic_write import replacing_file
from ...bake.errors import BakeError
from ..summary.progress_estimate import readable_time
from ..summary.text import one_line
from .names import Earlier, name_key, still_theirs
from .outcome import BAKED, FAILED, KEPT, Outcome
from .plan import LibraryJob, Plan

DOCUMENT, SHEET = "library.json", "library.csv"
TABLE_SUFFIXES = ".json", ".csv"
WAITING = "waiting"
_COLUMNS = (
    *("name", "state", "source", "format", "bytes", "error", "seconds", "peak_bytes", "worker", "attempts"),
    "failure",
)
_WIDEST = 40
# Of a table to read: half a million materials.
_MOST_BYTES = 256 << 20


def library_document(plan: Plan, outcomes: Mapping[str, Outcome]) -> dict[str, Any]:
    """The table, JSON-ready: a row for each job, in the plan's order; of those that have not ended yet too."""
    rows = [_row(job, outcomes.get(job.name), plan.earlier.get(job.identity)) for job in plan.jobs]
    states = [row["state"] for row in rows]
    return {
        "generator": f"measured_materials {VERSION}",
        "materials": rows,
        "counts": {state: states.count(state) for state in (BAKED, KEPT, FAILED, WAITING)},
    }


def write_table(plan: Plan, outcomes: Mapping[str, Outcome]) -> None:
    """Write both files into the library, each in one step. Raises BakeError.

    library.json also holds the names that sources had before which are not baked this time.
    """
    document = library_document(plan, outcomes)
    now = {row["identity"]: Earlier(row["name"], row["ours"]) for row in document["materials"]}
    left = still_theirs(plan.earlier, now)
    document["earlier"] = [{"identity": identity, **asdict(one)} for identity, one in left.items()]
    try:
        text = json.dumps(document, indent=1, sort_keys=True, allow_nan=False) + "\n"
        with replacing_file(plan.out / DOCUMENT) as file:
            file.write_text(text, encoding="utf-8", newline="\n")
        with (
            replacing_file(plan.out / SHEET) as file,
            open(file, "w", encoding="utf-8", newline="") as stream,
        ):
            rows = csv.DictWriter(stream, _COLUMNS, extrasaction="ignore")
            rows.writeheader()
            rows.writerows({**row, "failure": _words(row["failure"])} for row in document["materials"])
    except (OSError, ValueError) as error:
        cause = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise BakeError(plan.out / DOCUMENT, cause, "check the folder, its permissions and the free space") from error


def names_kept(out: Path) -> dict[str, Earlier]:
    """Names that sources had in the library's last table, by their identities; none where it cannot be read.

    One that is another source's own is nobody else's.
    """
    found: dict[str, Earlier] = {}
    with contextlib.suppress(OSError, ValueError, RecursionError):
        if (out / DOCUMENT).stat().st_size > _MOST_BYTES:
            return found
        document = json.loads((out / DOCUMENT).read_bytes())
        listed = [document.get(key) for key in ("earlier", "materials")] if isinstance(document, dict) else []
        for row in (row for rows in listed if isinstance(rows, list) for row in rows):
            if isinstance(row, dict) and isinstance(row.get("identity"), str) and isinstance(row.get("name"), str):
                found[row["identity"]] = Earlier(row["name"], row.get("ours") is True)
    owned = {name_key(one.name) for one in found.values() if one.ours}
    return {key: one for key, one in found.items() if one.ours or name_key(one.name) not in owned}


def table_lines(plan: Plan, outcomes: Mapping[str, Outcome], seconds: float) -> list[str]:
    """The table for people, with a last line on all of it."""
    rows = [("name", "format", "bytes", "error", "seconds", "")]
    for job in plan.jobs:
        told = outcomes.get(job.name)
        if told is None:
            rows.append((job.name, "", "", "", "", WAITING))
        elif told.state == FAILED:
            rows.append((job.name, "", "", "", f"{told.seconds:.1f}", f"failed: {told.cause}; {told.remedy}"))
        else:
            error = "" if told.error is None else f"{100 * told.error:.2g} %"
            rows.append((job.name, told.format, f"{told.bytes:,}", error, f"{told.seconds:.1f}", told.state))
    widths = [min(max(len(row[k]) for row in rows), _WIDEST) for k in range(5)]
    lines = []
    for row in rows:
        sides = (str.ljust, str.ljust, str.rjust, str.rjust, str.rjust)
        cells = [side(one_line(cell), width) for side, cell, width in zip(sides, row, widths)]
        lines.append("  ".join([*cells, one_line(row[5])]).rstrip())
    return [*lines, total_words(plan, outcomes, seconds)]


def total_words(plan: Plan, outcomes: Mapping[str, Outcome], seconds: float) -> str:
    """One line on all of it."""
    counts = library_document(plan, outcomes)["counts"]
    told = [f"{count} {state}" for state, count in counts.items() if count]
    many = f"{len(plan.jobs)} material{'s' * (len(plan.jobs) != 1)}"
    return f"{plan.out}: {many}, {', '.join(told)}, in {readable_time(seconds)}"


def _row(job: LibraryJob, told: Outcome | None, before: Earlier | None) -> dict[str, Any]:
    known = asdict(told or Outcome(job.name, FAILED, job.request.title))
    # A name of a file may be no text.
    known |= {key: _text(value) for key, value in known.items() if isinstance(value, str)}
    failed = {key: known.pop(key) for key in ("file", "cause", "remedy", "of_machine")}
    if told is None:
        known["state"], known["attempts"] = WAITING, 0
    failure = failed if told is not None and told.state == FAILED else None
    ours = before == Earlier(job.name, True) or (told is not None and told.state in (BAKED, KEPT))
    return {**known, "failure": failure, "identity": job.identity, "ours": ours}


def _text(words: str) -> str:
    """Words with escapes in the place of what UTF-8 cannot hold."""
    return words.encode("utf-8", "backslashreplace").decode("utf-8")


def _words(failure: Mapping[str, str] | None) -> str:
    return "" if failure is None else one_line(f"{failure['file']}: {failure['cause']}; {failure['remedy']}")


def errors_of(outcomes: Sequence[Outcome]) -> list[BakeError]:
    """The failures, as the command line reports them."""
    return [BakeError(told.file, told.cause, told.remedy) for told in outcomes if told.state == FAILED]
