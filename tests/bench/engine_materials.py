"""The twelve materials of `bench engine`: measured where measurements lie beside the repository, else by formula."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from materials import SHARED, merl_file
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.source import BrdfSource
from measured_materials.bake.sources import analytic, read_source


@dataclass(frozen=True)
class Kind:
    """A material by its kind: the measurement's name, of MERL's reconstructions or RGL's files, and a stand-in."""

    name: str
    measured: str
    formula: Callable[[], BrdfSource]

    def source(self, folder: Path) -> BrdfSource:
        """The measurement, or the formula where it is not there; files are written to `folder`."""
        if not (SHARED / "data").is_dir():
            return self.formula()
        if self.measured.endswith("_rgb"):
            return read_source(SHARED / "data" / "rgl" / f"{self.measured}.bsdf")
        return read_source(merl_file(self.measured, folder))


def _ward(albedo: float, alpha: float, diffuse: float = 0.01) -> BrdfSource:
    return analytic.Ward(diffuse=(diffuse,) * 3, specular=(albedo,) * 3, alpha=alpha)


KINDS = (
    Kind("felt", "pink-felt", partial(analytic.OrenNayar, (0.4, 0.2, 0.2), 0.7)),
    Kind("fabric", "white-fabric2", partial(analytic.ModifiedPhong, (0.3,) * 3, (0.2,) * 3, 8)),
    Kind("phenolic", "specular-black-phenolic", partial(_ward, 0.05, 0.04)),
    Kind("plastic", "yellow-plastic", partial(analytic.BlinnPhong, (0.3, 0.25, 0.04), (0.1,) * 3, 20)),
    Kind("paint", "orange-paint", partial(analytic.BlinnPhong, (0.45, 0.15, 0.02), (0.05,) * 3, 10)),
    Kind("metallic paint", "blue-metallic-paint2", partial(analytic.MetallicPaint, coat_alpha=0.06)),
    Kind("bronze", "alum-bronze", partial(_ward, 0.5, 0.25, 0.05)),
    Kind("steel", "steel", partial(_ward, 0.5, 0.1)),
    Kind("chrome", "chrome", partial(_ward, 0.6, 0.02)),
    Kind("paper", "paper_white_rgb", partial(analytic.OrenNayar, (0.8,) * 3, 0.3)),
    Kind("satin", "satin_rosaline_rgb", partial(analytic.BlinnPhong, (0.5, 0.3, 0.3), (0.2,) * 3, 60)),
    Kind("flake paint", "irid_flake_paint1_rgb", partial(analytic.MetallicPaint, flake_alpha=0.15, coat_alpha=0.02)),
)
QUICK = ("felt", "metallic paint", "phenolic")


def bake_all(kinds: list[Kind], folder: Path, settings: BakeSettings) -> None:
    """Bundles `folder`/NAME.mmat of all kinds that are not there yet, two at a time."""
    missing = [kind for kind in kinds if not bundle_path(kind, folder).is_dir()]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(partial(_bake, folder=folder, settings=settings), missing))


def bundle_path(kind: Kind, folder: Path) -> Path:
    """Where `bake_all` puts it."""
    return folder / f"{kind.measured}.mmat"


def _bake(kind: Kind, folder: Path, settings: BakeSettings) -> None:
    bake_source(kind.source(folder), bundle_path(kind, folder), settings)
