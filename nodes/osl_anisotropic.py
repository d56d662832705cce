"""Parameters of the OSL shader of an anisotropic bundle, `measured_anisotropic.osl`."""

from __future__ import annotations

from typing import Any

from ..bake.brdf.grids import AnisotropicGrid
from ..bake.brdf.record import BrdfRecord
from ..bake.envelope.anisotropic_lobes import AnisotropicLobe
from ..bake.errors import BakeError
from ..bake.sampling.slope_cells import SlopeLayout
from ..bake.tables.table import FILTERS
from .osl_script import grid_constants, texel_constants, texture_file


def anisotropic_constants(
    record: BrdfRecord, mode: str, filter: str | None = None, stochastic: bool = True
) -> dict[str, Any]:
    """What describes the bundle, its pixels read and checked. Raises BakeError."""
    constants: dict[str, Any] = {"Mode": mode}
    bundle = record.files()
    if mode != "preview":
        table = record.baked("table" if mode == "reference" else "residual")
        grid, layout = table.stored.grid, table.layout
        assert isinstance(grid, AnisotropicGrid) and isinstance(layout, SlopeLayout)
        bundle.load(table.part)
        constants |= {"Table": texture_file(bundle, table.part), **texel_constants(table.stored)}
        chosen = filter or table.filter
        if chosen not in FILTERS:
            raise BakeError(bundle.path, f"filter cannot be {chosen[:40]!r}", f"choose from {', '.join(FILTERS)}")
        constants |= grid_constants(grid) | {"Filter": chosen, "Stochastic": int(stochastic)}
        table.load_sampler()
        constants["Sampler"] = texture_file(bundle, table.sampler)
        constants |= slope_constants(layout)
    for name, image, modes in (
        ("Envelope", "envelope", ("exact", "balanced")),
        ("Preview", "preview_weights", ("preview", "balanced")),
    ):
        if mode in modes:
            fit = record.load_envelope() if image == "envelope" else record.load_preview()
            constants |= {name: texture_file(bundle, image), f"{name}Closures": closure_words(fit.closures)}
            viewers = fit.viewers
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
