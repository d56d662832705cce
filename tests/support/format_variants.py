"""Variants of formats, beside `format_files`: several azimuths of the light, UTIA's pictures, ALTA's streams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.images.image_io import write_image
from measured_materials.bake.images.storage import Storage
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import utia

from .format_files import above, scattered_round


def write_alta_stream(path: Path, source: BrdfSource, endian: str = "little") -> Path:
    """ALTA's binary variant of `write_alta`, both directions in spherical angles, in 1/sr."""
    ti, to, po, values, _ = scattered_round(source)
    rows = np.column_stack([np.radians(ti), 0 * ti + 0.7, np.radians(to), np.radians(po) + 0.7, values[:, 1]])
    head = f"#DIM 4 1\n#PARAM_IN SPHERICAL_TL_PL_TV_PV\n#PARAM_OUT INV_STERADIAN\n#FORMAT binary\n#ENDIAN {endian}\n"
    head += f"#PRECISION ieee754-double\n#SAMPLE_COUNT {len(rows)}\n#BEGIN_STREAM\n"
    stream = rows.astype("<f8" if endian == "little" else ">f8").tobytes()
    path.write_bytes(head.encode() + stream + b"\n#END_STREAM\n")
    return path


def write_goniometer(path: Path, source: BrdfSource, azimuths: Array) -> Path:
    """A round of a goniometer for each azimuth of the light in degrees: a table in degrees, or by its suffix ASTM."""
    grid = np.meshgrid(np.arange(5.0, 80.0, 15.0), azimuths, np.arange(0.0, 80.0, 15.0), np.arange(0.0, 360.0, 30.0))
    ti, pi, to, po = (angle.ravel() for angle in grid)
    values = above(source, spherical(*np.radians([ti, pi])), spherical(*np.radians([to, pi + po])))
    if path.suffix == ".astm":
        angles = np.radians([ti, pi, to, pi + po]).T
        lines = [f"NUM_POINTS {len(ti)}", "VARS theta_i,phi_i,theta_s,phi_s,R,G,B"]
    else:
        angles, lines = np.stack([ti, pi, to, pi + po], -1), ["theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,r,g,b"]
    lines += [",".join(f"{x:.9g}" for x in (*a, *v)) for a, v in zip(angles, values, strict=True)]
    path.write_text("\n".join(lines))
    return path


def write_utia_picture(path: Path, source: BrdfSource, flipped: bool = False) -> Path:
    """The same as 288 x 288 pixels, rows the light; or upside down, as ALTA writes it."""
    theta, phi = np.radians(15.0 * np.arange(utia.THETAS)), np.radians(7.5 * np.arange(utia.PHIS))
    out = spherical(theta[:, None], phi).reshape(-1, 3)
    values = above(source, out[:, None], out)
    write_image(path, values[::-1] if flipped else values, Storage.FLOAT32)
    return path


def write_cornell(path: Path, source: BrdfSource) -> Path:
    """Cornell's text: angles in radians, and a spectrum that is flat, of the green channel's value."""
    lines = ["# made from a formula", "# num wls", "3", "# wls", "400 550 700"]
    ti, to, po, values, _ = scattered_round(source)
    for theta_i, theta_o, phi, value in zip(np.radians(ti), np.radians(to), np.radians(po), values[:, 1], strict=True):
        lines.append(f"{theta_i:.6f} 0 {theta_o:.6f} {phi:.6f}" + 3 * f" {value:.7g}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path
