"""Cycles to pixels: unbiased settings, and the picture of a scene as an array, without the renderer's chatter."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...bake.errors import BakeError
from ...nodes import compat


def set_unbiased(scene: bpy.types.Scene, samples: int, seed: int) -> None:
    """CPU Cycles with nothing that biases a stochastic mirror, cleans noise up or spends samples unevenly."""
    scene.render.engine = "CYCLES"
    scene.render.resolution_percentage = 100
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.film_transparent = False
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples, cycles.seed = samples, seed
    cycles.use_animated_seed = False
    cycles.time_limit = 0
    cycles.blur_glossy = 0  # Filter Glossy would blur the mirror after a diffuse bounce
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.use_denoising = cycles.use_adaptive_sampling = cycles.use_guiding = cycles.use_fast_gi = False
    cycles.max_bounces = cycles.glossy_bounces = 12
    cycles.diffuse_bounces = 8
    cycles.use_auto_tile = False


def render_pixels(
    scene: bpy.types.Scene, path: Path | None = None, *, progress: Callable[[float], None] | None = None
) -> NDArray[np.float32]:
    """Render a Cycles scene as it is; the tables that materials aim by are not looked at, see `studio.render_linear`.

    The scene's output format and file path are changed.

    Parameters
    ----------
    path : where to keep the 32-bit OpenEXR file as well
    progress : called with the share of samples done, in [0, 1]

    Returns
    -------
    (H, W, 4) float32, scene-linear Rec.709 and alpha, row 0 on top

    Raises
    ------
    BakeError : `path` cannot be written
    RuntimeError : Blender could not render
    """
    compat.save_as_exr(scene.render.image_settings)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "render.exr"
        scene.render.filepath = str(file)
        scene.render.use_file_extension = True
        with _quiet(), _reporting(progress):
            bpy.ops.render.render(write_still=True, scene=scene.name)
        if not file.exists():
            raise RuntimeError(f"Blender gave no picture of scene {scene.name!r}")
        pixels = _read_pixels(file)
        if path is not None:
            _keep(file, Path(path))
    return pixels


def _read_pixels(file: Path) -> NDArray[np.float32]:
    image = bpy.data.images.load(str(file), check_existing=False)
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1]


def _keep(file: Path, path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(file.read_bytes())
    except OSError as error:
        raise BakeError(path, f"cannot be written ({error.strerror})", "choose another place for it") from error


@contextlib.contextmanager
def _reporting(progress: Callable[[float], None] | None) -> Iterator[None]:
    """Tell `progress` what Cycles says about its samples."""
    if progress is None:
        yield
        return

    def listen(text: str, *_: Any) -> None:
        if found := re.search(r"Sample (\d+)/(\d+)", str(text)):
            progress(int(found[1]) / int(found[2]))

    bpy.app.handlers.render_stats.append(listen)
    try:
        yield
    finally:
        # Left in place it would keep a Python that runs the bpy wheel from ending.
        bpy.app.handlers.render_stats.remove(listen)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hold back what Blender prints to stdout, lines about errors excepted; a window's console is left alone."""
    if not bpy.app.background:
        yield
        return
    sys.stdout.flush()
    kept = os.dup(1)
    with tempfile.TemporaryFile() as log:
        os.dup2(log.fileno(), 1)
        try:
            yield
        finally:
            _flush_c()
            os.dup2(kept, 1)
            os.close(kept)
            log.seek(0)
            for line in log.read().decode(errors="replace").splitlines():
                if re.search(r"\berror\b", line, re.IGNORECASE):
                    print(line, file=sys.stderr)


def _flush_c() -> None:
    """Blender writes through C's buffers, which would otherwise empty after the diversion has ended."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)
