"""Swatches of the gantry photographed on an arc and all around, and baked: the maps that benches look at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from measured_materials.addon.gantry import techniques
from measured_materials.addon.gantry.swatches import Swatch
from measured_materials.addon.gantry.techniques import Case, Frames
from measured_materials.bake.bundle.bundle import Bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobe_fit import fit_lobe
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.render_settings import RenderSettings

ARC = tuple(np.linspace(5, 88, 10).round(2).tolist())
ARC_CASES = tuple(Case("arc", ((e, 0.0, 1.0),)) for e in ARC)
# Photographs of a map over azimuth: those of the arc, and seven azimuths more.
AROUND_CASES = (
    *ARC_CASES,
    *(Case("around", ((e, a, 1.0),)) for a in range(45, 360, 45) for e in (10.0, 30.0, 50.0, 70.0)),
)


def stack_of(cases: Sequence[Case], frames: Frames) -> PhotoStack:
    """The photographs of these cases."""
    images = np.stack([techniques.truth(case, frames) for case in cases]).astype(np.float32)
    directions = np.array([techniques.direction(*case.lights[0][:2]) for case in cases])
    return PhotoStack(images, tuple(f"{case.lights[0][:2]}" for case in cases), directions, True, ())


def renders_of(swatch: Swatch, stack: PhotoStack) -> dict[str, RenderSettings]:
    """Lighting by each choice of f_r, fitted to photographs.

    "family" is the lobe that an artist would name for such a swatch, with the parameters that fit its averages; "auto"
    the lobe that fits them best; "suggested" the named lobe with its parameters as they stand.
    """
    assert stack.directions is not None
    elevations = np.arcsin(stack.directions[:, 2])
    averages = stack.images.mean((1, 2, 3), dtype=np.float64)
    named, fit = Lobe.of(swatch.lobe, **swatch.lobe_parameters), fit_lobe(elevations, averages)
    return {
        "family": techniques.fitted_render(swatch.lobe, elevations, averages),
        "auto": RenderSettings(fit.lobe, fit.scale),
        "suggested": RenderSettings(named, techniques.scale_of(named, elevations, averages)),
    }


def bytes_of(bundle: Bundle) -> int:
    """Of a map's texels as they are stored, before lossless compression."""
    images = ShadingMapRecord.read(bundle).images.values()
    return sum(i.width * i.height * Storage(i.storage).file_bytes(i.channels) for i in images)
