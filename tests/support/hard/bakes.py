"""Whole bakes of hostile sources and stacks: a right result, or one line that refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.errors import BakeError
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.lobes.lobes import Lobe
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps import power_law
from measured_materials.bake.shading_maps.shading_map import averages_of, linearise
from measured_materials.bake.shading_maps.store import store_map
from measured_materials.bake.sources import analytic

from .points import pairs_above

Array = np.ndarray


@dataclass(frozen=True)
class Outcome:
    """A whole call: `run` in a folder gives an error to compare with `bound`, or raises BakeError of `cause`."""

    group: str
    name: str
    what: str
    run: Callable[[Path], float]
    bound: float | None = None
    cause: str = ""

    def __str__(self) -> str:
        return f"{self.group}: {self.name}"

    @property
    def promise(self) -> str:
        """As the table states it."""
        return f"refused: {self.cause}" if self.bound is None else f"{self.bound:.1g}"


def measure(outcome: Outcome, folder: Path) -> float | str:
    """The error, or the line of the refusal."""
    try:
        return float(outcome.run(folder))
    except BakeError as error:
        # The folder is another one every time.
        return str(error).replace(f"{folder}/", "")


def is_kept(outcome: Outcome, found: float | str) -> bool:
    """Whether it is what was promised."""
    if outcome.bound is None:
        return isinstance(found, str) and outcome.cause in found and "\n" not in found
    return isinstance(found, float) and found <= outcome.bound


class Constant:
    """A source of one value everywhere above the horizon; `spoilt` stands at one cell of directions."""

    def __init__(self, value: float, spoilt: float | None = None, isotropic: bool = True) -> None:
        self.value, self.spoilt, self.name = value, spoilt, "constant"
        self.isotropic = self.bilateral = isotropic
        self.facts: dict[str, Any] = {}

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """The value; the spoilt one in a cone of 15 degrees round the mirror direction."""
        wi, wo = np.broadcast_arrays(wi, wo)
        out = np.full(wi.shape, self.value)
        if self.spoilt is not None:
            out[np.sum(wi * wo * [-1, -1, 1], -1) > 0.966] = self.spoilt
        out[(wi[..., 2] <= 0) | (wo[..., 2] <= 0)] = 0
        return out


SMALL = BakeSettings(8, sampler=SamplerLayout(8, 8, 8), parameterization="bezier", alpha=(0.3, 0.3), basis="normal")
PLAIN = replace(SMALL, envelope=False)


def _baked(source: Any, folder: Path, settings: BakeSettings) -> tuple[Any, dict[str, Any]]:
    """Table as a shader reads it, and the facts; every image is finite and none but offsets negative."""
    path = bake_source(source, folder / "hard", settings).path
    bundle = read_bundle(path)
    for name in bundle.material["images"]:
        pixels = bundle.load(name)
        assert np.isfinite(pixels).all() and pixels.min() >= 0, name
    return replace(BrdfRecord.read(bundle).load_table(), filter=settings.filter), bundle.material


def _constant(value: float, storage: str, folder: Path, **settings: Any) -> float:
    """Largest relative error of the table of a constant; of a denormal one relative to the smallest number."""
    table, facts = _baked(Constant(value), folder, replace(PLAIN, storage=Storage(storage), **settings))
    found = table.evaluate(*pairs_above())
    assert np.isfinite(facts["table_albedo"]["directional"]).all()
    return float(np.abs(found - value).max() / max(value, 2.0**-126))


def _bright(storage: str, folder: Path, envelope: bool = False) -> float:
    """Negative or not finite values in the table of one bright cell, and overshoot above it."""
    table, _ = _baked(Constant(1e-3, 1e4), folder, replace(SMALL, storage=Storage(storage), envelope=envelope))
    found = table.evaluate(*pairs_above())
    return max(float(found.max()) / 1e4 - 1, 1 - float(found.min()) / 1e-3, 0.0)


def _albedo(source: Any, folder: Path, **settings: Any) -> float:
    """Albedo above 1 at any elevation up to 85 degrees, and of the source itself."""
    _, facts = _baked(source, folder, replace(PLAIN, **settings))
    return max(float(np.max(facts["table_albedo"]["directional"])) - 1, 0.0)


def _refused_source(source: Any, folder: Path) -> float:
    _baked(source, folder, SMALL)
    return np.inf


def _stack(averages: list[float]) -> Array:
    """Photographs of these averages, uneven within."""
    pattern = np.random.default_rng(1).uniform(0.5, 1.5, (4, 5, 3))
    stack = [pattern ** (0.5 + k) for k in range(len(averages))]
    return np.stack([a * p / p.mean() for a, p in zip(averages, stack)]).astype(np.float32)


def _linearised(averages: list[float], folder: Path) -> float:
    """Largest difference of a slice's average from its level, of a_max."""
    made = linearise(_stack(averages), 6)
    assert np.isfinite(made.map.slices).all() and made.map.slices.min() >= 0
    return float(np.abs(averages_of(made.map.slices) - made.map.levels).max())


