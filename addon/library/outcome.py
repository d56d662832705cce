"""What became of one job, as it travels between processes and stands in the library's table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

State = Literal["baked", "kept", "failed"]
BAKED: State = "baked"
KEPT: State = "kept"
FAILED: State = "failed"


@dataclass(frozen=True)
class Outcome:
    """Of one job.

    Parameters
    ----------
    name : of the bundle, without suffix
    state : "baked"; "kept", where a bundle of equal source, settings and version was there already; "failed"
    source : its file's or formula's name
    format : of the source, as its reader calls it
    bytes : of the bundle's files
    error : of a table relative to the light it reflects, of a swatch that of photographs left out; None where unknown
    seconds : that it took
    peak_bytes, memory_bytes : of memory that the process had taken at most until then, and when the job was over; 0
        where the system does not say
    worker, ended : which process it was, and when, in seconds since 1970
    attempts : how often it was begun
    file, cause, remedy : of a failure
    of_machine : whether that comes of the machine, such as its memory, its disk or a file that it does not see, not of
        what the source holds
    """

    name: str
    state: State
    source: str = ""
    format: str = ""
    bytes: int = 0
    error: float | None = None
    seconds: float = 0.0
    peak_bytes: int = 0
    memory_bytes: int = 0
    worker: str = ""
    ended: float = 0.0
    attempts: int = 1
    file: str = ""
    cause: str = ""
    remedy: str = ""
    of_machine: bool = False

    def as_event(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)

    @classmethod
    def of_event(cls, event: Mapping[str, Any]) -> Outcome:
        """Undo `as_event`."""
        return cls(**{field.name: event[field.name] for field in fields(cls)})
