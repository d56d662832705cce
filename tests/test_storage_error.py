"""What storage and ranks cost a shading map: over lights of all directions, not over levels, most of which few see."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.azimuth.azimuth_fit import Nodes, Prepared
from measured_materials.bake.shading_maps.azimuth.light_stack import LightStack
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_stack
from measured_materials.bake.shading_maps.record import ShadingMapRecord
from measured_materials.bake.shading_maps.shading_map import ShadingMap, at_level, linearise
from support.relief import glossy, lights

COSINES = (np.arange(64) + 0.5) / 64


def baked(path: Path, directions: np.ndarray, settings: ArcSettings) -> tuple[ShadingMapRecord, np.ndarray]:
    images = glossy(directions, 60.0, 0.1)
    stack = PhotoStack(images, tuple(map(str, range(len(images)))), directions, False, ())
    return ShadingMapRecord.read(read_bundle(bake_stack(stack, path, settings).path)), images


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.square(values).mean(dtype=np.float64)))


def test_along_an_arc_it_is_what_even_lights_see(tmp_path: Path) -> None:
    arc = lights(tuple(np.linspace(5, 88, 10)), 1, zenith=False)
    record, images = baked(tmp_path / "arc", arc, ArcSettings(azimuths="arc", storage=Storage.BYTE))
    made, again = linearise(images, record.map.slices), record.load_map()
    seen = np.interp(COSINES, np.linspace(0, 1, len(record.map.level_by_cosine)), record.map.level_by_cosine)

    def shown(one: ShadingMap) -> np.ndarray:
        return np.stack([at_level(one, x) for x in seen])

    direct, plain = rms(shown(again) - shown(made.map)), rms(again.slices - made.map.slices)
    # Between two slices their errors partly cancel, which the figure does not count on.
    assert direct < 1.01 * record.errors.storage_rms < 1.4 * direct
    assert np.isclose(record.errors.signal_rms, rms(shown(made.map)), rtol=0.1)
    assert record.errors.signal_rms < 0.6 * rms(made.map.slices[1:]) and direct < plain


def test_of_a_map_over_azimuth_it_is_what_even_lights_see(tmp_path: Path) -> None:
    dome = lights((15, 35, 55, 75), 8)
    record, images = baked(tmp_path / "dome", dome, ArcSettings(azimuths="all", azimuth_rank=3))
    stack = LightStack.of(images, dome)
    nodes, basis = Nodes.of(stack, Prepared.of(stack).choice), record.load_azimuth()
    flat = images.reshape(len(images), -1)
    truth, found = nodes.weights @ flat, (basis.coefficients.reshape(-1, 3) @ basis.lit_nodes()).T
    levels, x = nodes.curve.level(COSINES), np.insert(nodes.x, 0, 0.0)

    def seen(values: np.ndarray) -> float:
        each = np.square(values).mean(1).reshape(nodes.azimuths, -1).mean(0)
        return float(np.sqrt(np.interp(levels, x, np.insert(each, 0, 0.0)).mean()))

    assert np.isclose(record.errors.storage_rms, seen(found - truth), rtol=0.1)
    assert np.isclose(record.errors.signal_rms, seen(truth), rtol=0.02)
    assert record.errors.signal_rms < 0.6 * rms(truth)
