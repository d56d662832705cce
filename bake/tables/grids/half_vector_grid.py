"""Where the samples of a table in the half-vector basis lie (Rusinkiewicz 1998): (theta_d, theta_h, phi_d).

A highlight runs along theta_h alone, whatever the viewer; in the normal-vector basis it runs askew through three axes.
A glossy material is held there with a hundredth of the error at equal bytes, a felt, which has no highlight, hardly
better or worse.

Axes are [theta_d, theta_h, phi_d, rgb], slices along theta_d. As in `NormalVectorGrid` the last sample of each axis
lies at angle 0. phi_d ends at pi / 2 where the source is reciprocal (exchanging wi and wo and mirroring turns phi_d to
pi - phi_d), otherwise at pi. theta_d is a share of the largest that leaves both directions above the horizon: on the
whole box of angles a fifth to a half of all entries would lie below it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ... import xp_numpy
from ...source import Array, Facts
from .grid import HORIZON_SHARES, Boundary, IsotropicGrid, half_vector_factor
from .normal_vector_grid import MAX_RESOLUTION, lookup_constants
from .parameterization import (
    LogWarp,
    Parameterization,
    Shape,
    half_basis_coordinates,
    largest_chord_d,
    phi_nodes,
    theta_nodes,
)

# Along one axis: there are up to four times as many elevations of h as of a viewer.
MAX_SAMPLES = 4 * MAX_RESOLUTION
# At theta_h = 0 and theta_d = 0 themselves no phi_d is left; the samples there are taken this chord beside.
_POLE_CHORD = 1e-9
# In the shader's words, by `cosine_power`.
_BASES = "half", "half cosine", "half squared"
COSINE_POWERS = 0, 1, 2


@dataclass(frozen=True)
class HalfVectorGrid(IsotropicGrid):
    """Axes [theta_d, theta_h, phi_d].

    Parameters
    ----------
    sizes : samples of theta_d, theta_h and phi_d
    parameterization : of every axis; "squared" of theta_h, with the others uniform
    alphas : Bezier shapes of theta_d, theta_h and phi_d, in [0, 1]
    warps : their fitted warps
    reciprocal : phi_d ends at pi / 2
    horizon_share : samples at the horizon are taken at this share of their neighbour's cosine, of h and of its distance
        from the horizon
    cosine_power : p of the stored f cos theta_d^p cos theta_h, 1 or 2; at 0, as in older bundles, f itself is stored
    """

    sizes: tuple[int, int, int]
    parameterization: Parameterization = "fitted"
    alphas: tuple[float, float, float] = (0.5, 0.5, 0.5)
    warps: tuple[LogWarp, LogWarp, LogWarp] = (LogWarp(), LogWarp(), LogWarp())
    reciprocal: bool = True
    horizon_share: float = HORIZON_SHARES[0]
    cosine_power: int = 0
    basis: ClassVar[str] = "half"
    boundaries: ClassVar[tuple[Boundary, ...]] = ("pole", "pole", "mirrored")

    @property
    def shape(self) -> tuple[int, int, int]:
        """(theta_d, theta_h, phi_d) sizes."""
        return self.sizes

    @property
    def kinds(self) -> tuple[str, str, str]:
        """Parameterisation of each axis."""
        if self.parameterization == "squared":
            return "uniform", "squared", "uniform"
        return (self.parameterization,) * 3

    @property
    def axis_shapes(self) -> tuple[Shape, Shape, Shape]:
        """Shapes of each axis."""
        return self.warps if self.parameterization == "fitted" else self.alphas

    def unit_coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Coordinates (u_d, u_h, u_phi) in [0, 1], in numpy or nodes; they do not depend on the sizes."""
        return half_basis_coordinates(xp, wi, wo, self.kinds, self.axis_shapes, self.reciprocal)

    def coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Fractional sample indices (theta_d, theta_h, phi_d) of direction pairs."""
        units = self.unit_coordinates(xp, wi, wo)
        u_d, u_h, u_phi = (u * (n - 1) for u, n in zip(units, self.sizes, strict=True))
        return u_d, u_h, u_phi

    def directions(self, *index: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), at whole indices that broadcast; h lies in the x-z plane."""
        i_d, i_h, i_phi = index
        share, v_h = self._elevations(0)[i_d], self._elevations(1)[i_h]
        cos_phi, sin_phi = (a[i_phi] for a in self._azimuths())
        cos_h, sin_h = (1 - v_h) * (1 + v_h), v_h * np.sqrt(2 - v_h * v_h)
        v_d = share * largest_chord_d(xp_numpy, cos_h, sin_h * np.abs(cos_phi))
        cos_d, sin_d = (1 - v_d) * (1 + v_d), v_d * np.sqrt(2 - v_d * v_d)
        x, y = sin_d * cos_phi, sin_d * sin_phi
        wi = np.stack(np.broadcast_arrays(cos_h * x + sin_h * cos_d, y, cos_h * cos_d - sin_h * x), -1)
        wo = np.stack(np.broadcast_arrays(sin_h * cos_d - cos_h * x, -y, cos_h * cos_d + sin_h * x), -1)
        return wi, wo

    def factor(self, xp: Any, wi: Any, wo: Any) -> Any:
        """1 for what is stored as it is, else `half_vector_factor`."""
        return half_vector_factor(xp, wi, wo, self.cosine_power) if self.cosine_power else 1.0

    def sample_factor(self, wi: Array, wo: Array, *index: Array) -> Any:
        """The same: no sample stands for a pair below the horizon."""
        return self.factor(xp_numpy, wi, wo)

    def _elevations(self, axis: int) -> Array:
        v = theta_nodes(self.kinds[axis], self.sizes[axis], self.axis_shapes[axis])
        return np.clip(v, _POLE_CHORD, np.sqrt(1 - self.horizon_share * (1 - v[1] ** 2)))

    def _azimuths(self) -> tuple[Array, Array]:
        kind, n, shape = self.kinds[2], self.sizes[2], self.axis_shapes[2]
        if not self.reciprocal:
            return phi_nodes(kind, n, shape)
        v = theta_nodes(kind, n, shape)
        return (1 - v) * (1 + v), v * np.sqrt(2 - v * v)

    def facts(self) -> Facts:
        """JSON-ready description."""
        shapes: dict[str, Any] = {"alphas": list(self.alphas)} if self.parameterization == "bezier" else {}
        if self.parameterization == "fitted":
            shapes = {"warps": [[warp.near, warp.far] for warp in self.warps]}
        return {
            "basis": "half",
            "sizes": list(self.sizes),
            "parameterization": self.parameterization,
            **shapes,
            "reciprocal": self.reciprocal,
            "horizon_share": self.horizon_share,
            **({"cosine_power": self.cosine_power} if self.cosine_power else {}),
        }

    def shader_constants(self) -> Mapping[str, Any]:
        """Constants of each axis its own shape; each power of the cosine is a basis of its own."""
        return lookup_constants(
            _BASES[self.cosine_power], self.parameterization, self.sizes, self.axis_shapes, self.reciprocal
        )
