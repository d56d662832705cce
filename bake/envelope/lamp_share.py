"""The mirror's probability under one lamp: what share of the lamp's light the residual carries.

The share of all light at one viewer, which `texture.guarded_share` stores, is another than that of one direction: most
of a highlight may be residual where little of the rest is. The image (H, W, 3) float32 holds slices, one of each bin of
viewers. Red is the probability; green how much more light of that direction is reflected than of an even sky of the
same irradiance, pi f cos(theta_i) / albedo; blue is 0. Read it Non-Color, linear, extended.

Of an isotropic material n_o slices of theta_o lie side by side, in each sqrt(v) of the half vector to the right and
cos theta_d upwards, v and the slices even in sqrt(1 - cos) (`ShareLayout`). Of an anisotropic one slices of theta_o lie
side by side and those of phi_o above each other, in each the half vector's warped slopes (`SlopeShareLayout`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .. import xp_numpy
from ..errors import BakeError
from ..sampling.cell_sampler import Evaluates
from ..sampling.slope_cells import SlopeLayout
from ..source import Array
from ..tables.grids.anisotropic_grids import slope_unwarp
from .fitted import EnvelopeFit
from .texture import LEAST_SHARE, guarded_share
from .views import Directions, light_directions, slope_directions

# Of the usual probability, at least: the light of everything but the lamp is found by it too.
_LEAST_OF_USUAL = 0.25
_SUBSAMPLES, _AZIMUTHS = 6, 48
# Along each slope, where there are two of them and four viewers a slice.
_SLOPE_SUBSAMPLES = 3
_CHUNK = 1 << 17
_ALBEDO_H, _ALBEDO_PHI = 40, 20
_ALBEDO_SLOPES = 40, 36
_MOST_REFLECTED = 1e4
# Of the lamp's irradiance: what its surroundings throw back, and only the usual probability knows of.
_BOUNCED = 0.1

# wi and wo (N, 3), and their places (N,): column and row in nodes, and the slice.
_Placed = tuple[Array, Array, tuple[Array, Array, Array]]


class Shares(Protocol):
    """Where the image has what.

    Attributes
    ----------
    shape : slices, and rows and columns of each
    size : width and height in texels

    Methods
    -------
    viewers : chords and azimuths (slices,) of the middle of each slice
    lights : a quadrature of all light, of those viewers
    placed : directions that represent what lies around the nodes, and their places
    image : texels (H, W, 3), top row first, of (*shape, 3)
    """

    @property
    def shape(self) -> tuple[int, int, int]: ...
    @property
    def size(self) -> tuple[int, int]: ...
    def viewers(self) -> tuple[Array, Array]: ...
    def lights(self) -> Directions: ...
    def placed(self) -> _Placed: ...
    def image(self, channels: Array) -> Array: ...


@dataclass(frozen=True)
class ShareLayout:
    """Nodes in theta_h and theta_d, and slices in theta_o."""

    n_h: int = 16
    n_d: int = 16
    n_o: int = 8

    @property
    def shape(self) -> tuple[int, int, int]:
        """Slices, and rows and columns of each."""
        return self.n_o, self.n_d, self.n_h

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in texels."""
        return self.n_o * self.n_h, self.n_d

    def viewers(self) -> tuple[Array, Array]:
        """Chords of the slices' middles, and azimuths 0."""
        return (np.arange(self.n_o) + 0.5) / self.n_o, np.zeros(self.n_o)

    def lights(self) -> Directions:
        """Light on one side."""
        return light_directions(self.viewers()[0], _ALBEDO_H, _ALBEDO_PHI)

    def placed(self) -> _Placed:
        """Along theta_h and cos theta_d in nodes, and the slice of theta_o."""
        n_h, n_o = ((n * _SUBSAMPLES) for n in (self.n_h - 1, self.n_o))
        along = (np.arange(n_h) + 0.5) / n_h
        # Azimuths gather where theta_d changes slowest with them, at the ends.
        azimuth = 0.5 * np.pi * (1 - np.cos(np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS))
        grid = np.meshgrid(along, (np.arange(n_o) + 0.5) / n_o, azimuth, indexing="ij")
        s, chord, phi = (a.ravel() for a in grid)
        half, wo = _direction(s * s, phi), _direction(chord, np.zeros_like(chord))
        cos_d = (half * wo).sum(-1)
        wi = 2 * cos_d[:, None] * half - wo
        seen = (wi[:, 2] > 1e-3) & (cos_d > 0)
        places = s * (self.n_h - 1), cos_d * (self.n_d - 1), np.floor(chord * self.n_o)
        return wi[seen], wo[seen], (places[0][seen], places[1][seen], places[2][seen].astype(np.intp))

    def image(self, channels: Array) -> Array:
        """Slices side by side."""
        return channels[:, ::-1].transpose(1, 0, 2, 3).reshape(self.n_d, -1, 3)


