"""Where the samples of an isotropic table in the normal-vector basis lie (Mallett & Yuksel 2016, section 4).

Axes are [theta_o, theta_i, phi_delta, rgb] of sizes N, N, 2N. Sample 0 of an elevation lies at the horizon and the last
at the normal; sample 0 of the azimuth lies at pi and the last at 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...source import Array, Facts
from .grid import HORIZON_SHARES, Boundary, IsotropicGrid
from .parameterization import (
    LogWarp,
    Parameterization,
    Shape,
    normal_basis_coordinates,
    phi_nodes,
    shape_constants,
    theta_nodes,
)

MAX_RESOLUTION = 256
# At the pole itself no azimuth is left: the mean over the azimuth is taken at this chord beside it.
_POLE_CHORD = 1e-5


@dataclass(frozen=True)
class NormalVectorGrid(IsotropicGrid):
    """Axes [theta_o, theta_i, phi_delta].

    Parameters
    ----------
    n : samples per elevation; the azimuth has 2 n
    parameterization : of every axis
    alpha_theta, alpha_phi : Bezier shape of the elevations and the azimuth, in [0, 1]; unused by the others
    horizon_share : the sample at the horizon is taken at this share of its neighbour's cosine
    warps : fitted warps of the elevations and the azimuth; unused by the others
    """

    n: int
    parameterization: Parameterization
    alpha_theta: float = 0.5
    alpha_phi: float = 0.5
    horizon_share: float = HORIZON_SHARES[0]
    warps: tuple[LogWarp, LogWarp] = (LogWarp(), LogWarp())
    basis: ClassVar[str] = "normal"
    boundaries: ClassVar[tuple[Boundary, ...]] = ("pole", "pole", "mirrored")

    @property
    def axis_shapes(self) -> tuple[Shape, Shape]:
        """Shapes of the elevations and the azimuth."""
        return self.warps if self.parameterization == "fitted" else (self.alpha_theta, self.alpha_phi)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(theta_o, theta_i, phi_delta) sizes."""
        return self.n, self.n, 2 * self.n

    def unit_coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Coordinates (u_o, u_i, u_phi) in [0, 1], in numpy or nodes; they do not depend on the sizes."""
        return normal_basis_coordinates(xp, wi, wo, self.parameterization, *self.axis_shapes)

    def coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Fractional sample indices (theta_o, theta_i, phi_delta) of direction pairs."""
        u_o, u_i, u_phi = self.unit_coordinates(xp, wi, wo)
        n = self.n
        return u_o * (n - 1), u_i * (n - 1), u_phi * (2 * n - 1)

    def directions(self, *index: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), at whole indices that broadcast; wo lies in the x-z plane."""
        i_o, i_i, i_phi = np.broadcast_arrays(*index)
        v = theta_nodes(self.parameterization, self.n, self.axis_shapes[0])
        v = np.clip(v, _POLE_CHORD, np.sqrt(1 - self.horizon_share * (1 - v[1] ** 2)))
        cosine, sine = (1 - v) * (1 + v), v * np.sqrt(2 - v * v)
        cos_phi, sin_phi = self._azimuths()
        wi = np.stack([sine[i_i] * cos_phi[i_phi], sine[i_i] * sin_phi[i_phi], cosine[i_i]], -1)
        wo = np.stack([sine[i_o], np.zeros_like(sine[i_o]), cosine[i_o]], -1)
        return wi, wo

    def _azimuths(self) -> tuple[Array, Array]:
        return phi_nodes(self.parameterization, 2 * self.n, self.axis_shapes[1])

    def facts(self) -> Facts:
        """JSON-ready description."""
        return {
            "basis": "normal",
            "n": self.n,
            "parameterization": self.parameterization,
            "alpha_theta": self.alpha_theta,
            "alpha_phi": self.alpha_phi,
            "horizon_share": self.horizon_share,
            **({"warps": [[w.near, w.far] for w in self.warps]} if self.parameterization == "fitted" else {}),
        }

    def shader_constants(self) -> Mapping[str, Any]:
        """Both elevations share a shape."""
        theta, phi = self.axis_shapes
        return lookup_constants(self.basis, self.parameterization, self.shape, (theta, theta, phi), False)


def lookup_constants(
    basis: str, parameterization: str, shape: tuple[int, int, int], axis_shapes: tuple[Shape, ...], reciprocal: bool
) -> dict[str, Any]:
    """Parameters of the OSL lookup of an isotropic grid of either basis."""
    shapes = zip(("ShapeSlice", "ShapeRow", "ShapePhi"), axis_shapes, strict=True)
    return {
        "Basis": basis,
        "Azimuths": 0,
        **dict(zip(("Slices", "SliceRows", "SliceColumns"), shape, strict=True)),
        "Parameterization": parameterization,
        "Reciprocal": int(reciprocal),
        "Folded": 0,
        **{name: shape_constants(one) for name, one in shapes},
    }
