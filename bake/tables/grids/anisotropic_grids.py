"""Where the samples of a four-dimensional table lie, in the normal-vector and in the half-vector basis.

Both have the axes [azimuth a, polar angle b, row r, column c]. The azimuth is periodic, the last sample of the
polar angle is the pole, and (r, c) is a slice that a texture filter reads; a and b choose the slice.

normal  a phi_o, b theta_o, r theta_i, c phi_delta (Mallett & Yuksel 2016, section 4.1; they take phi_i for a, here the
        viewer is known first). phi_o is even. phi_delta takes the full circle, since an anisotropic material is not its
        own mirror image: the odd warp of [0, pi] serves both sides.
half    The half vector h by its slopes (x, y) = h_xy / h_z, each warped by u = x / (width + |x|): r is y, c is x. What
        brushing draws out is a ridge along one axis, and each axis has a width of its own; a polar theta_h, phi_h would
        have to resolve the ridge's angle (trial: `./run bench anisotropic`). There is no pole to treat, and no half
        vector is stored twice. The difference vector d is wi, turned by the shortest arc that takes h to the normal:
        a phi_d, b theta_d. Rusinkiewicz' frame spins at h = n, this one does not. Stored is f cos^2 theta_d cos
        theta_h. f of any microfacet grows at grazing as one over cos theta_d cos theta_h = (cos theta_i + cos theta_o)
        / 2, that of Ashikhmin and Shirley (2000) by one more cos theta_d; interpolated along theta_d, a line towards 0
        is met far better than what has just stopped to grow (RMS at equal texels 0.2 to 1.1 of it, light at 88 degrees
        within 3 %, where the power 1 lost up to 13 %).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ... import xp_numpy
from ...source import Array, Facts
from .grid import HORIZON_SHARES, LEAST_SUM, Boundary, Grid, around_mean, half_vector_factor, settle
from .parameterization import LogWarp, chord_to_theta, forward, phi_nodes, shape_constants, theta_nodes

_POLE_CHORD = 1e-5
# In x, so that a viewer at the pole has an azimuth: as float32 it changes no other, and its square is no denormal.
_NO_AZIMUTH = 1e-12
# Pairs of which one lies below the horizon hold the value at this share of the way to it.
_WITHIN = 0.98

# Of the normal basis. "squared" is a spacing of theta_h.
NORMAL_KINDS = ("identity", "uniform", "bezier", "fitted")

Shape = tuple[int, int, int, int]
Coordinates = tuple[Any, Any, Any, Any]


@dataclass(frozen=True)
class AnisotropicNormalGrid:
    """Axes [phi_o, theta_o, theta_i, phi_delta].

    Parameters
    ----------
    shape : samples of each; the columns even
    alpha_theta, alpha_phi : Bezier shapes of both elevations, and of phi_delta
    folded : phi_o runs over half a turn; the source looks the same after half a turn about the normal
    parameterization : of the elevations and of phi_delta; phi_o is even (Mallett & Yuksel 2016, section 4.1, take
        phi_i, but here the viewer is known first)
    warps : their fitted warps
    horizon_share : the sample at the horizon is taken at this share of its neighbour's cosine
    """

    shape: Shape
    alpha_theta: float = 0.5
    alpha_phi: float = 0.5
    folded: bool = False
    parameterization: str = "bezier"
    warps: tuple[LogWarp, LogWarp] = (LogWarp(), LogWarp())
    horizon_share: float = HORIZON_SHARES[0]
    basis: ClassVar[str] = "normal"
    boundaries: ClassVar[tuple[Boundary, ...]] = ("around", "pole", "pole", "around")

    @property
    def axis_shapes(self) -> tuple[Any, Any]:
        """Shapes of the elevations and of phi_delta, as `parameterization.forward` takes them."""
        return self.warps if self.parameterization == "fitted" else (self.alpha_theta, self.alpha_phi)

    def coordinates(self, xp: Any, wi: Any, wo: Any) -> Coordinates:
        """Fractional indices (a, b, r, c) of direction pairs; `xp` is the namespace."""
        n_a, n_b, n_r, n_c = self.shape
        kind, (theta, phi) = self.parameterization, self.axis_shapes
        normal = xp.vec(0.0, 0.0, 1.0)
        u_o = forward(xp, kind, _chord(xp, wo, normal), theta)
        u_i = forward(xp, kind, _chord(xp, wi, normal), theta)
        xi, yi, _ = xp.components(wi)
        xo, yo, _ = xp.components(wo)
        # Seen from the normal itself phi_o may be any, but phi_delta counts from it.
        xo = xo + _NO_AZIMUTH
        ti, to = xp.normalize(xp.vec(xi, yi, 0.0)), xp.normalize(xp.vec(xo, yo, 0.0))
        near, far = xp.length(ti - to), xp.length(ti + to)
        s = forward(xp, kind, xp.minimum(xp.minimum(near, far) * (1 / np.sqrt(2)), 1.0), phi)
        # From 0 at phi_delta = 0 to 1 at pi, and on to 2 on the other side.
        turn = xp.where(near > far, 0.5 + 0.5 * s, 0.5 - 0.5 * s)
        turn = xp.where(xo * yi < xi * yo, 2 - turn, turn)
        return azimuth_index(xp, xo, yo, n_a, self.folded), u_o * (n_b - 1), u_i * (n_r - 1), turn * (n_c // 2)

    def directions(self, *index: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), at whole indices that broadcast."""
        a, b, r, c = index
        n_a, n_b, n_r, _ = self.shape
        cos_phi, sin_phi = (w[::-1] for w in self.phi_delta())
        cos_phi = np.concatenate([cos_phi, cos_phi[-2:0:-1]])
        sin_phi = np.concatenate([sin_phi, -sin_phi[-2:0:-1]])
        phi = node_azimuth(a, n_a, self.folded)
        cosine, sine = np.cos(phi), np.sin(phi)
        wo = _polar(self._chords(n_b)[b], cosine, sine)
        turned = _polar(self._chords(n_r)[r], cos_phi[c], sin_phi[c])
        x, y, z = (turned[..., k] for k in range(3))
        wi = np.stack(np.broadcast_arrays(cosine * x - sine * y, sine * x + cosine * y, z), -1)
        return wi, np.broadcast_to(wo, wi.shape)

    def factor(self, xp: Any, wi: Any, wo: Any) -> Any:
        """The BRDF itself is stored."""
        return 1.0

    def sample_factor(self, wi: Array, wo: Array, *index: Array) -> float:
        """No sample stands for a pair below the horizon."""
        return 1.0

    def settle_poles(self, values: Array) -> None:
        """At theta_i = 0 phi_delta means nothing; at theta_o = 0 the light's own azimuth phi_o + phi_delta counts."""
        cosine, sine = self.phi_delta()
        steps = np.abs(np.diff(np.arctan2(sine, cosine)))[::-1] / np.pi
        around = np.concatenate([steps, steps[::-1]])
        settle(values, 2, 0.25 * (around + np.roll(around, 1)))

    def beyond_pole(self, before: Array, axis: int) -> Array:
        """Of theta_i see `around_mean`; on the other side of theta_o = 0 both azimuths are half a turn further."""
        if axis == 2:
            return around_mean(before, -2)
        beyond = np.roll(before, self.shape[3] // 2, axis=3)
        return beyond if self.folded else np.roll(beyond, self.shape[0] // 2, axis=0)

    def phi_delta(self) -> tuple[Array, Array]:
        """Cosine and sine of the samples from pi to 0, one more than half of the columns."""
        return phi_nodes(self.parameterization, self.shape[3] // 2 + 1, self.axis_shapes[1])

    def _chords(self, n: int) -> Array:
        v = theta_nodes(self.parameterization, n, self.axis_shapes[0])
        return np.clip(v, _POLE_CHORD, np.sqrt(1 - self.horizon_share * (1 - v[1] ** 2)))

    def facts(self) -> Facts:
        """JSON-ready description."""
        shapes: dict[str, Any] = {}
        if self.parameterization == "bezier":
            shapes = {"alpha_theta": self.alpha_theta, "alpha_phi": self.alpha_phi}
        elif self.parameterization == "fitted":
            shapes = {"warps": [[warp.near, warp.far] for warp in self.warps]}
        return {
            "basis": "normal",
            "shape": list(self.shape),
            "parameterization": self.parameterization,
            **shapes,
            "folded": self.folded,
            "horizon_share": self.horizon_share,
        }

    def shader_constants(self) -> Mapping[str, Any]:
        """Both elevations share a shape."""
        theta, phi = self.axis_shapes
        shapes = {"ShapeSlice": theta, "ShapeRow": theta, "ShapePhi": phi}
        return _shader_constants(self, self.folded, shapes)


@dataclass(frozen=True)
class AnisotropicHalfGrid:
    """Axes [phi_d, theta_d, slope y, slope x].

    Parameters
    ----------
    shape : samples of each
    width_x, width_y : slopes at half of the way from the middle to the edge
    folded : phi_d runs over half a turn; the source is reciprocal
    horizon_share : the outermost samples of theta_d and of the slopes, which would be at 90 degrees, are taken at this
        share of their neighbours' distance from it
    cosine_power : p of the stored f cos theta_d^p cos theta_h; 1 in older bundles
    falling : beyond the horizon the stored value falls on with cos theta_d from the last pair above it, instead of
        being held there; with the power 2
    """

    shape: Shape
    width_x: float = 0.3
    width_y: float = 0.3
    folded: bool = True
    horizon_share: float = HORIZON_SHARES[0]
    cosine_power: int = 2
    falling: bool = True
    basis: ClassVar[str] = "half"
    parameterization: ClassVar[str] = "slopes"
    boundaries: ClassVar[tuple[Boundary, ...]] = ("around", "pole", "held", "held")

    @property
    def axis_shapes(self) -> tuple[float, float]:
        """Shapes of the slopes along x and y."""
        return self.width_x, self.width_y

    def coordinates(self, xp: Any, wi: Any, wo: Any) -> Coordinates:
        """Fractional indices (a, b, r, c) of direction pairs above the horizon; `xp` is the namespace."""
        n_a, n_b, n_r, n_c = self.shape
        total = wi + wo
        xs, ys, zs = xp.components(total)
        zs = xp.maximum(zs, 2 * LEAST_SUM)
        half = xp.normalize(xp.vec(xs, ys, zs))
        hx, hy, hz = xp.components(half)
        xi, yi, zi = xp.components(wi)
        lift = xp.divide(xp.dot(wi, half) + zi, 1 + hz)
        dx, dy = xi - hx * lift, yi - hy * lift
        chord = xp.minimum(xp.length(wi - half) * (1 / np.sqrt(2)), 1.0)
        return (
            azimuth_index(xp, dx, dy, n_a, self.folded),
            (1 - chord) * (n_b - 1),
            _slope_index(xp, xp.divide(ys, zs), self.width_y, n_r),
            _slope_index(xp, xp.divide(xs, zs), self.width_x, n_c),
        )

    def directions(self, *index: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), at whole indices that broadcast; both above the horizon."""
        n_a, _, n_r, n_c = self.shape
        a, b, r, c = np.broadcast_arrays(*index)
        x, y = self._slopes(n_c, self.width_x)[c], self._slopes(n_r, self.width_y)[r]
        h = np.stack([x, y, np.ones_like(x)], -1)
        h /= np.linalg.norm(h, axis=-1, keepdims=True)
        phi = node_azimuth(a, n_a, self.folded)
        e = np.stack([np.cos(phi), np.sin(phi)], -1)
        towards = (e * h[..., :2]).sum(-1)
        # wi_z and wo_z are cos theta_d h_z -+ sin theta_d (e . h).
        highest = np.arctan2(_WITHIN * h[..., 2], np.abs(towards))
        theta = np.minimum(chord_to_theta(xp_numpy, self._chords())[b], highest)
        d = np.concatenate([np.sin(theta)[..., None] * e, np.cos(theta)[..., None]], -1)
        middle = h + np.array([0.0, 0.0, 1.0])
        wi = d - (d * middle).sum(-1, keepdims=True) / middle[..., 2:] * middle + 2 * d[..., 2:] * h
        return wi, 2 * d[..., 2:] * h - wi

    def factor(self, xp: Any, wi: Any, wo: Any) -> Any:
        """What values are multiplied by to be stored; see `half_vector_factor`."""
        return half_vector_factor(xp, wi, wo, self.cosine_power)

    def sample_factor(self, wi: Array, wo: Array, *index: Array) -> Any:
        """Where `falling`, f cos theta_d cos theta_h is held beyond the horizon, and times the sample's cos theta_d."""
        if self.cosine_power == 1 or not self.falling:
            return self.factor(xp_numpy, wi, wo)
        lowest = half_vector_factor(xp_numpy, wi, wo, 1)
        chord = self._chords()[index[1]]
        return lowest * np.maximum((1 - chord) * (1 + chord), LEAST_SUM)

    def _chords(self) -> Array:
        """Chords of theta_d at the samples, (B,)."""
        n = self.shape[1]
        return np.clip(1 - np.arange(n) / (n - 1), _POLE_CHORD, 1 - self.horizon_share / (n - 1))

    def settle_poles(self, values: Array) -> None:
        """At theta_d = 0 light and viewer are one direction, and phi_d means nothing."""
        values[:, -1] = values[:, -1].mean(0)

    def beyond_pole(self, before: Array, axis: int) -> Array:
        """See `around_mean`; the azimuth is phi_d."""
        return around_mean(before, 0)

    def _slopes(self, n: int, width: float) -> Array:
        """Slopes (n,) of the samples; the last ones, which would be infinite, short of it as elevations at horizons."""
        u = np.linspace(-1, 1, n)
        most = 1 - 2 * self.horizon_share / (n - 1)
        return np.asarray(slope_unwarp(xp_numpy, np.clip(u, -most, most), width))

    def facts(self) -> Facts:
        """JSON-ready description."""
        return {
            "basis": "half",
            "shape": list(self.shape),
            "width_x": self.width_x,
            "width_y": self.width_y,
            "folded": self.folded,
            "horizon_share": self.horizon_share,
            "cosine_power": self.cosine_power,
            "falling": self.falling,
        }

    def shader_constants(self) -> Mapping[str, Any]:
        """Shapes are the widths of the slopes; either power of the cosine is a basis of its own."""
        width_x, width_y = self.axis_shapes
        constants = _shader_constants(self, self.folded, {"ShapeRow": width_y, "ShapePhi": width_x})
        return constants if self.cosine_power == 1 else {**constants, "Basis": "half squared"}


def _shader_constants(grid: Grid, folded: bool, shapes: dict[str, Any]) -> Mapping[str, Any]:
    return {
        "Basis": grid.basis,
        **dict(zip(("Azimuths", "Slices", "SliceRows", "SliceColumns"), grid.shape, strict=True)),
        "Parameterization": grid.parameterization,
        "Reciprocal": 0,
        "Folded": int(folded),
        **{name: shape_constants(shape) for name, shape in shapes.items()},
    }


def azimuth_index(xp: Any, x: Any, y: Any, n: int, folded: bool) -> Any:
    """Fractional index in [0, n] of the azimuth of (x, y), counted over half a turn if folded."""
    turns = xp.arctan2(y, x) * ((1 if folded else 0.5) / np.pi)
    return xp.where(turns < 0, turns + 1, turns) * n


def node_azimuth(a: Array, n: int, folded: bool) -> Array:
    """Azimuth in radians of whole indices."""
    return np.asarray(a) * ((1 if folded else 2) * np.pi / n)


def slope_warp(xp: Any, x: Any, width: Any) -> Any:
    """u in (-1, 1) of a slope, odd: half of the way at the width."""
    return xp.divide(x, width + xp.maximum(x, -x))


def slope_unwarp(xp: Any, u: Any, width: Any) -> Any:
    """Slope of u in (-1, 1)."""
    return xp.divide(width * u, 1 - xp.maximum(u, -u))


def _slope_index(xp: Any, slope: Any, width: float, n: int) -> Any:
    return (0.5 + 0.5 * slope_warp(xp, slope, width)) * (n - 1)


def _chord(xp: Any, w: Any, normal: Any) -> Any:
    return xp.minimum(xp.length(w - normal) * (1 / np.sqrt(2)), 1.0)


def _polar(v: Array, cos_phi: Array, sin_phi: Array) -> Array:
    """Unit vectors from the chord of the polar angle and the azimuth."""
    sine = v * np.sqrt(2 - v * v)
    return np.stack(np.broadcast_arrays(sine * cos_phi, sine * sin_phi, (1 - v) * (1 + v)), -1)