LAYOUT = ShareLayout()


@dataclass(frozen=True)
class SlopeShareLayout:
    """Slices of theta_o and phi_o, and nodes in the half vector's warped slopes, as bins and cells of a sampler."""

    slopes: SlopeLayout = field(default_factory=lambda: SlopeLayout(8, 16, 16, 16))

    @classmethod
    def of(cls, sampler: SlopeLayout) -> SlopeShareLayout:
        """For the material of a sampler, whose cells are even where its highlights are."""
        n_phi = 8 if sampler.folded else 16
        return cls(SlopeLayout(8, n_phi, 16, 16, sampler.width_x, sampler.width_y, sampler.folded))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Slices, and rows and columns of each."""
        return self.slopes.bins, self.slopes.n_y, self.slopes.n_x

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in texels."""
        return self.slopes.n_theta * self.slopes.n_x, self.slopes.n_phi * self.slopes.n_y

    def viewers(self) -> tuple[Array, Array]:
        """Chords and azimuths of the slices' middles."""
        n_theta, n_phi = self.slopes.n_theta, self.slopes.n_phi
        azimuths = np.arange(n_phi) * ((1 if self.slopes.folded else 2) * np.pi / n_phi)
        return np.repeat((np.arange(n_theta) + 0.5) / n_theta, n_phi), np.tile(azimuths, n_theta)

    def lights(self) -> Directions:
        """Light on all sides."""
        widths = self.slopes.width_x, self.slopes.width_y
        return slope_directions(*self.viewers(), widths, _ALBEDO_SLOPES)

    def placed(self) -> _Placed:
        """Along both slopes in nodes, and the slice."""
        slopes, (slices, rows, columns) = self.slopes, self.shape
        along = [(np.arange(k := (n - 1) * _SLOPE_SUBSAMPLES) + 0.5) / k for n in (rows, columns)]
        v, u = (a.ravel() for a in np.meshgrid(*along, indexing="ij"))
        x, y = (
            np.asarray(slope_unwarp(xp_numpy, 2 * a - 1, width))
            for a, width in ((u, slopes.width_x), (v, slopes.width_y))
        )
        half = xp_numpy.normalize(np.stack([x, y, np.ones_like(x)], -1))
        viewers = slopes.viewers().reshape(-1, 3)
        cos_d = viewers @ half.T
        wi = 2 * cos_d[..., None] * half - viewers[:, None]
        seen = (wi[..., 2] > 1e-3) & (cos_d > 0)
        viewer, place = np.nonzero(seen)
        index = viewer // (len(viewers) // slices)
        return wi[seen], viewers[viewer], (u[place] * (columns - 1), v[place] * (rows - 1), index)

    def image(self, channels: Array) -> Array:
        """Slices of theta_o side by side, those of phi_o from below."""
        n_theta, n_phi = self.slopes.n_theta, self.slopes.n_phi
        slices = channels.reshape(n_theta, n_phi, *channels.shape[1:])[:, ::-1, ::-1]
        return slices.transpose(1, 2, 0, 3, 4).reshape(self.size[1], self.size[0], 3)

    def coordinates(self, xp: Any, wi: Any, wo: Any) -> tuple[Any, Any]:
        """Where to read the image, v upwards, for local unit vectors towards the lamp and the viewer."""
        slopes, (width, height) = self.slopes, self.size
        u, v, _ = slopes.warped(xp, wi, wo)
        row = slopes.bin_of(xp, wo)
        elevation = xp.floor((row + 0.5) * (1 / slopes.n_phi))
        azimuth = row - elevation * slopes.n_phi
        across = elevation * slopes.n_x + (0.5 + 0.5 * u) * (slopes.n_x - 1) + 0.5
        up = azimuth * slopes.n_y + (0.5 + 0.5 * v) * (slopes.n_y - 1) + 0.5
        return across * (1 / width), up * (1 / height)


def lamp_shares(fit: EnvelopeFit, residual: Evaluates, layout: Shares = LAYOUT) -> NDArray[np.float32]:
    """Image of the probability of least variance: P / (1 - P) = sqrt(<R^2> / <E^2>) around each node.

    E / (1 - P) or R / P has the second moment E^2 / (1 - P) + R^2 / P. Means of squares, not of values, give ridges of
    R that are narrower than a cell their due.
    """
    # R^2, E^2, R + E, and the weights of their means.
    sums = np.zeros((4, *layout.shape))
    wi, wo, place = layout.placed()
    for start in range(0, len(wi), _CHUNK):
        part = slice(start, start + _CHUNK)
        mirror, native = (_light(brdf, wi[part], wo[part]) for brdf in (residual, fit))
        for k, values in enumerate((mirror**2, native**2, mirror + native, np.ones_like(mirror))):
            _gather(sums[k], tuple(p[part] for p in place), values)
    mirror, native = np.sqrt(sums[:2])
    usual = fit.viewers.interpolated(guarded_share(fit), *layout.viewers())[:, None, None]
    found = np.where(mirror + native > 0, mirror / np.maximum(mirror + native, 1e-300), usual)
    found = np.clip(np.maximum(found, _LEAST_OF_USUAL * usual), LEAST_SHARE, 1 - LEAST_SHARE)
    albedo = _albedo(fit, residual, layout)
    reflected = np.pi * sums[2] / np.maximum(sums[3], 1e-300) / np.maximum(albedo, 1e-30)[:, None, None]
    channels = np.stack([found, np.minimum(reflected, _MOST_REFLECTED), np.zeros_like(found)], -1)
    return layout.image(channels).astype(np.float32)


