"""What a library consists of: one job for each material, and the words by which a farm runs it alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ...bake.bundle.bundle import SUFFIX
from ...bake.errors import BakeError
from ..baking.request import BakeRequest
from .names import Earlier


@dataclass(frozen=True)
class LibraryJob:
    """One material.

    Parameters
    ----------
    name : of the bundle without suffix; no other in the library has it
    request : its source and settings
    arguments : words behind `bake library` that make this very job again, paths absolute; all but `--out`
    replace : also a bundle of that name that was baked from another source
    identity : hexadecimal digits of which source it is, by its path or its formula
    refused : why it is not baked at all; None where it is
    """

    name: str
    request: BakeRequest
    arguments: tuple[str, ...] = ()
    replace: bool = False
    identity: str = ""
    refused: BakeError | None = None

    def target(self, out: Path) -> Path:
        """The bundle's folder."""
        return out / (self.name + SUFFIX)


@dataclass(frozen=True)
class Plan:
    """All jobs of a library.

    Parameters
    ----------
    out : its folder, an absolute path
    earlier : names that sources had in its last table, by their identities
    """

    out: Path
    jobs: tuple[LibraryJob, ...]
    earlier: Mapping[str, Earlier] = field(default_factory=dict)

    def command(self, job: LibraryJob) -> tuple[str, ...]:
        """Words by which a farm runs one job, behind `python -m measured_materials` or behind
        `blender --background --command measured_materials`; any number of them may run at once."""
        return ("bake", "library", *job.arguments, "--out", str(self.out), "--task")
