"""Baked BRDFs of four kinds of material, and in numpy exactly what each mode of such a material has to show."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.bundle.bundle import Bundle, StoredImage, read_bundle, write_bundle
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.reading import Reading
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import analytic, read_source

from .direct_light import Brdf

# Small: what a material shows is compared with its own table, however coarse that is.
SETTINGS = BakeSettings(resolution=24, alpha=(0.5, 0.3), sampler=SamplerLayout(n_o=32, n_h=32, n_phi=16))

MEASURED = {
    "felt": "pink-felt",
    "fabric": "white-fabric2",
    "metallic paint": "blue-metallic-paint2",
    "phenolic": "specular-yellow-phenolic",
}
"""Names among the networks of Sztrajman et al. 2021, which stand for MERL's measurements."""


@dataclass(frozen=True)
class Cloth:
    """Rough diffuse cloth with a rim: light scattered by fibres that stand up, most where both directions graze it.

    Reciprocal, finite, and of no closure's form.
    """

    colour: tuple[float, float, float]
    rim: tuple[float, float, float]
    name: str
    isotropic: bool = True
    bilateral: bool = True
    facts: dict[str, Any] = field(default_factory=dict)

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr."""
        wi, wo = np.broadcast_arrays(wi, wo)
        rough = analytic.OrenNayar(diffuse=self.colour, sigma=0.5).evaluate(wi, wo)
        grazing = (1 - wi[..., 2:]) * (1 - wo[..., 2:])
        backwards = 0.5 * (1 + np.sum(wi * wo, -1, keepdims=True))
        lit = (wi[..., 2:] > 0) & (wo[..., 2:] > 0)
        return rough + np.where(lit, grazing**1.5 * (0.5 + backwards), 0) * np.array(self.rim)


ANALYTIC: dict[str, BrdfSource] = {
    "felt": Cloth((0.45, 0.12, 0.15), (0.3, 0.2, 0.2), "felt"),
    "fabric": analytic.ModifiedPhong(diffuse=(0.35, 0.3, 0.2), specular=(0.2, 0.2, 0.2), exponent=8),
    "metallic paint": analytic.MetallicPaint((0.05, 0.1, 0.3), (0.1, 0.2, 0.4), flake_alpha=0.3, coat_alpha=0.1),
    "phenolic": analytic.Ward(diffuse=(0.45, 0.3, 0.04), specular=(0.06, 0.06, 0.06), alpha=0.12),
}
"""Stand-ins of a formula for the same four."""


def neural_merl(shared_tools: Path) -> Any:
    """The tool that evaluates the published networks."""
    spec = importlib.util.spec_from_file_location("neural_merl", shared_tools / "neural_merl.py")
    assert spec and spec.loader
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    return tool


def measured_source(name: str, shared_tools: Path, folder: Path) -> BrdfSource:
    """One of `MEASURED`, through a file in MERL's layout."""
    tool = neural_merl(shared_tools)
    path = folder / f"{MEASURED[name]}.binary"
    tool.write(MEASURED[name], path)
    tool._W.close()  # its weights: a file left open is a warning wherever the collector finds it
    # As the networks were trained; the entries themselves pair as bins.
    return read_source(path, Reading(merl="nodes"))


def baked(source: BrdfSource, folder: Path) -> Bundle:
    """A bundle of a small table, for all modes."""
    return read_bundle(bake_source(source, folder / source.name, SETTINGS).path)


def brdf_of(bundle: Bundle, mode: str) -> Brdf:
    """What the mode shows on the first bounce: "reference" interp(f), "exact" and "balanced" E + interp(R)."""
    if mode == "reference":
        return BrdfRecord.read(bundle).load_table().evaluate
    fit, residual = BrdfRecord.read(bundle).load_envelope(), BrdfRecord.read(bundle).load_table("residual")
    return lambda wi, wo: fit.evaluate(wi, wo) + residual.evaluate(wi, wo)


def tinted(bundle: Bundle, path: Path, factor: float) -> Bundle:
    """Another bundle that reflects so much of what this one does, without a bake; its account stays as it was."""
    images = {}
    for name, entry in bundle.material["images"].items():
        pixels = bundle.load(name).copy()
        if name in ("table", "envelope", "residual", "preview_weights"):  # of samplers and shares nothing changes
            pixels[..., :3] *= np.float32(factor)
        images[name] = StoredImage(pixels, Storage(entry["storage"]))
    source = {**bundle.material["source"], "name": path.name}
    return read_bundle(write_bundle(path, {**bundle.material, "source": source}, images))
