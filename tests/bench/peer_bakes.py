"""Bundles of `bench mitsuba`: every RGL file as we read it, and with light and viewer exchanged, as Mitsuba does."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.source import Array, BrdfSource, Facts
from measured_materials.bake.sources import read_source

EXCHANGED = " exchanged"


@dataclass(frozen=True)
class Exchanged:
    """A BRDF whose light and viewer have changed places: another one, where a measurement is not reciprocal."""

    source: BrdfSource

    @property
    def name(self) -> str:
        """With what was done to it."""
        return self.source.name + EXCHANGED

    @property
    def isotropic(self) -> bool:
        """As before."""
        return self.source.isotropic

    @property
    def bilateral(self) -> bool:
        """As before."""
        return self.source.bilateral

    @property
    def facts(self) -> Facts:
        """As before."""
        return self.source.facts

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """As `BrdfSource.evaluate`."""
        return self.source.evaluate(wo, wi)


def bake_all(files: Iterable[Path], folder: Path) -> None:
    """Bundles `folder`/NAME.mmat and `folder`/NAME exchanged.mmat, two at a time."""
    jobs = [(file, folder, exchanged) for file in files for exchanged in (False, True)]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(_bake, jobs))


def bundle_path(file: Path, folder: Path, exchanged: bool = False) -> Path:
    """Where `bake_all` puts it."""
    return folder / f"{file.stem}{EXCHANGED * exchanged}.mmat"


def _bake(job: tuple[Path, Path, bool]) -> None:
    file, folder, exchanged = job
    source = read_source(file)
    bake_source(Exchanged(source) if exchanged else source, bundle_path(file, folder, exchanged), BakeSettings())
