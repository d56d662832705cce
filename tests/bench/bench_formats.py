"""Files of every format, written by its layout from a known BRDF and read again: error, and seconds of reading."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from measured_materials.bake.source import SHEET_PARTS, BrdfSource, SheetSource
from measured_materials.bake.sources import merl, read_source
from measured_materials.bake.sources.analytic import ThinCloth
from measured_materials.bake.tables.sheet import SheetView
from record import put
from support.format_files import (
    BRUSHED,
    GLOSSY,
    GREY,
    WRITERS,
    error,
    write_tree,
)
from support.format_variants import write_alta_stream, write_cornell, write_goniometer, write_utia_picture
from support.rgl_writer import write_anisotropic_rgl
from support.sheet_files import write_klems_sheet, write_mbsdf_sheet

CLOTH = ThinCloth((0.3, 0.2, 0.1), None, (0.1, 0.2, 0.3), (0.4, 0.3, 0.2), 6.0)
WAYS = "Reflection Back", "Reflection Front", "Transmission Front", "Transmission Back"


def run(out: Path, quick: bool) -> None:
    """All formats that a test writes; --quick is the same."""
    print("RMS of f cos cos over that of the signal, between the written directions")
    with tempfile.TemporaryDirectory() as folder:
        for name, (suffix, write) in WRITERS.items():
            if name in ("Neural-BRDF", "published SGD or ABC fit"):  # compared with themselves: tests
                continue
            _show(name, write(Path(folder) / f"sample{suffix}", GLOSSY), name in GREY)
        azimuths = np.arange(0.0, 360.0, 30.0)
        _show("brushed, table", write_goniometer(Path(folder) / "brushed.csv", BRUSHED, azimuths), False, BRUSHED)
        _show("brushed, UTIA picture", write_utia_picture(Path(folder) / "brushed.exr", BRUSHED), False, BRUSHED)
        _show("ALTA, binary", write_alta_stream(Path(folder) / "sample.alta", GLOSSY), True)
        _show("tensor tree", write_tree(Path(folder) / "tree.xml", GLOSSY, 5), True)
        path = Path(folder) / "brushed.bsdf"
        write_anisotropic_rgl(path, BRUSHED, (0.3, 0.6), azimuths=17, elevations=12)
        _show("brushed, RGL", path, False, BRUSHED)
        _show("Cornell", write_cornell(Path(folder) / "sample.brdf", GLOSSY), True)
        _show_sheet("Klems", write_klems_sheet(Path(folder) / "cloth.xml", CLOTH, WAYS), True)
        _show_sheet("NVIDIA MBSDF", write_mbsdf_sheet(Path(folder) / "cloth.mbsdf", CLOTH), False)
        path = Path(folder) / "sample.binary"
        merl.write_merl(path, GLOSSY, "bins")
        _show("MERL", path, False)


def _show_sheet(name: str, path: Path, grey: bool) -> None:
    """What comes through, from behind and from the front."""
    source = read_source(path)
    assert isinstance(source, SheetSource)
    found = max(error(SheetView(source, part), SheetView(CLOTH, part), grey) for part in SHEET_PARTS[::2])
    print(f"{f'{name}, transmission':24s}{100 * found:8.2g} %")
    put(f"round trip, {name}, transmission", found)


def _show(name: str, path: Path, grey: bool, truth: BrdfSource = GLOSSY) -> None:
    started = time.process_time()
    source = read_source(path)
    seconds = time.process_time() - started
    found = error(source, truth, grey)
    print(f"{name:24s}{100 * found:8.2g} %{seconds:8.2f} s to read  {source.facts['interpolation']}")
    put(f"round trip, {name}", found)