def _albedo(fit: EnvelopeFit, residual: Evaluates, layout: Shares) -> Array:
    """Of both together, (slices,), summed over the channels."""
    towards, seen_from, areas = layout.lights()
    from_there = np.broadcast_to(seen_from, towards.shape)
    # Of area 0 is what lies below the horizon.
    return np.asarray(sum((_light(brdf, towards, from_there) * areas).sum(1) for brdf in (residual, fit)))


def _light(brdf: Evaluates, wi: Array, wo: Array) -> Array:
    """f cos(theta_i) (...), summed over the channels."""
    return np.asarray((brdf.evaluate(wi, wo) * wi[..., 2:]).sum(-1, dtype=np.float64))


def checked_shares(image: Array, where: str | Path = "residual_share", layout: Shares = LAYOUT) -> NDArray[np.float32]:
    """The image as read from an untrusted bundle. Raises BakeError."""
    texels = np.asarray(image, np.float32)
    if texels.shape != (*layout.size[::-1], 3):
        sizes = " x ".join(map(str, texels.shape))
        raise BakeError(where, f"is {sizes}, no table of shares", "bake it again")
    # Rounded, the limits may lie just outside.
    if not (np.abs(texels[..., 0] - 0.5) <= 0.5 - LEAST_SHARE + 1e-6).all():
        raise BakeError(where, "holds probabilities that would lose light", "bake it again")
    if not ((texels[..., 1] >= 0) & (texels[..., 1] <= _MOST_REFLECTED)).all():
        raise BakeError(where, "holds reflected light out of its limits", "bake it again")
    return texels


def share_coordinates(
    xp: Any, to_lamp: Any, incoming: Any, normal: Any, wo: Any, layout: ShareLayout = LAYOUT
) -> tuple[Any, Any]:
    """Texture coordinates (u, v) of the image of shares, v upwards.

    Parameters
    ----------
    to_lamp, incoming, normal : unit vectors, in one frame
    wo : `incoming` in the local frame
    """
    half = xp.normalize(to_lamp + incoming)
    along_h = xp.sqrt(xp.length(half - normal) * (1 / np.sqrt(2)))
    chord = xp.minimum(xp.length(wo - xp.vec(0.0, 0.0, 1.0)) * (1 / np.sqrt(2)), 1.0)
    # A little less than the number of slices, so that the horizon lies in the last.
    index = xp.floor(chord * (layout.n_o * 0.99999))
    width, n_d = layout.size
    u = index * (1 / layout.n_o) + along_h * ((layout.n_h - 1) / width) + 0.5 / width
    return u, xp.dot(half, to_lamp) * ((n_d - 1) / n_d) + 0.5 / n_d


def part_of_light(xp: Any, to_centre: Any, reflected: Any, strength: Any, lamps: Any, beside: Any) -> Any:
    """About what part of the light that is reflected comes from the lamp, 0 to 1: so far its share decides.

    Parameters
    ----------
    to_centre : to its middle
    reflected : the image's green
    strength : irradiance face to face at distance 1
    lamps : how many there are, each taken to be as bright as this one
    beside : irradiance of everything else
    """
    arriving = xp.divide(strength, xp.dot(to_centre, to_centre))
    light = arriving * reflected
    return xp.divide(light, light * lamps + arriving * _BOUNCED + beside)


def _direction(chord: Array, phi: Array) -> Array:
    """Unit vectors (N, 3) of sqrt(1 - cos theta) and azimuth."""
    sine = chord * np.sqrt(2 - chord**2)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), (1 - chord) * (1 + chord)], -1)


def _gather(sums: Array, place: tuple[Array, ...], values: Array) -> None:
    """Add values to (n_o, n_d, n_h) at the four nodes around each place, by their weights of linear interpolation."""
    h, d, o = place
    low = [np.minimum(np.floor(a).astype(np.intp), n - 2) for a, n in ((h, sums.shape[2]), (d, sums.shape[1]))]
    for i in (0, 1):
        for j in (0, 1):
            weight = np.abs(1 - i - (h - low[0])) * np.abs(1 - j - (d - low[1]))
            np.add.at(sums, (o, low[1] + j, low[0] + i), weight * values)
