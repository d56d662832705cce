"""Directions in polar coordinates around the mirror direction, as optical design programs store them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...directions import polar_angle
from ...source import Array
from ..lookup.lookup_source import Axis, LookupSource, interpolate, negative_facts
from ..lookup.text_file import TextFile

_BELOW = 1e-9


def around_specular(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    """(radial, azimuth) of wo around the mirror direction of wi, and phi_i; each (n,), radians.

    The radial angle is that to the mirror direction. Its azimuth is 0 from there towards the surface normal and grows
    counter-clockwise seen against the mirrored ray (Zemax, "Tabular BSDF data file format"; the same sense as libbsdf's
    turn about y), in (-pi, pi]. Light along the normal takes azimuth 0 of the surface.
    """
    sin_i = np.hypot(wi[:, 0], wi[:, 1])
    upright = sin_i < 1e-12
    safe = np.where(upright, 1.0, sin_i)
    cos_phi, sin_phi = np.where(upright, 1.0, wi[:, 0] / safe), np.where(upright, 0.0, wi[:, 1] / safe)
    x = cos_phi * wo[:, 0] + sin_phi * wo[:, 1]
    y = cos_phi * wo[:, 1] - sin_phi * wo[:, 0]
    along = wi[:, 2] * x + sin_i * wo[:, 2]
    forward = wi[:, 2] * wo[:, 2] - sin_i * x
    return np.arctan2(np.hypot(along, y), forward), np.arctan2(y, along), np.arctan2(sin_phi, cos_phi)


def direction_around(theta_i: Array, radial: Array, azimuth: Array) -> Array:
    """Outgoing directions (..., 3) at these angles around the mirror direction of light at (theta_i, phi 0)."""
    sin_r, cos_r = np.sin(radial), np.cos(radial)
    along, forward = sin_r * np.cos(azimuth), cos_r
    sin_i, cos_i = np.sin(theta_i), np.cos(theta_i)
    return np.stack(
        np.broadcast_arrays(cos_i * along - sin_i * forward, sin_r * np.sin(azimuth), sin_i * along + cos_i * forward),
        -1,
    )


class SpecularGrid:
    """A table [rotation, incidence, azimuth, radial, channel] around the mirror direction, as a lookup.

    Entries below the horizon, which files pad with 0, take the value of the last radial angle above it on their line,
    so that none of the padding is averaged in.

    Parameters
    ----------
    rotations, incidences, azimuths, radials : nodes in radians; azimuths within [0, 2 pi], or [0, pi] if `mirrored`
    table : (R, I, A, P, 3)
    mirrored : azimuths of the other side are those of this one
    """

    def __init__(
        self, rotations: Array, incidences: Array, azimuths: Array, radials: Array, table: Array, mirrored: bool
    ) -> None:
        self.mirrored, self.isotropic = mirrored, rotations.size == 1
        turn = 2 * np.pi
        rotations, table = _open_circle(rotations, table, 0)
        if not mirrored:
            azimuths, table = _open_circle(azimuths, table, 2)
        self._axes = (
            Axis(rotations, 0.0 if self.isotropic else turn),
            Axis(incidences),
            Axis(azimuths, 0.0 if mirrored else turn),
            Axis(radials),
        )
        low = direction_around(incidences[:, None, None], radials, azimuths[:, None])[..., 2] <= _BELOW
        self.padded_share = float(low.mean())
        self._table = _held(table, low)

    def __call__(self, wi: Array, wo: Array) -> Array:
        """(n, 3) values of direction pairs."""
        radial, azimuth, phi_i = around_specular(wi, wo)
        azimuth = np.abs(azimuth) if self.mirrored else azimuth
        return interpolate(self._axes, self._table, phi_i, polar_angle(wi), azimuth, radial)

    def source(self, file: TextFile, facts: dict[str, Any]) -> LookupSource:
        """The grid as a source, with what is known of it."""
        rotation, incidence, azimuth, radial = (axis.nodes.size for axis in self._axes)
        facts |= {
            "entries": [rotation, incidence, azimuth, radial],
            "interpolation": "linear around the mirror direction; held beyond the angles of the light",
            "largest_measured_theta_deg": float(np.degrees(self._axes[1].nodes[-1])),
            "below_horizon_share": self.padded_share,
            **negative_facts(self._table),
        }
        return LookupSource(file.path.stem, self, facts, self.isotropic, self.isotropic and self.mirrored)


def _open_circle(nodes: Array, table: Array, axis: int) -> tuple[Array, Array]:
    """Nodes of a circle without the last where it repeats the first; its values are then their mean."""
    if nodes.size < 2 or abs(nodes[-1] - nodes[0] - 2 * np.pi) > 1e-6:
        return nodes, table
    first, last = np.take(table, [0], axis), np.take(table, [-1], axis)
    middle = np.take(table, np.arange(1, nodes.size - 1), axis)
    return nodes[:-1], np.concatenate([(first + last) / 2, middle], axis)


def _held(table: Array, low: Array) -> Array:
    """The table with entries below the horizon, (I, A, P) bool, replaced by the last one above it on their line."""
    index = np.where(low, -1, np.arange(low.shape[-1]))
    last = np.maximum(np.maximum.accumulate(index, -1), 0)
    return np.take_along_axis(table, last[None, ..., None], 3)
