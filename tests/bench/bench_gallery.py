"""Contact sheets of the genuine measurements: twelve RGL materials and three Cornell paints."""

from __future__ import annotations

from pathlib import Path

from materials import cornell_files, rgl_files
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.sources import read_source
from pictures import picture


def run(out: Path, quick: bool) -> None:
    """Two sheets; --quick renders small."""
    size, samples = (160, 48) if quick else (240, 128)
    for name, files, columns in (("rgl", rgl_files(), 4), ("cornell", cornell_files(), 3)):
        cells = []
        for path in files:
            source = read_source(path)
            pixels, result = picture(source, BakeSettings(resolution=128), size=size, samples=samples)
            errors, albedo = result.facts["errors"], result.facts["albedo"]["white_sky"]
            label = path.name.removesuffix(path.suffix).removesuffix("_rgb")
            below = f"table off by {errors['relative']:.1%}, albedo {albedo[0]:.2f} {albedo[1]:.2f} {albedo[2]:.2f}"
            cells.append(Cell(pixels, label, below))
        sheet = out / f"gallery-{name}.png"
        write_sheet(sheet, cells, columns, f"{len(files)} genuine {name.upper()} measurements, 128 x 128 x 256")
        print(f"  {sheet}")
