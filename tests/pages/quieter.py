"""Noise before and after lamps were sampled in the shader: a paint as Principled and as Exact, denoised and not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import bpy
import measured_materials
import numpy as np
from commands import save
from measured_materials.addon.rendering.contact_sheet import Cell, write_sheet
from measured_materials.addon.rendering.denoising import denoised, features_of
from measured_materials.addon.studio.studio import build_studio, remove_studio
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.source import Array
from measured_materials.nodes.material import build_material
from PIL import Image

# The last commit whose shaders could not sample light.
BEFORE = "aad2a70"
_EDGE, _SAMPLES, _TRUTH = 96, (16, 64, 256), 512
# Pixels are shown this many times as large.
_LARGER = 2
ROWS = {"Principled": ("now", "principled"), "Exact before": ("before", "nodes"), "Exact now": ("now", "osl")}


def make(out: Path, folder: Path) -> None:
    """Two lines for each row of `ROWS`, noisy and denoised, and the errors beneath."""
    root = Path(measured_materials.__file__).parent
    packages = {"now": _linked(root, folder / "now"), "before": _exported(root, BEFORE, folder / "before")}
    truth = _pictures(packages["now"], folder, "now", "osl", [_TRUTH], "truth")[_TRUTH]
    features = _features(folder / "now.mmat")
    cells: list[Cell] = []
    for name, (when, built) in ROWS.items():
        noisy = _pictures(packages[when], folder, when, built, list(_SAMPLES), name)
        quiet = {samples: denoised(picture, *features) for samples, picture in noisy.items()}
        for words, found in (("", noisy), (", denoised", quiet)):
            for samples in _SAMPLES:
                error = float(np.sqrt(((found[samples] - truth) ** 2).mean()) / truth.mean())
                print(f"  {name}{words}, {samples} samples: error {error:.1%}", flush=True)
                shown = found[samples].repeat(_LARGER, 0).repeat(_LARGER, 1)
                cells.append(Cell(shown, f"{name}{words}", f"{samples} samples, error {error:.1%}"))
    # Noisy and denoised side by side: six in a row.
    write_sheet(folder / "quieter.png", cells, 2 * len(_SAMPLES))
    save(Image.open(folder / "quieter.png"), out / "quieter.jpg")


def _pictures(package: Path, folder: Path, when: str, built: str, samples: list[int], name: str) -> dict[int, Array]:
    """By samples, of a fresh process with the package that lies in a folder; what is in `folder` already is taken."""
    file = folder / f"{name.replace(' ', '_')}_{_EDGE}.npz"
    if not file.is_file():
        told = {
            "as": built,
            "bundle": str(folder / f"{when}.mmat"),
            "edge": _EDGE,
            "samples": samples,
            "out": str(file),
        }
        script = Path(__file__).with_name("quieter_child.py")
        done = subprocess.run(
            [sys.executable, "-P", str(script), json.dumps(told)],
            env={**os.environ, "PYTHONPATH": str(package)},
            capture_output=True,
            text=True,
        )
        if done.returncode:
            sys.exit(f"docs quieter: {name}: {done.stderr[-2000:]}")
    found = np.load(file)
    return {count: found[str(count)] for count in samples}


def _features(path: Path) -> tuple[Array, Array]:
    """Albedo and normal of the studio with the material, which all are denoised by alike."""
    material = bpy.data.materials.new("paint")
    scene = build_studio(material, resolution=(_EDGE, _EDGE), seed=3)
    twin = build_material(BrdfRecord.read(read_bundle(path)), mode="preview", features=True)
    try:
        return features_of(scene, material, twin)
    finally:
        remove_studio(scene)


def _linked(root: Path, folder: Path) -> Path:
    """A folder in which the package is found under its name."""
    folder.mkdir(exist_ok=True)
    link = folder / "measured_materials"
    if not link.is_symlink():
        link.symlink_to(root)
    return folder


def _exported(root: Path, commit: str, folder: Path) -> Path:
    """The same, of a commit."""
    package = folder / "measured_materials"
    package.mkdir(parents=True, exist_ok=True)
    packed = subprocess.run(["git", "-C", str(root), "archive", commit], capture_output=True)
    if packed.returncode:
        sys.exit(f"docs quieter: {packed.stderr.decode(errors='replace').strip()}")
    subprocess.run(["tar", "x", "-C", str(package)], input=packed.stdout, check=True)
    return folder
