"""Swatches made tileable: visibility of the seams before and after, time, and sheets of 2 x 2 repeats to look at."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from materials import SHARED
from measured_materials.addon.rendering.contact_sheet import Cell, to_display, write_sheet
from measured_materials.bake.source import Array
from measured_materials.bake.tiling.tileable import TileSettings, make_tileable
from PIL import Image

ELEVATIONS = np.radians([10, 20, 30, 40, 50, 60, 75, 88])
# Top, bottom, left, right of parts that a texture could be made of, and of a square that holds a picture.
CROPS = {
    "canvas": {"sky": (0, 100, 0, 160)},
    "painted_wood": {"panel": (20, 150, 10, 220), "picture": (0, 439, 0, 439)},
}


def shaded(height: Array, albedo: Array) -> Array:
    """Slices (8, H, W, 3) of a relief (texels) under light from 10 to 88 degrees, slightly glossy."""
    slope_y, slope_x = np.gradient(height)
    normal = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    slices = []
    for elevation in ELEVATIONS:
        light = np.array([0.8 * np.cos(elevation), 0.6 * np.cos(elevation), np.sin(elevation)])
        half = light + np.array([0, 0, 1])
        gloss = np.clip(normal @ (half / np.linalg.norm(half)), 0, 1) ** 40
        slices.append(albedo * np.clip(normal @ light, 0, 1)[..., None] + 0.08 * gloss[..., None])
    return np.array(slices, np.float32)


def weave(height: int = 300, width: int = 340, degrees: float = 0.0) -> Array:
    """Plain weave, yarns 23.7 and 19.3 texels wide and each of its own tone, which divide no side."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width].astype(float)
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = (cosine * x - sine * y) / 23.7, (sine * x + cosine * y) / 19.3
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - column - 0.5, y - row - 0.5
    over = np.where((column + row) % 2 == 0, 0.5, -0.5)
    warp = np.sqrt(np.clip(1 - 4 * fx**2, 0, 1)) * (0.6 + over * np.cos(np.pi * fy))
    weft = np.sqrt(np.clip(1 - 4 * fy**2, 0, 1)) * (0.6 - over * np.cos(np.pi * fx))
    relief = 6 * np.maximum(warp, weft) + 0.24 * random.standard_normal(x.shape)
    tones = 1 + 0.15 * random.standard_normal((2, 1000))
    warp_colour = 0.5 * tones[0, column % 1000][..., None] * np.array([1, 0.75, 0.5])
    weft_colour = 0.35 * tones[1, row % 1000][..., None] * np.array([0.6, 0.7, 1])
    return shaded(relief, np.where((warp > weft)[..., None], warp_colour, weft_colour))


def felt(height: int = 256, width: int = 300) -> Array:
    """Fibres in four directions, without any period."""
    random = np.random.default_rng(1)
    fy, fx = np.meshgrid(np.fft.fftfreq(2 * height), np.fft.rfftfreq(2 * width), indexing="ij")
    relief = np.zeros((2 * height, 2 * width))
    for angle in np.radians([10, 60, 130, 160]):
        along, across = fx * np.cos(angle) + fy * np.sin(angle), fy * np.cos(angle) - fx * np.sin(angle)
        band = np.exp(-((60 * along) ** 2) - (12 * across) ** 2) * (1 - np.exp(-((60 * across) ** 2)))
        grain = np.fft.rfft2(random.standard_normal(relief.shape))
        relief += np.maximum(np.fft.irfft2(grain * band, s=relief.shape), 0)
    relief = relief[:height, :width] * (2 / relief.std())
    albedo = 0.3 + 0.1 * np.tanh(relief - relief.mean())
    return shaded(relief, albedo[..., None] * np.array([0.9, 0.7, 0.6]))


def photographs(stack: str, crop: tuple[int, int, int, int]) -> Array:
    """An arc of photographs from dark to bright, decoded by gamma 2.2 for want of their response."""
    folder = SHARED / "data" / "stacks" / stack
    arc = json.loads((folder / "arcs.json").read_text())["arcs"][0]["images"]
    pixels = [np.asarray(Image.open(folder / image["file"]).convert("RGB"), np.float32) / 255 for image in arc]
    top, bottom, left, right = crop
    slices = np.array(pixels)[:, top:bottom, left:right] ** np.float32(2.2)
    return slices[np.argsort(slices.mean(axis=(1, 2, 3)))]


def swatches(quick: bool) -> Iterator[tuple[str, Callable[[], Array]]]:
    """Names and makers of slices."""
    yield "weave", weave
    if not quick:
        yield "weave turned by 1 degree", lambda: weave(degrees=1)
    yield "felt", felt
    if (SHARED / "data").is_dir():
        for stack, crops in CROPS.items():
            for part, crop in list(crops.items())[: 1 if quick else None]:
                yield f"{stack} {part}", lambda stack=stack, crop=crop: photographs(stack, crop)
    if not quick:
        yield "felt 512", lambda: felt(512, 512)


def repeats(picture: Array) -> Array:
    """2 x 2 repeats for display, the brightest percent clipped."""
    return to_display(np.tile(picture, (2, 2, 1)) / max(float(np.quantile(picture, 0.99)), 1e-6) * 0.8)


def run(out: Path, quick: bool) -> None:
    """Print a table and write one sheet per swatch; --quick leaves out the large and the hard ones."""
    print("visibility of seams: 1 is what the swatch has anywhere; steps: across seams over elsewhere, worst slice")
    print(
        f"  {'swatch':25s} {'size':>14s} {'method':>9s} {'tile':>9s} {'visibility':>13s} {'steps':>13s} "
        f"{'used':>5s} {'means':>13s} {'time':>7s}"
    )
    for name, make in swatches(quick):
        slices = make()
        shown = {"before": slices}
        for method in ("auto",) if quick else ("offset", "quilt", "auto"):
            started = time.perf_counter()
            tiled = make_tileable(slices, TileSettings(method=method))
            seconds = time.perf_counter() - started
            facts, means = tiled.facts, tiled.facts["means"]
            before, after = facts["seams"]["before"], facts["seams"]["after"]
            size = "x".join(str(n) for n in (len(slices), slices.shape[2], slices.shape[1]))
            print(
                f"  {name:25s} {size:>14s} {method:>9s} {'x'.join(map(str, facts['size'])):>9s} "
                f"{before['visibility']:5.2f} -> {after['visibility']:4.2f} "
                f"{before['steps']['worst']:5.2f} -> {after['steps']['worst']:4.2f} {facts['used']:5.0%} "
                f"{min(means):5.3f} - {max(means):5.3f} {seconds:5.1f} s"
            )
            shown[f"{method}: {facts['method']}{', set straight' * facts['straightened']}"] = tiled.slices
        cells = [
            Cell(repeats(stack[k]), label, light)
            for k, light in ((1, "grazing light"), (-1, "brightest slice"))
            for label, stack in shown.items()
        ]
        write_sheet(out / f"tileable-{name.replace(' ', '-')}.png", cells, len(shown), f"{name}, repeated 2 x 2")
