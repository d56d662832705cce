"""The samplers of a baked BRDF: which kind a layout is of, as a record tells it, and how one is built and checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .. import xp_numpy
from ..bundle.checked_json import Fields
from ..errors import BakeError
from ..sampling.cell_sampler import CellSampler, Evaluates, build_sampler
from ..sampling.half_vector_cells import SamplerLayout
from ..sampling.half_vector_warp import HalfVectorWarp
from ..sampling.inverse_tables import MOST_CELLS, inverted
from ..sampling.slope_cells import SlopeLayout
from ..sampling.slope_warp import SlopeWarp
from ..sampling.warp_sampler import WarpSampler, build_warp
from ..source import Array, Facts

IsotropicLayout = SamplerLayout | HalfVectorWarp
Layout = IsotropicLayout | SlopeLayout | SlopeWarp
Sampler = CellSampler | WarpSampler
# "alias" tables over cells, of which four random numbers draw, or a "warp" of two.
KINDS = ("alias", "warp")
WARPS = HalfVectorWarp, SlopeWarp
USUAL_SIZE = 64


def kind_of_layout(layout: Layout) -> str:
    """One of `KINDS`."""
    return "warp" if isinstance(layout, WARPS) else "alias"


def isotropic_layout(kind: str, size: int = USUAL_SIZE) -> IsotropicLayout:
    """The layout of a kind of `KINDS` whose sizes go with one number."""
    if size == USUAL_SIZE:
        return SamplerLayout() if kind == "alias" else HalfVectorWarp()
    if kind == "alias":
        return SamplerLayout(size, size, size // 2)
    return HalfVectorWarp(size // 4, min(size * 3 // 4, MOST_CELLS), size // 4)


def layout_facts(layout: Layout) -> Facts:
    """What `layout_of` reads; JSON-ready."""
    return {"kind": kind_of_layout(layout), **asdict(layout)}


def layout_of(fields: Fields, anisotropic: bool) -> Layout:
    """The sizes of a bundle's "sampler"; those of before version 4 name no kind, and are of alias tables. BakeError."""
    if not anisotropic:
        return isotropic_layout_of(fields)
    warp = _kind(fields) == "warp"
    most = MOST_CELLS if warp else 1024
    n_theta, n_phi = (fields.whole(key, 1, 1024) for key in ("n_theta", "n_phi"))
    n_x, n_y = (fields.whole(key, 1, most) for key in ("n_x", "n_y"))
    width_x, width_y = (fields.number(key, 1e-4, 1e3) for key in ("width_x", "width_y"))
    made = SlopeWarp if warp else SlopeLayout
    return made(n_theta, n_phi, n_x, n_y, width_x, width_y, fields.flag("folded"))


def isotropic_layout_of(fields: Fields) -> IsotropicLayout:
    """The same of an isotropic material, or of the settings of any. Raises BakeError."""
    if _kind(fields) == "warp":
        n_o = fields.whole("n_o", 1, 1024)
        n_h, n_phi = (fields.whole(key, 1, MOST_CELLS) for key in ("n_h", "n_phi"))
        return HalfVectorWarp(n_o, n_h, n_phi, fields.number("linear", 0, 1e3))
    n_o, n_h, n_phi = (fields.whole(key, 1, 1024) for key in ("n_o", "n_h", "n_phi"))
    return SamplerLayout(n_o, n_h, n_phi, fields.whole("warp_power", 1, 4))


def _kind(fields: Fields) -> str:
    return fields.text("kind", choices=KINDS) if fields.has("kind") else "alias"


def sampler_texels(source: Evaluates, layout: Layout, progress: Callable[[float], None] | None = None) -> Array:
    """Texels (bins, width, 4) float32 of the sampler that a layout describes."""
    if isinstance(layout, WARPS):
        return build_warp(source, layout, progress).texels
    return build_sampler(source, layout, progress).texels


def checked_sampler(layout: Layout, texels: Array, where: str | Path) -> Sampler:
    """The sampler of a bundle's texels. Raises BakeError where a number would lead out of them."""
    if texels.shape[2] != 4 or (texels < 0).any():
        raise BakeError(where, "is no sampler", "bake it again")
    if isinstance(layout, WARPS):
        _check_warp(layout, texels.astype(np.float64), where)
        return WarpSampler(layout, texels)
    if (texels[..., 1] >= layout.cells).any():
        raise BakeError(where, "is no alias table", "bake it again")
    return CellSampler(layout, texels)


def _check_warp(layout: HalfVectorWarp | SlopeWarp, texels: Array, where: str | Path) -> None:
    rows, columns = layout.shape[-2:]
    along = texels[:, : layout.strata, :3]
    across = texels[:, layout.strata :, :3].reshape(-1, columns, 3)
    for entries, strata, cells in ((along, layout.strata, rows), (across, columns, columns)):
        for end in (0, 1):
            at: Any = inverted(xp_numpy, (np.arange(strata) + end) / strata, entries)
            if (at < -1e-3).any() or (at > cells + 1e-3).any():
                raise BakeError(where, "is no table of an inverse", "bake it again")
    probability = texels[:, : layout.strata, 3]
    if not ((probability > 0) & (probability <= 1)).all():
        raise BakeError(where, "holds probabilities that would lose light", "bake it again")