def _stored(slices: Array, compression: str, storage: str, folder: Path) -> float:
    """RMS of a shading map through its images, of its largest value."""
    made = linearise(slices, 6)
    images, facts, again = store_map(made.map, compression, Storage(storage))  # type: ignore[arg-type]
    assert all(np.isfinite(image.pixels).all() and image.pixels.min() >= 0 for image in images.values())
    assert all(np.isfinite(v) for v in facts.values() if isinstance(v, float))
    return float(np.sqrt(np.mean((again.slices - made.map.slices) ** 2)) / made.map.slices.max())


def _calls(function: Callable[..., Any], *arguments: Any, **named: Any) -> Callable[[Path], float]:
    def run(folder: Path) -> float:
        function(*arguments, **named)
        return np.inf

    return run


def outcomes() -> list[Outcome]:
    """All, in the order of the table."""
    return [*_sources(), *_energy(), *_stacks(), *_non_finite()]


def _sources() -> list[Outcome]:
    return [
        Outcome("bake", "all equal, half", "relative error", partial(_constant, 0.1, "half"), 5e-4),
        Outcome("bake", "all equal, RGBE", "relative error", partial(_constant, 0.1, "rgbe"), 4e-3),
        Outcome("bake", "1e30, half", "relative error", partial(_constant, 1e30, "half", envelope=True), 5e-4),
        Outcome("bake", "1e30, float32", "relative error", partial(_constant, 1e30, "float32"), 1e-6),
        Outcome("bake", "1e-30, half", "relative error", partial(_constant, 1e-30, "half"), 5e-4),
        Outcome("bake", "denormal, 1e-40", "of 2^-126", partial(_constant, 1e-40, "float32"), 1.0),
        Outcome("bake", "one cell of 1e4 among 1e-3, float32", "beyond the two", partial(_bright, "float32"), 1e-6),
        Outcome(
            "bake", "one cell of 1e4 among 1e-3, half", "beyond the two", partial(_bright, "half", envelope=True), 5e-4
        ),
        Outcome("bake", "all zero", "", partial(_refused_source, Constant(0)), cause="reflects nothing"),
        Outcome("bake", "one cell NaN", "", partial(_refused_source, Constant(0.1, np.nan)), cause="not finite"),
        Outcome("bake", "one cell infinite", "", partial(_refused_source, Constant(0.1, np.inf)), cause="not finite"),
        Outcome(
            "bake",
            "anisotropic, one cell NaN",
            "",
            partial(_refused_source, Constant(0.1, np.nan, isotropic=False)),
            cause="not finite",
        ),
        Outcome(
            "bake", "anisotropic, all zero", "", partial(_refused_source, Constant(0, None, False)), cause="nothing"
        ),
        Outcome("bake", "beyond float32, 1e39", "", partial(_refused_source, Constant(1e39)), cause="too large"),
    ]


