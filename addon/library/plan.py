"""What a library consists of: one job for each material, and the words by which a farm runs it alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...bake.bundle.bundle import SUFFIX
from ..baking.request import BakeRequest


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
    """

    name: str
    request: BakeRequest
    arguments: tuple[str, ...] = ()
    replace: bool = False
    identity: str = ""

    def target(self, out: Path) -> Path:
        """The bundle's folder."""
        return out / (self.name + SUFFIX)


@dataclass(frozen=True)
class Plan:
    """All jobs of a library in the folder `out`, an absolute path."""

    out: Path
    jobs: tuple[LibraryJob, ...]

    def command(self, job: LibraryJob) -> tuple[str, ...]:
        """Words by which a farm runs one job, behind `python -m measured_materials` or behind
        `blender --background --command measured_materials`; any number of them may run at once."""
        return ("bake", "library", *job.arguments, "--out", str(self.out), "--task")
