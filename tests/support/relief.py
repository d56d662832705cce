"""A modelled relief under distant light, photographed from above: Lambertian with all its shadows, or glossy."""

from __future__ import annotations

import numpy as np


def lights(elevations: tuple[float, ...], azimuths: int, zenith: bool = True) -> np.ndarray:
    """Unit vectors (n, 3) to lights of every elevation at even azimuths, and one overhead."""
    e, a = (
        np.radians(np.repeat(elevations, azimuths)),
        np.tile(2 * np.pi * np.arange(azimuths) / azimuths, len(elevations)),
    )
    found = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1)
    return np.concatenate([found, [[0.0, 0.0, 1.0]]]) if zenith else found


def bumps(size: int, height: float = 2.5, seed: int = 0) -> np.ndarray:
    """Heights (size, size) in texels, periodic, row 0 on top."""
    rng = np.random.default_rng(seed)
    y, x = np.indices((size, size)) * (2 * np.pi / size)
    waves = [(i, j, *rng.uniform(0, 2 * np.pi, 1)) for i in range(1, 5) for j in range(-4, 5)]
    total = sum(np.cos(i * x + j * y + phase) / np.hypot(i, j) for i, j, phase in waves)
    return height * total / np.abs(total).max()


def photographs(heights: np.ndarray, directions: np.ndarray, shadows: bool = True) -> np.ndarray:
    """(n, H, W, 3) float32: max(n . l, 0) of every texel, and nothing where another stands before the light."""
    right, up = (
        (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) / 2,
        (np.roll(heights, 1, 0) - np.roll(heights, -1, 0)) / 2,
    )
    normals = np.stack([-right, -up, np.ones_like(heights)], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    albedo = np.array([0.8, 0.6, 0.4])
    found = []
    for light in directions:
        lit = np.maximum(normals @ light, 0)
        aside = np.hypot(light[0], light[1])
        if shadows and aside > 1e-6:
            step = light[:2] / aside
            reach = int(2 * np.abs(heights).max() * aside / max(light[2], 0.05)) + 2
            for t in range(1, min(reach, len(heights))):
                there = np.roll(heights, (round(step[1] * t), -round(step[0] * t)), (0, 1))
                lit = np.where(there - heights > t * light[2] / aside, 0.0, lit)
        found.append(lit[..., None] * albedo)
    return np.stack(found).astype(np.float32)


def glossy(directions: np.ndarray, exponent: float, albedo: float) -> np.ndarray:
    """(n, H, W, 3) of a relief with a Blinn-Phong highlight, seen from above."""
    heights = bumps(24, 1.0, 3)
    p, q = ((np.roll(heights, -1, k) - np.roll(heights, 1, k)) / 2 for k in (1, 0))
    steep = 0.1 / np.sqrt((p**2 + q**2).mean())
    normals = np.stack([-p * steep, q * steep, np.ones_like(p)], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    half = directions + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    lit, shine = (np.maximum(np.einsum("hwk,nk->nhw", normals, d), 0) for d in (directions, half))
    total = albedo * lit + 0.005 * (exponent + 8) * shine**exponent * directions[:, 2, None, None]
    return np.repeat(total[..., None], 3, -1).astype(np.float32)
