"""An anisotropic measurement in RGL's format, made from any BRDF: the forward direction of `bake.sources.rgl`.

For each incident direction the half vectors come from warping a regular grid by the density of visible normals of a
GGX; there the file holds f cos(theta_o) 4 sigma / D.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.lobes.microfacets import ggx_ndf
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources.grid_warp import Grid, WarpInverse
from measured_materials.bake.sources.tensor_file import write_tensor_file


def write_anisotropic_rgl(
    path: Path,
    source: BrdfSource,
    alphas: tuple[float, float],
    *,
    azimuths: int = 9,
    elevations: int = 8,
    size: int = 32,
    half_circle: bool = True,
) -> None:
    """Write a file.

    Parameters
    ----------
    alphas : of the GGX whose visible normals place the samples
    azimuths, elevations : incident directions; over [-pi, 0] where `half_circle` (the source repeats after half a
        turn), else over [-pi, pi]
    size : samples along each side of every table
    """
    phi_i = np.linspace(-np.pi, 0 if half_circle else np.pi, azimuths)
    theta_i = np.linspace(0, np.radians(85), elevations)
    u, v = _square(size)
    half = spherical(0.5 * np.pi * u**2, 2 * np.pi * v - np.pi)
    ndf = ggx_ndf(half, *alphas)
    wi = spherical(theta_i, phi_i[:, None])[:, :, None, None]
    # From solid angle to the square: theta_h = pi u^2 / 2, phi_h = 2 pi v.
    area = np.sin(0.5 * np.pi * u**2) * np.pi * u * 2 * np.pi
    seen = np.maximum((wi * half).sum(-1), 0)
    # A floor, for no direction may be without density.
    vndf = ndf * (seen + 0.01) * (area + 0.02)
    vndf /= vndf.mean((-2, -1), keepdims=True)
    sigma = _projected_area(alphas, spherical(0.5 * np.pi * u**2, 2 * np.pi * v - np.pi))
    u_h, v_h = _warped(vndf.reshape(-1, size, size), u.ravel(), v.ravel())
    shape = (azimuths, elevations, size, size)
    half = spherical(0.5 * np.pi * u_h**2, 2 * np.pi * v_h - np.pi).reshape(*shape, 3)
    wo = 2 * (wi * half).sum(-1, keepdims=True) * half - wi
    value = source.evaluate(np.broadcast_to(wi, wo.shape), wo) * np.maximum(wo[..., 2:], 0)
    at_half = Grid(ndf[None]).evaluate(u_h.ravel(), v_h.ravel()).reshape(shape)
    at_wi = Grid(sigma[None]).evaluate(
        np.broadcast_to(np.sqrt(theta_i * 2 / np.pi), shape[:2]).ravel(),
        np.broadcast_to((phi_i[:, None] + np.pi) / (2 * np.pi), shape[:2]).ravel(),
    )
    rgb = value * (4 * at_wi.reshape(*shape[:2], 1, 1) / at_half)[..., None]
    fields = {
        "phi_i": phi_i,
        "theta_i": theta_i,
        "ndf": ndf,
        "sigma": sigma,
        "vndf": vndf,
        "luminance": rgb.mean(-1),
        "rgb": np.moveaxis(rgb, -1, 2),
    }
    # Mitsuba takes no other float.
    stored: dict[str, Array | str] = {name: field.astype(np.float32) for name, field in fields.items()}
    stored |= {"description": f"made from {source.name}", "jacobian": np.array([1], np.uint8)}
    write_tensor_file(path, stored)


def _square(size: int) -> tuple[Array, Array]:
    """u along the last axis, v along the first."""
    v, u = np.meshgrid(np.linspace(0, 1, size), np.linspace(0, 1, size), indexing="ij")
    return u, v


def _projected_area(alphas: tuple[float, float], w: Array) -> Array:
    """Area of the microsurface seen along w: (w_z + sqrt(alpha_x^2 x^2 + alpha_y^2 y^2 + z^2)) / 2 (Heitz 2014)."""
    stretched = np.sqrt((alphas[0] * w[..., 0]) ** 2 + (alphas[1] * w[..., 1]) ** 2 + w[..., 2] ** 2)
    return 0.5 * (w[..., 2] + stretched)


def _warped(density: Array, s: Array, t: Array) -> tuple[Array, Array]:
    """Points (slices, n) that the warp of each slice sends (s, t) to, by bisecting the reader's inverse."""
    inverse = WarpInverse(density)
    count = len(density)
    index = np.repeat(np.arange(count), len(s))
    slices = [(index, np.ones(len(index)))]
    target_s, target_t = np.tile(s, count), np.tile(t, count)
    v = _bisected(lambda v: inverse(np.full_like(v, 0.5), v, slices)[1], target_t)
    u = _bisected(lambda u: inverse(u, v, slices)[0], target_s)
    return u.reshape(count, -1), v.reshape(count, -1)


def _bisected(function: object, target: Array) -> Array:
    low, high = np.zeros_like(target), np.ones_like(target)
    for _ in range(30):
        middle = 0.5 * (low + high)
        below = function(middle) < target  # type: ignore[operator]
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)
