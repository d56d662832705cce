"""Measured materials of the EPFL/RGL database, `.bsdf` files, RGB and spectral, isotropic and anisotropic.

Source: J. Dupuy and W. Jakob, "An Adaptive Parameterization for Efficient Material Acquisition and
Rendering", ACM Trans. Graph. 37(6), 2018. For each incident direction the measurement is stored over the
unit square that the distribution of visible normals (VNDF) of a fitted microfacet model warps to half
vectors, so that samples are dense where the material reflects.

Polar angle and azimuth enter every table as u = sqrt(2 theta / pi) and v = (phi + pi) / 2 pi. With the half
vector h at (u_h, v_h), v_h relative to phi_i when isotropic, and the measurement S at the warp's inverse s:

    f(wi, wo) cos(theta_o) = S(s; wi) D(u_h, v_h) / (4 sigma(u_i, v_i))

(S alone where the file's `jacobian` flag is off). The table `luminance` only serves importance
sampling and is not read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..directions import normalize, polar_angle, spherical
from ..errors import BakeError
from ..reading import Illuminant, Reading
from ..source import Array, Facts, Reader
from ..spectrum import white_point, xyz_to_rec709, xyz_weights
from .grid_warp import Grid, Slices, WarpInverse, bracket
from .lookup.lookup_source import above_horizon
from .lookup.text_file import widened
from .tensor_file import MAGIC, read_tensor_file

_USUAL = Reading()
# Pairs evaluated at once: small enough for the temporaries (about 0.5 kB per pair) to stay in the cache.
CHUNK = 1 << 14
# The tables hold f cos(theta_o); their noise divided by a vanishing cosine would grow without bound, so
# from 89.994 degrees on the cosine is taken as constant.
MIN_COS = 1e-4
# Half vectors this near the normal have an azimuth of mere rounding, and measurements differ by tens of per
# cent around the pole. They take the azimuth across the plane of incidence, at normal incidence that of wi:
# there lie Mitsuba's values for mirror pairs.
POLE = 1e-6
# Far beyond any measurement (the NDF of a chrome vinyl peaks near 1e4), and no product overflows.
MAX_ENTRY = 1e12
MIN_SIGMA = 1e-6
MIN_DENSITY = 1e-12
# Entries of one table: 256 MiB as float64, about 1 GiB with its integrals.
MAX_SAMPLES = 1 << 25
# Angles are stored as float32.
SLACK = 1e-6
MAX_REDUCTION = 4
# Incident azimuths of an isotropic file, whose samples turn with them; two are one measurement's ends, as all readers
# of the format have it.
MOST_ISOTROPIC = 2


@dataclass(frozen=True)
class _Tables:
    """Validated contents of a file; `fold` maps directions into the measured azimuths."""

    phi_i: Array
    theta_i: Array
    ndf: Array
    sigma: Array
    vndf: Array
    rgb: Array
    jacobian: bool
    description: str
    reduction: int

    def fold(self, wi: Array, wo: Array) -> tuple[Array, Array]:
        """Use the symmetry that let part of the azimuths go unmeasured: a half turn, or two mirror planes."""
        if self.reduction < 2:
            return wi, wo
        middle = (self.phi_i[0] + self.phi_i[-1]) / 2
        flip_y = np.where(wi[:, 1] * math.sin(middle) < 0, -1.0, 1.0)
        flip_x = flip_y
        if self.reduction == MAX_REDUCTION:
            flip_x = np.where(wi[:, 0] * math.cos(middle) < 0, -1.0, 1.0)
        flip = np.stack([flip_x, flip_y, np.ones(flip_x.shape)], -1)
        return wi * flip, wo * flip


class RglSource:
    """A measured material of the RGL database; a `BrdfSource`.

    The measurement is not symmetrised: it is neither exactly reciprocal nor mirror symmetric nor
    non-negative. `facts` says by how much on a fixed set of directions.
    """

    def __init__(self, name: str, tables: _Tables) -> None:
        self.name = name
        self.isotropic = tables.phi_i.size <= MOST_ISOTROPIC
        self.bilateral = self.isotropic and _is_mirror_symmetric(tables)
        self._tables = tables
        size, height, width = tables.vndf.shape[1:]
        self._ndf, self._sigma = Grid(tables.ndf[None]), Grid(tables.sigma[None])
        self._warp = WarpInverse(tables.vndf.reshape(-1, height, width))
        self._rgb = Grid(np.moveaxis(tables.rgb.reshape(-1, *tables.rgb.shape[2:]), 1, -1))
        self.facts: Facts = {
            "format": "RGL tensor file",
            "description": tables.description,
            "incident_directions": [tables.phi_i.size, size],
            "samples_per_direction": list(tables.rgb.shape[-2:]),
            "largest_measured_theta_deg": float(np.degrees(tables.theta_i[-1])),
            "interpolation": "bilinear in the VNDF parameterization",
            **self._survey(),
        }

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr without the cosine; see `BrdfSource.evaluate`.

        The tables' incident direction is `wi`. About 0.6 s per million pairs, and about 10 MB beside
        the result.
        """
        return above_horizon(self._evaluate_above, wi, wo, CHUNK)

    def halved(self) -> tuple[RglSource, Array] | None:
        """The material of every second incident elevation, and the elevations (n,) in radians that it lacks; None of a
        file with fewer than three."""
        tables = self._tables
        left_out = np.arange(1, tables.theta_i.size - 1, 2)
        if not left_out.size:
            return None
        kept = np.setdiff1d(np.arange(tables.theta_i.size), left_out)
        half = replace(tables, theta_i=tables.theta_i[kept], vndf=tables.vndf[:, kept], rgb=tables.rgb[:, kept])
        return RglSource(self.name, half), tables.theta_i[left_out]

    def _evaluate_above(self, wi: Array, wo: Array) -> Array:
        """The formula of the module's head for (n, 3) pairs above the horizon."""
        tables = self._tables
        wi, wo = tables.fold(wi, wo)
        half = normalize(wi + wo)
        theta_i, theta_h = polar_angle(wi), polar_angle(half)
        phi_i = _azimuth(wi)
        phi_pole = phi_i + np.where(theta_i > 0, np.pi / 2, 0)
        phi_h = np.where(theta_h > POLE, _azimuth(half), phi_pole)
        if self.isotropic:
            phi_h, phi_i = phi_h - phi_i, np.full_like(phi_i, tables.phi_i.mean())
        u_h, v_h = _unit_polar(theta_h), _unit_azimuth(phi_h)
        v_h -= np.floor(v_h)
        slices = self._slices(theta_i, phi_i)
        value = self._rgb.evaluate(*self._warp(u_h, v_h, slices), slices)
        cosine = np.maximum(wo[:, 2], MIN_COS)
        if not tables.jacobian:
            return value / cosine[:, None]
        ndf = self._ndf.evaluate(u_h, v_h)
        sigma = self._sigma.evaluate(_unit_polar(theta_i), _unit_azimuth(phi_i))
        return value * (ndf / (4 * sigma * cosine))[:, None]

    def _slices(self, theta_i: Array, phi_i: Array) -> Slices:
        """The measured incident directions around (theta_i, phi_i) and their bilinear weights."""
        first = self._tables.phi_i[0] - SLACK
        phi = bracket(self._tables.phi_i, first + np.remainder(phi_i - first, 2 * np.pi))
        theta = bracket(self._tables.theta_i, theta_i)
        n_theta = self._tables.theta_i.size
        return [
            (phi_index * n_theta + theta_index, phi_weight * theta_weight)
            for phi_index, phi_weight in phi.ends()
            for theta_index, theta_weight in theta.ends()
        ]

    def _survey(self) -> dict[str, float]:
        """Share and depth of the negative values and the reciprocity error, over fixed directions."""
        theta = np.radians(np.arange(2.5, 90, 5))
        phi = np.radians(np.arange(0, 360, 15))
        azimuth = 0.0 if self.isotropic else phi[::3, None, None, None]
        wi = spherical(theta[:, None, None], azimuth)
        wo = spherical(theta[None, :, None], phi[None, None, :] + azimuth)
        forward, backward = self.evaluate(wi, wo), self.evaluate(wo, wi)
        difference = np.abs(forward - backward).sum() / max(np.abs(forward).sum(), 1e-30)
        return {
            "negative_share": float((forward < 0).mean()),
            "most_negative": float(min(forward.min(), 0.0)),
            "reciprocity_error": float(difference),
        }


