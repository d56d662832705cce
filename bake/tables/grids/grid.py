"""What a grid of samples is, whatever its basis and its number of axes: all that a table has to know of it.

A table of an isotropic material has one slice axis and one of an anisotropic material two; the last two axes of
either, rows and columns, are those of a slice, which a texture filter reads. So isotropic is a shape, not a type.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from ...source import Array, Facts

# What lies beyond the two ends of an axis.
#   "around"    the azimuth goes on from its first sample
#   "mirrored"  an azimuth that ends where the material is its own mirror image: the derivative vanishes there
#   "pole"      before the first sample, the horizon, nothing: it is held; after the last one `Grid.beyond_pole`
#   "held"      nothing at either end
Boundary = Literal["around", "mirrored", "pole", "held"]

# The sample at a horizon is taken short of it, at one of these shares of its neighbour's cosine. There a BRDF may grow
# without bound (as 1 / (cos cos) in the mirror direction) and measurements have ended. Taken at 1e-3 instead, the one
# cell beside the horizon dominates the whole error (tried: 4 to 8 times the RMS on glossy paints). A BRDF that stays
# bounded is better served close to the horizon: baking measures both.
HORIZON_SHARES = (1 / 3, 1 / 50)

# Below this mean of both cosines, of pairs within a twentieth of a degree of the horizon, the stored value is held.
LEAST_SUM = 1e-3


class Grid(Protocol):
    """Where the samples of a table lie: a frozen, hashable dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def basis(self) -> str:
        """Either "normal" (Mallett & Yuksel 2016) or "half" (Rusinkiewicz 1998)."""
        ...

    @property
    def parameterization(self) -> str:
        """How samples are spaced along the axes."""
        ...

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples of each axis: one or two slice axes, then rows and columns."""
        ...

    @property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Of each axis; the last slice axis is a "pole", one before it is "around"."""
        ...

    @property
    def axis_shapes(self) -> tuple[Any, ...]:
        """What the spacing of the axes is computed from, as `parameterization.forward` or `slope_warp` take it."""
        ...

    @property
    def horizon_share(self) -> float:
        """The sample at a horizon is taken at this share of its neighbour's cosine; `HORIZON_SHARES` to choose from."""
        ...

    def coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, ...]:
        """Fractional indices along each axis of direction pairs; `xp` is the namespace, numpy's or the nodes'."""
        ...

    def directions(self, *index: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), at whole indices of each axis that broadcast."""
        ...

    def factor(self, xp: Any, wi: Any, wo: Any) -> Any:
        """What a BRDF is multiplied by to be stored."""
        ...

    def sample_factor(self, wi: Array, wo: Array, *index: Array) -> Any:
        """`factor` of samples at whole indices, whose `directions` are wi and wo.

        Another one where the sample stands for a pair that lies below the horizon, and its directions do not.
        """
        ...

    def settle_poles(self, values: Array) -> None:
        """Give all samples (*shape, 3) that are one direction pair one value, in place.

        Real measurements disagree with themselves at the pole (twofold in some RGL files); a table must not.
        """
        ...

    def beyond_pole(self, before: Array, axis: int) -> Array:
        """The samples that a cubic filter finds beyond the pole of an axis, from the last ones before it.

        Parameters
        ----------
        before : values of the table, of size 1 along that axis
        axis : counted from 0; its boundary is "pole"
        """
        ...

    def facts(self) -> Facts:
        """JSON-ready description."""
        ...

    def shader_constants(self) -> Mapping[str, Any]:
        """Parameters of the OSL lookup that say where samples lie."""
        ...


class IsotropicGrid(ABC):
    """What the grids of isotropic materials share, of axes [slice, row, azimuth]; a base of frozen dataclasses."""

    # As in `Grid`, but not as properties, which the dataclasses would take for defaults of their fields.
    basis: ClassVar[str]
    parameterization: str

    @abstractmethod
    def unit_coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Coordinates of slices, rows and columns in [0, 1], in numpy or nodes."""

    @abstractmethod
    def _azimuths(self) -> tuple[Array, Array]:
        """Cosine and sine at the samples of the azimuth, (C,) each."""

    def factor(self, xp: Any, wi: Any, wo: Any) -> float:
        """The BRDF itself is stored."""
        return 1.0

    def sample_factor(self, wi: Array, wo: Array, *index: Array) -> float:
        """No sample stands for a pair below the horizon."""
        return 1.0

    def settle_poles(self, values: Array) -> None:
        """Where slices or rows end at a pole the azimuth means nothing to an isotropic material."""
        cosine, sine = self._azimuths()
        weights = azimuth_weights(np.arctan2(sine, cosine))
        settle(values, 1, weights)
        settle(values, 0, weights)

    def beyond_pole(self, before: Array, axis: int) -> Array:
        """See `around_mean`."""
        return around_mean(before, -2)


def half_vector_factor(xp: Any, wi: Any, wo: Any, cosine_power: int) -> Any:
    """cos theta_d^p cos theta_h, the power p 1 or 2: what f is multiplied by to be stored by half vectors.

    |wi + wo| / 2 is cos theta_d, its z times cos theta_h; the latter at least `LEAST_SUM`. `xp` is the namespace.
    """
    lowest = xp.maximum(0.5 * (xp.components(wi)[2] + xp.components(wo)[2]), LEAST_SUM)
    return lowest if cosine_power == 1 else lowest * xp.maximum(0.5 * xp.length(wi + wo), LEAST_SUM)


def around_mean(before: Array, azimuth: int) -> Array:
    """2 mean - samples, at least 0, the mean along an axis that is the azimuth about the pole.

    Going on down the other side, at pi - phi_delta, would be smoothest along each line, but leaves the normal itself
    a different value from every azimuth: a star in the picture. With 2 mean - samples all azimuths meet in one value,
    unless the samples vary so much that 0 stands in for a negative one; where they are a constant plus a cosine of the
    azimuth both are the same.
    """
    return np.maximum(2 * before.mean(azimuth, keepdims=True) - before, 0)


def azimuth_weights(phi: Array) -> Array:
    """Weights (n,) of the mean over samples at these azimuths, end to end, by the trapezoid rule: they may crowd."""
    step = np.diff(phi) / (phi[-1] - phi[0])
    return 0.5 * (np.append(step, 0) + np.insert(step, 0, 0))


def settle(values: Array, axis: int, weights: Array) -> None:
    """Hold the last samples along an axis at their mean over the columns, in place; `weights` (columns,) sum to 1."""
    last = np.moveaxis(values, axis, 0)[-1]
    last[...] = np.einsum("...px,p->...x", last, weights)[..., None, :]