def _energy() -> list[Outcome]:
    ggx, phong = analytic.Ggx(alpha=0.1), analytic.ModifiedPhong(0, 1, 100)
    half = {"basis": "half", "parameterization": "fitted", "alpha": "error", "resolution": 32}
    white = analytic.Lambert(1.0)
    return [
        Outcome("albedo above 1", "white Lambert", "8 x 8 x 16", partial(_albedo, white), 1e-3),
        Outcome("albedo above 1", "GGX, alpha 0.1, half vectors", "32^3", partial(_albedo, ggx, **half), 0.02),
        Outcome("albedo above 1", "Phong, n = 100, half vectors", "32^3", partial(_albedo, phong, **half), 0.02),
    ]


def _stacks() -> list[Outcome]:
    ulp = float(np.spacing(np.float32(0.5)))
    spike = _stack([0.1, 0.3, 1.0])
    spike[-1, 0, 0] = 1e6
    spread = _stack([0.1, 0.5, 1.0])
    return [
        Outcome("stack", "two averages an ulp apart and one above", "of a_max", _of([0.5, 0.5 + ulp, 1.0]), 2e-6),
        Outcome("stack", "a_max twice, an ulp apart", "of a_max", _of([0.25, 0.5, 0.5 + ulp]), 2e-6),
        Outcome("stack", "averages from 1e-30 to 1e30", "of a_max", _of([1e-30, 1.0, 1e30]), 2e-6),
        Outcome("stack", "averages from 1e-39 to 2e-38", "of a_max", _of([1e-39, 1e-38, 2e-38]), 2e-6),
        Outcome("stack", "all clustered below a hundredth of a_max", "of a_max", _of([0.001, 0.002, 0.003, 1]), 2e-6),
        Outcome("stack", "constant", "", _of([0.5] * 4), cause="same average"),
        Outcome("stack", "constant but for an ulp", "", _of([0.5, 0.5 + ulp]), cause="same average"),
        Outcome("stack", "black", "", _of([0.0] * 3), cause="black"),
        Outcome("stack", "denormal, 1e-42", "", _of([1e-43, 1e-42]), cause="too dark"),
        Outcome("stack", "stored by half", "of the largest", partial(_stored, spread, "none", "half"), 5e-4),
        Outcome("stack", "hot pixel of 1e6, half", "of the largest", partial(_stored, spike, "none", "half"), 5e-4),
        Outcome("stack", "hot pixel of 1e6, bytes", "of the largest", partial(_stored, spike, "none", "byte"), 4e-3),
        Outcome("stack", "hot pixel of 1e6, basis", "of the largest", partial(_stored, spike, "basis", "half"), 1e-2),
        Outcome(
            "stack", "hot pixel of 1e6, power law", "of the largest", partial(_stored, spike, "power", "float32"), 1e-3
        ),
    ]


def _of(averages: list[float]) -> Callable[[Path], float]:
    return partial(_linearised, averages)


def _non_finite() -> list[Outcome]:
    nan = float("nan")
    bad = _stack([0.1, 0.5, 1.0])
    bad[1, 0, 0, 0] = nan
    pixels = np.full((2, 2, 3), nan, np.float32)
    large = np.full((2, 2, 3), 1e5, np.float32)

    def image(values: Array, storage: Storage, folder: Path) -> float:
        write_image(folder / f"bad{storage.suffix}", values, storage)
        return np.inf

    return [
        Outcome("not finite", "photograph", "", _calls(linearise, bad, 6), cause="not finite"),
        Outcome("not finite", "slices of a power law", "", _calls(power_law.fit, bad), cause="not finite"),
        Outcome("not finite", "texels, float32", "", partial(image, pixels, Storage.FLOAT32), cause="not finite"),
        Outcome(
            "not finite", "texels, half: overflow of 1e5", "", partial(image, large, Storage.HALF), cause="overflow"
        ),
        Outcome("not finite", "texels, RGBE: negative", "", partial(image, -large, Storage.RGBE), cause="negative"),
        Outcome("not finite", "exponent of Phong", "", _calls(Lobe, "phong", nan, 0.5), cause="exponent"),
        Outcome("not finite", "alpha of a table", "", _calls(BakeSettings, alpha=(nan, 0.5)), cause="alpha"),
        Outcome("not finite", "alpha of GGX", "", _calls(analytic.Ggx, alpha=nan), cause="alpha"),
    ]