def _azimuth(direction: Array) -> Array:
    """Azimuth of directions (n, 3); that of the normal itself is taken as pi, as Mitsuba's comes out."""
    x, y = direction[:, 0], direction[:, 1]
    return np.where((x == 0) & (y == 0), np.pi, np.arctan2(y, x))


def _unit_polar(theta: Array) -> Array:
    return np.sqrt(theta * (2 / np.pi))


def _unit_azimuth(phi: Array) -> Array:
    return (phi + np.pi) / (2 * np.pi)


def _is_mirror_symmetric(tables: _Tables) -> bool:
    """Whether f(phi_delta) = f(-phi_delta), up to the rounding of the stored float32 values."""
    for table in (tables.ndf, tables.vndf, tables.rgb):
        mirrored = np.flip(table, axis=-2)
        if not np.allclose(table, mirrored, rtol=1e-5, atol=1e-6 * np.abs(table).max()):
            return False
    return True


class _Validator:
    """Takes fields out of an untrusted tensor file; anything unusable is a `BakeError`."""

    def __init__(self, path: Path, fields: dict[str, Array]) -> None:
        self.path, self.fields = path, fields

    def error(self, cause: str) -> BakeError:
        """A `BakeError` of this file."""
        return BakeError(self.path, cause, "the file is damaged or no RGL material, fetch it again")

    def table(self, name: str, n_dimensions: int, least: float = -MAX_ENTRY) -> Array:
        """A float field of so many dimensions, whose entries are finite and at least `least`."""
        table = self.fields.get(name)
        if table is None:
            raise self.error(f"field {name!r} is missing")
        if table.ndim != n_dimensions or table.size == 0 or table.dtype.kind != "f":
            raise self.error(f"field {name!r} has shape {table.shape} of {table.dtype}, which is not usable")
        if table.size > MAX_SAMPLES:
            raise self.error(f"field {name!r} has {table.size} entries, more than any measurement")
        table = widened(table)
        # NaN fails these comparisons too
        if not (table.min() >= least and table.max() <= MAX_ENTRY):
            raise self.error(f"field {name!r} has values that are not finite or out of range")
        return table

    def angles(self, name: str, low: float, high: float) -> Array:
        """A field of rising angles in radians within [low, high]."""
        nodes = self.table(name, 1)
        if nodes[0] < low - SLACK or nodes[-1] > high + SLACK or np.any(np.diff(nodes) < SLACK):
            raise self.error(f"field {name!r} does not ascend inside [{low:.4g}, {high:.4g}]")
        return nodes

    def reduction(self, phi_i: Array) -> int:
        """How many symmetric copies of the measured azimuths make the circle: 1, 2 or 4."""
        if phi_i.size <= MOST_ISOTROPIC:
            return 1
        for copies in (1, 2, MAX_REDUCTION):
            sector = 2 * np.pi / copies
            # one sector, and between two axes (a whole circle from -pi on)
            start = phi_i[0] / min(sector, np.pi)
            if abs(phi_i[-1] - phi_i[0] - sector) < 1e-3 and abs(start - round(start)) < 1e-3:
                return copies
        raise self.error(f"azimuths {phi_i[0]:.4g} to {phi_i[-1]:.4g} are no whole, half or quarter circle")

    def flag(self, name: str) -> bool:
        """A field that is one whole number, as a truth value."""
        value = self.fields.get(name)
        if value is None or value.shape != (1,) or value.dtype.kind not in "iu":
            raise self.error(f"field {name!r} is missing or not a single whole number")
        return bool(value[0])

    def description(self) -> str:
        """The file's description in printable characters, empty if there is none."""
        value = self.fields.get("description")
        if value is None or value.ndim != 1 or value.dtype != np.uint8:
            return ""
        text = value[:200].tobytes().decode("utf-8", "replace")
        return "".join(c if c.isprintable() else " " for c in text).strip()

    def colours(self, illuminant: Illuminant) -> Array:
        """The field `rgb`, or `spectra` under an illuminant, as (phi_i, theta_i, 3, y, x)."""
        if "spectra" not in self.fields:
            return self.table("rgb", 5)
        wavelengths, spectra = self.table("wavelengths", 1, 0), self.table("spectra", 5)
        if spectra.shape[2] != wavelengths.size:
            raise self.error(f"fields 'spectra' and 'wavelengths' differ: {spectra.shape[2]} and {wavelengths.size}")
        try:
            weights = xyz_weights(wavelengths, illuminant) @ xyz_to_rec709(white_point(illuminant)).T
        except ValueError as error:
            raise self.error(f"field 'wavelengths': {error}") from error
        return np.einsum("ptwyx,wc->ptcyx", spectra, weights, optimize=True)

    def tables(self, illuminant: Illuminant = "D65") -> _Tables:
        """All tables of the file, checked against each other."""
        phi_i = self.angles("phi_i", -np.pi, np.pi)
        theta_i = self.angles("theta_i", 0, np.pi / 2)
        ndf, sigma = self.table("ndf", 2, 0), self.table("sigma", 2, MIN_SIGMA)
        vndf, rgb = self.table("vndf", 4, 0), self.colours(illuminant)
        for name, table in {"ndf": ndf, "sigma": sigma, "vndf": vndf, "rgb": rgb}.items():
            if min(table.shape[-2:]) < 2:
                raise self.error(f"field {name!r} has fewer than two samples along an axis")
        if vndf.shape[:2] != (phi_i.size, theta_i.size) or rgb.shape[:3] != (*vndf.shape[:2], 3):
            raise self.error("fields 'vndf' and 'rgb' do not fit the incident directions")
        if vndf.max((-2, -1)).min() < MIN_DENSITY:
            raise self.error("field 'vndf' has an incident direction without any density")
        return _Tables(
            phi_i,
            theta_i,
            ndf,
            sigma,
            vndf,
            rgb,
            self.flag("jacobian"),
            self.description(),
            self.reduction(phi_i),
        )


def read_rgl(path: str | Path, reading: Reading = _USUAL) -> RglSource:
    """Read a `.bsdf` file of the RGL database, RGB or spectral.

    Parameters
    ----------
    path : the file; untrusted
    reading : its illuminant is that of a spectral file

    Raises
    ------
    BakeError : not a tensor file, or damaged
    """
    path = Path(path)
    fields = read_tensor_file(path)
    source = RglSource(path.stem, _Validator(path, fields).tables(reading.illuminant))
    if "spectra" in fields:
        wavelengths = fields["wavelengths"]
        told = {"wavelengths_nm": [float(wavelengths[0]), float(wavelengths[-1])], "illuminant": reading.illuminant}
        source.facts = {**source.facts, **told, "wavelength_count": wavelengths.size}
    return source


def _matches(path: Path, head: bytes) -> bool:
    return head.startswith(MAGIC)


READER = Reader(name="RGL", suffixes=(".bsdf",), matches=_matches, read=read_rgl)
