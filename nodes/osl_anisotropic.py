"""Parameters of the OSL shader of an anisotropic bundle, `measured_anisotropic.osl`."""

from __future__ import annotations

from typing import Any

from ..bake.anisotropic.facts import closures_of, filter_of, grid_of, sampler_of
from ..bake.anisotropic.lobes import AnisotropicLobe
from ..bake.anisotropic.sampler import SlopeLayout
from ..bake.bundle import Bundle
from ..bake.errors import BakeError
from ..bake.tables.table import FILTERS
from .osl_script import grid_constants, texel_constants, texture_file


def anisotropic_constants(
    bundle: Bundle, mode: str, filter: str | None = None, stochastic: bool = True
) -> dict[str, Any]:
    """What describes the bundle, its pixels read and checked. Raises BakeError."""
    constants: dict[str, Any] = {"Mode": mode}
    if mode != "preview":
        part = "table" if mode == "reference" else "residual"
        sampler = "sampler" if mode == "reference" else "residual_sampler"
        bundle.load(part)
        constants |= {"Table": texture_file(bundle, part), **texel_constants(bundle, part)}
        chosen = filter or filter_of(bundle)
        if chosen not in FILTERS:
            raise BakeError(bundle.path, f"filter cannot be {chosen[:40]!r}", f"choose from {', '.join(FILTERS)}")
        constants |= grid_constants(grid_of(bundle, part)) | {"Filter": chosen, "Stochastic": int(stochastic)}
        constants["Sampler"] = texture_file(bundle, sampler)
        constants |= slope_constants(sampler_of(bundle, sampler).layout)
    for name, image, modes in (
        ("Envelope", "envelope", ("exact", "balanced")),
        ("Preview", "preview_weights", ("preview", "balanced")),
    ):
        if mode in modes:
            fit = closures_of(bundle, image)
            constants |= {name: texture_file(bundle, image), f"{name}Closures": closure_words(fit.closures)}
            viewers = fit.grid
            constants |= {"NodesTheta": viewers.n_theta, "NodesPhi": viewers.n_phi, "HalfTurn": int(viewers.folded)}
    return constants


def slope_constants(layout: SlopeLayout) -> dict[str, Any]:
    """Of a sampler."""
    return {
        "BinsTheta": layout.n_theta,
        "BinsPhi": layout.n_phi,
        "CellsX": layout.n_x,
        "CellsY": layout.n_y,
        "WidthX": layout.width_x,
        "WidthY": layout.width_y,
        "HalfTurn": int(layout.folded),
    }


def closure_words(closures: tuple[AnisotropicLobe, ...]) -> str:
    """Name and widths of each closure."""
    return " ".join(f"{lobe.name} {lobe.alpha_x:.9g} {lobe.alpha_y:.9g}" for lobe in closures)
