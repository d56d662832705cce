"""What figures of a BRDF show, as numbers: slices in a plane, albedo, reciprocity, a picture by angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..brdf.preview_sphere import Reflects
from ..directions import normalize, spherical
from ..source import Array, BrdfSource, luminance
from ..sources.exchanged import Exchanged
from ..tables.albedo import directional_albedo

INCIDENCES = (0.0, 30.0, 45.0, 60.0, 75.0)
_ALBEDO_DEGREES = (*range(0, 80, 5), 80, 83, 86, 88)
_FULL_TURN = 361
_MAP, _PICTURE = 91, 160
_HIGHEST = 89.0
# Of the picture by angles: exposed so that this share of its pixels is not cut off at white.
_SHOWN = 0.85


@dataclass(frozen=True)
class Slices:
    """BRDF in the plane of incidence.

    Attributes
    ----------
    incidence_deg : (I,) polar angles of the light, which comes from the right
    viewer_deg : (V,) from -89 to 89; the mirror direction of an incidence a is at -a
    values : (I, V) luminance of the BRDF in 1/sr
    """

    incidence_deg: Array
    viewer_deg: Array
    values: Array

    def up_to(self, degrees: float) -> Slices:
        """Those of light from no lower than this polar angle."""
        kept = self.incidence_deg <= degrees
        return Slices(self.incidence_deg[kept], self.viewer_deg, self.values[kept])


def slices(source: Reflects, phi: float = 0.0) -> Slices:
    """In the plane of this azimuth, in radians, which matters only to an anisotropic source."""
    incidence, viewer = np.array(INCIDENCES), np.linspace(-_HIGHEST, _HIGHEST, _FULL_TURN)
    wi = spherical(np.radians(incidence), phi)[:, None]
    wo = _in_plane(np.radians(viewer), phi)
    return Slices(incidence, viewer, luminance(np.asarray(source.evaluate(wi, wo), np.float64)))


def _in_plane(theta: Array, phi: float) -> Array:
    """Directions at signed polar angles; what is below 0 lies opposite the azimuth."""
    return spherical(np.abs(theta), phi + np.where(theta < 0, np.pi, 0.0))


@dataclass(frozen=True)
class AlbedoCurves:
    """Share of the light that is reflected, (D, 3) at polar angles (D,) in degrees.

    Attributes
    ----------
    towards : of an even sky, towards a viewer at the angle
    of_beam : of a beam from the angle, into all directions; by reciprocity the same
    """

    degrees: Array
    towards: Array
    of_beam: Array


def albedo_curves(source: BrdfSource) -> AlbedoCurves:
    """By quadrature, see `bake.tables.albedo`."""
    degrees = np.array(_ALBEDO_DEGREES, float)
    angles = np.radians(degrees)
    return AlbedoCurves(
        degrees, directional_albedo(source, angles, 48), directional_albedo(Exchanged(source, "exchanged"), angles, 48)
    )


def reciprocity_map(source: BrdfSource, phi: float = 0.0) -> tuple[Array, Array]:
    """Signed polar angles (M,) in degrees, and [f(a, b) - f(b, a)] / [f(a, b) + f(b, a)] of luminance, (M, M).

    Rows are the light's angle, columns the viewer's, in the plane of this azimuth; NaN where both are 0 or below.
    """
    degrees = np.linspace(-_HIGHEST, _HIGHEST, _MAP)
    direction = _in_plane(np.radians(degrees), phi)
    value = luminance(np.asarray(source.evaluate(direction[:, None], direction[None]), np.float64))
    total = value + value.T
    return degrees, np.divide(value - value.T, total, out=np.full_like(total, np.nan), where=total > 0)


def angles_picture(source: BrdfSource) -> tuple[Array, float]:
    """A BRDF by half and difference angle, as Burley (2012, "Physically-Based Shading at Disney") shows materials.

    Returns
    -------
    (N, N, 3) linear Rec.709, exposed; columns are sqrt(theta_h / 90 degrees) from the peak on the left, rows theta_d
    from 90 degrees on top to 0, at phi_d = 90 degrees; and the BRDF in 1/sr that is shown white
    """
    u = (np.arange(_PICTURE) + 0.5) / _PICTURE
    theta_h, theta_d = (np.pi / 2) * u**2, (np.pi / 2) * u[::-1]
    half = spherical(theta_h, 0.0)[None]
    side = np.array([0.0, 1.0, 0.0])
    cosine, sine = np.cos(theta_d)[:, None, None], np.sin(theta_d)[:, None, None]
    wi, wo = normalize(cosine * half + sine * side), normalize(cosine * half - sine * side)
    value = np.maximum(np.asarray(source.evaluate(wi, wo), np.float64), 0)
    white = max(float(np.quantile(value.max(-1), _SHOWN)), 1e-12)
    return np.minimum(value / white, 1), white
