"""A relief of known height, normals and albedo, and photographs of it under lights all around."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.maps.gloss import ggx_lobe, half_vectors
from measured_materials.bake.maps.write import Maps, write_maps

N = 48
ROUGHNESS = 0.5
DARK, LIGHT = np.array([0.1, 0.15, 0.3]), np.array([0.5, 0.3, 0.2])


def lights(ring: int) -> np.ndarray:
    """Rings at 25 and 50 degrees of elevation, and half of one at 75."""
    found = [
        (np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e))
        for e, count in ((np.radians(25), ring), (np.radians(50), ring), (np.radians(75), ring // 2))
        for a in 2 * np.pi * (np.arange(count) + 0.3 * e) / count
    ]
    return np.array(found)


def relief() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Height in texels (N, N) that repeats, its normals, and albedo in squares."""
    y, x = np.mgrid[0:N, 0:N]
    waves = (2.0, 1, 2, 0.0), (1.0, 3, 1, 1.0), (0.6, 5, 4, 2.0)
    height = sum(a * np.sin(2 * np.pi * (u * x + v * y) / N + phase) for a, u, v, phase in waves)
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / 2
    up = (np.roll(height, 1, 0) - np.roll(height, -1, 0)) / 2
    normals = np.dstack([-dx, -up, np.ones_like(dx)])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    squares = ((x // 8 + y // 8) % 2)[..., None]
    return height, normals, np.where(squares, DARK, LIGHT)


def photographs(
    directions: np.ndarray, gloss: float = 0.0, roughness: float = 0.43, shadows: float = 0.0
) -> np.ndarray:
    """Of the relief, f cos in 1/sr; a share of the values lies in shadow."""
    _, normals, albedo = relief()
    lit = np.einsum("ni,hwi->nhw", directions, normals)
    tilt = np.clip(np.einsum("ni,hwi->nhw", half_vectors(directions), normals), 0, 1)
    images = np.maximum(lit, 0)[..., None] * albedo / np.pi
    images += (gloss * ggx_lobe(roughness**2, lit, tilt, np.broadcast_to(normals[..., 2], lit.shape)))[..., None]
    shaded = np.random.default_rng(1).random(lit.shape) < shadows
    return np.where(shaded[..., None], 0.05 * images, images).astype(np.float32)


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1)))


def write_photographs(folder: Path, images: np.ndarray, directions: np.ndarray) -> Path:
    """As a person has them: EXR files and a list of lights."""
    folder.mkdir(parents=True)
    lines = ["file,x,y,z"]
    for k, (image, way) in enumerate(zip(images, directions, strict=True)):
        write_image(folder / f"p{k:02}.exr", image, Storage.HALF)
        lines.append(f"p{k:02}.exr,{way[0]:.6f},{way[1]:.6f},{way[2]:.6f}")
    (folder / "lights.csv").write_text("\n".join(lines))
    return folder


def write_folder(folder: Path, convention: Any = "opengl", kind: Any = "png16", gloss: float = 0.0) -> Path:
    """Maps of the relief itself."""
    folder.mkdir(parents=True)
    height, normals, albedo = relief()
    flat = np.ones((N, N), np.float32)
    maps = Maps(
        normals.astype(np.float32),
        albedo.astype(np.float32),
        (height / N).astype(np.float32),
        ROUGHNESS * flat,
        gloss * flat,
    )
    facts = {
        "program": "measured_materials maps",
        "source": "relief",
        "mean_albedo": albedo.mean((0, 1)).tolist(),
        "maps": write_maps(folder, maps, convention, kind),
    }
    (folder / "maps.json").write_text(json.dumps(facts))
    return folder
