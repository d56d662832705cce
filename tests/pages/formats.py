"""A sphere of each format that is read: genuine files where there are some, else files written by the layout."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))

from commands import save
from materials import require_shared
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.bake.brdf.preview_sphere import preview_sphere
from measured_materials.bake.reading import Reading
from measured_materials.bake.source import SheetSource
from measured_materials.bake.sources import read_source
from measured_materials.bake.tables.sheet import SheetView
from measured_materials.bake.tables.treated_source import TreatedSource
from PIL import Image
from support.format_files import BRUSHED, GLOSSY, WRITERS
from support.format_variants import write_alta_stream, write_utia_picture
from support.rgl_writer import write_anisotropic_rgl

_SIZE = 150
# By the folders of ../shared/data.
_GENUINE = {
    "EPFL/RGL": "rgl/irid_flake_paint1_rgb.bsdf",
    "Cornell": "cornell/garnet_red.brdf",
    "NVIDIA MBSDF": "formats/mbsdf/carpaint_red.mbsdf",
    "Zemax": "formats/zemax/AnoBlackEC1onAlum.bsdf",
    "Zemax, anisotropic": "formats/zemax/IMX455_aniso.bsdf",
    "FRED": "formats/fred/AnoBlackEC1onAlum.txt",
    "ALTA": "alta/retro-gray-tape.dat",
    "Klems matrix": "klems/mecho_shade_fabric.xml",
    "Klems, both sides": "formats/klems/2011-SA1.XML",
    "tensor tree": "formats/tensortree/testBSDF.xml",
    "Neural-BRDF": "formats/neural_brdf/blue-rubber.h5",
    "SGD": "published_fits/merl_sgd_bagher2012.json",
    "ABC": "published_fits/merl_abc_low2012.json",
}
_WRITTEN = ("Integra DDR", "LightTools", "ASTM E2387", "table of samples", "pab-opto", "UTIA", "numpy array")


def make(out: Path, folder: Path) -> None:
    """Read, shade in numpy, and lay out six in a row; "through" shows light from behind a sheet, mirrored in it."""
    data = require_shared() / "data"
    cells = [cell for name, file in _GENUINE.items() for cell in _cells(name, data / file, "genuine")]
    for name in _WRITTEN:
        suffix, write = WRITERS[name]
        cells += _cells(name, write(folder / f"{name.split()[0]}{suffix}", GLOSSY), "GGX, written")
    brushed = folder / "brushed.bsdf"
    write_anisotropic_rgl(brushed, BRUSHED, (0.3, 0.6))
    cells += _cells("RGL, anisotropic", brushed, "brushed, written")
    cells += _cells("ALTA, binary", write_alta_stream(folder / "sample.alta", GLOSSY), "GGX, written")
    cells += _cells("UTIA, picture", write_utia_picture(folder / "brushed.exr", BRUSHED), "brushed, written")
    write_sheet(folder / "formats.png", cells, 6)
    save(Image.open(folder / "formats.png"), out / "formats.jpg")


def _cells(name: str, path: Path, origin: str) -> list[Cell]:
    """Reflection, and of a sheet transmission."""
    source = read_source(path, Reading(material="gold-metallic-paint" if "fits" in str(path) else ""))
    cells = [Cell(preview_sphere(TreatedSource(source), _SIZE), name, origin)]
    if isinstance(source, SheetSource):
        cells.append(Cell(preview_sphere(TreatedSource(SheetView(source, "through")), _SIZE), name, "through"))
    return cells
