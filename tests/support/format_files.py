"""Files of every format of measurements, written by the layouts that the readers state, from any BRDF."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from measured_materials.bake.directions import spherical
from measured_materials.bake.patches import KLEMS
from measured_materials.bake.source import Array, BrdfSource
from measured_materials.bake.sources import neural_brdf, utia
from measured_materials.bake.sources.analytic import by_name
from measured_materials.bake.sources.goniometer.specular_frame import direction_around

THETAS = np.array([5.0, 20.0, 35.0, 50.0, 65.0, 75.0])
_OUT_THETAS, _OUT_PHIS = np.arange(0.0, 81.0, 10.0), np.arange(0.0, 360.0, 20.0)


def _text(values: Array) -> str:
    return " ".join(f"{v:.9g}" for v in np.asarray(values).reshape(-1))


def above(source: BrdfSource, wi: Array, wo: Array) -> Array:
    """Values, 0 below the horizon."""
    return np.asarray(source.evaluate(wi, wo))


def scattered_round(source: BrdfSource) -> tuple[Array, Array, Array, Array, Array]:
    """theta_i, theta_o, phi_o (degrees, light at phi 0), and the values, of a goniometer's round."""
    ti, to, po = np.meshgrid(THETAS, _OUT_THETAS, _OUT_PHIS, indexing="ij")
    wi, wo = spherical(np.radians(ti), 0.0), spherical(np.radians(to), np.radians(po))
    return ti.ravel(), to.ravel(), po.ravel(), above(source, wi, wo).reshape(-1, 3), wo.reshape(-1, 3)


def write_mbsdf(path: Path, source: BrdfSource, n_theta: int = 45, n_phi: int = 90) -> Path:
    """NVIDIA's MBSDF: cell centres, phi 180 degrees at the mirror."""
    theta = (np.arange(n_theta) + 0.5) * (np.pi / 2 / n_theta)
    phi = (np.arange(n_phi) + 0.5) * (np.pi / n_phi)
    values = above(source, spherical(theta[:, None, None], 0.0), spherical(theta[:, None], phi))
    head = b"NVIDIA ARC MBSDF V1\nmade by a test\nMBSDF_DATA_REFLECTION=\n"
    path.write_bytes(head + np.array([1, n_theta, n_phi], "<u4").tobytes() + values.astype("<f4").tobytes())
    return path


def write_zemax(path: Path, source: BrdfSource, rotations: Array | None = None, channels: str = "Monochrome") -> Path:
    """Zemax' tabular BSDF, the light at the azimuth of the rotation."""
    turns = np.zeros(1) if rotations is None else rotations
    azimuths = np.arange(0.0, 181.0, 10.0) if rotations is None else np.arange(0.0, 361.0, 10.0)
    radials = np.concatenate([np.arange(0.0, 20.0, 2.0), np.arange(20.0, 181.0, 10.0)])
    lines = ["# a comment first", "Source\tMeasured"]
    lines += ["Symmetry PlaneSymmetrical" if rotations is None else "Symmetry ASymmetrical4D"]
    lines += [f"SpectralContent {channels}", "ScatterType BRDF"]
    axes = {"SampleRotation": turns, "AngleOfIncidence": THETAS, "ScatterAzimuth": azimuths, "ScatterRadial": radials}
    for name, nodes in axes.items():
        lines += [f"{name} {len(nodes)}", _text(nodes)]
    blocks = {"TristimulusX": 0, "TristimulusY": 1, "TristimulusZ": 2}
    blocks = {"Monochrome": 1} if channels == "Monochrome" else blocks
    for name, c in blocks.items():
        lines += [name, "DataBegin"]
        for turn in np.radians(turns):
            for theta in np.radians(THETAS):
                wo = direction_around(theta, np.radians(radials), np.radians(azimuths)[:, None])
                wo = _turned(wo, turn)
                lines += ["TIS 0.5", *map(_text, above(source, spherical(theta, turn), wo)[..., c])]
        lines += ["DataEnd"]
    path.write_text("\n".join(lines))
    return path


def _turned(direction: Array, phi: float) -> Array:
    c, s = np.cos(phi), np.sin(phi)
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y, z], -1)


def write_integra(path: Path, source: BrdfSource) -> Path:
    """Integra's .ddr: luminance, absolute, RGB; around the mirror direction."""
    phi, theta = np.arange(0.0, 181.0, 10.0), np.concatenate([np.arange(0.0, 20.0, 2.0), np.arange(20.0, 171.0, 10.0)])
    lines = [";; a comment", "Source Measured", "TypeSym PlaneSymmetrical", "TypeColorModel rgb"]
    lines += ["TypeData Luminance Absolute", "psi 1", "0", f"sigma {len(THETAS)}", _text(THETAS)]
    lines += [f"phi {len(phi)}", _text(phi), f"theta {len(theta)}", _text(theta)]
    sigma = np.radians(THETAS)[:, None, None]
    wo = direction_around(sigma, np.radians(theta), np.radians(phi)[:, None])
    values = above(source, spherical(sigma, 0.0), wo) * np.pi
    for c, name in enumerate(("red", "gre", "blu")):
        lines += [name, "kbdf", _text(np.full(len(THETAS), 2.0)), "def", _text(values[..., c] / 2), "enddef"]
    path.write_text("\n".join(lines))
    return path


def write_lighttools(path: Path, source: BrdfSource) -> Path:
    """LightTools' text: around the normal, the light at azimuth 90."""
    azimuths, radials = _OUT_PHIS, _OUT_THETAS
    lines = ["Symmetry PlaneSymmetrical", "SpectralContent Monochrome", f"ScatterAzimuth {len(azimuths)}"]
    lines += [_text(azimuths), f"ScatterRadial {len(radials)}", _text(radials), "DataBegin"]
    wo = spherical(np.radians(radials), np.radians(azimuths)[:, None])
    for theta in THETAS:
        for side, scale in (("Front", 1), ("Back", 7)):
            values = above(source, spherical(np.radians(theta), np.pi / 2), wo)[..., 1] * scale
            lines += [f"AOI {theta}", "POI 0", f"Side {side}", "Wavelength 550", "ScatterType BRDF", "TIS 0.4"]
            lines += [_text(row) for row in values]
    path.write_text("\n".join([*lines, "DataEnd"]))
    return path


def write_fred(path: Path, source: BrdfSource) -> Path:
    """FRED's text: the mirror at the theta and phi of the line of incidence."""
    ti, to, po, values, _ = scattered_round(source)
    lines = ["type bsdf_data", "format angles=deg bsdf=value scale=0.5"]
    for theta in THETAS:
        lines.append(f"{theta} 0")
        at = ti == theta
        lines += [f"{a} {(p + 180) % 360} {2 * v:.9g}" for a, p, v in zip(to[at], po[at], values[at, 1])]
    path.write_text("\n".join(lines))
    return path


def write_astm(path: Path, source: BrdfSource) -> Path:
    """ASTM E2387 in radians, R, G, B."""
    ti, to, po, values, _ = scattered_round(source)
    lines = ["LAB_NAME a test", "MEAS_NAME BRDF", f"NUM_POINTS {len(ti)}", "VARS theta_i,phi_i,theta_s,phi_s,R,G,B", ""]
    for a, b, p, v in zip(np.radians(ti), np.radians(to), np.radians(po), values):
        lines.append(f"{a:.9g}, 1.5, {b:.9g}, {p + 1.5:.9g}, " + ", ".join(f"{x:.9g}" for x in v))
    path.write_text("\n".join(lines))
    return path


def write_alta(path: Path, source: BrdfSource) -> Path:
    """ALTA: the light at +x, the viewer projected, values with the viewer's cosine."""
    ti, to, po, values, wo = scattered_round(source)
    lines = ["#DIM 3 1", "#PARAM_IN ISOTROPIC_TL_TV_PROJ_DPHI", "#PARAM_OUT INV_STERADIAN_COSINE_FACTOR", "#VS 0"]
    for a, b, p, v, z in zip(np.radians(ti), np.radians(to), np.radians(po), values[:, 1], wo[:, 2]):
        lines.append(f"{a:.9g} {b * np.cos(p):.9g} {b * np.sin(p):.9g} {v * z:.9g}")
    path.write_text("\n".join(lines))
    return path


def write_table(path: Path, source: BrdfSource) -> Path:
    """A plain table in degrees, R, G, B."""
    ti, to, po, values, _ = scattered_round(source)
    lines = ["# any comment", "theta_i [deg], phi_i [deg], theta_o [deg], phi_o [deg], R, G, B"]
    for a, b, p, v in zip(ti, to, po, values):
        lines.append(f"{a}, 40, {b}, {p + 40}, " + ", ".join(f"{x:.9g}" for x in v))
    path.write_text("\n".join(lines))
    return path


def write_pab_opto(path: Path, source: BrdfSource) -> Path:
    """pab-opto: a file per direction of the light, values with the cosine (DSF); the first one's path."""
    ti, to, po, values, wo = scattered_round(source)
    first = path
    for number, theta in enumerate(THETAS):
        at = ti == theta
        lines = [
            '#sample_name "a test"',
            "#format: theta phi DSF",
            f"#incident_angle {theta} 30",
            "#colorimetry: CIE-Y",
        ]
        lines += [f"{a} {p + 30} {v * z:.9g}" for a, p, v, z in zip(to[at], po[at], values[at, 1], wo[at, 2])]
        target = path.with_name(f"{path.stem}_{number}{path.suffix}")
        target.write_text("\n".join(lines))
        first = target if number == 0 else first
    return first


def write_utia(path: Path, source: BrdfSource) -> Path:
    """UTIA's 6 x 48 directions, linear numbers."""
    theta, phi = np.radians(15.0 * np.arange(utia.THETAS)), np.radians(7.5 * np.arange(utia.PHIS))
    out = spherical(theta[:, None], phi)
    values = above(source, out[:, :, None, None], out)
    np.moveaxis(values, -1, 0).astype("<f8").tofile(path)
    return path


def klems_centres(name: str = "Full") -> Array:
    """Directions of the bins of Klems' bases; of the full one (145, 3)."""
    basis = KLEMS[f"klems {name.lower()}"]
    lower = np.array([0.0, *basis.bounds[:-1]])
    middle = (lower + np.array(basis.bounds)) / 2
    middle[0] = 0.0
    parts = [
        spherical(np.radians(theta), np.arange(n) * (2 * np.pi / n))
        for theta, n in zip(middle, basis.azimuths, strict=True)
    ]
    return np.concatenate(parts)


_XML = """<?xml version="1.0" encoding="UTF-8"?>
<WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer><Material><Name>a test</Name></Material>
<DataDefinition><IncidentDataStructure>{structure}</IncidentDataStructure></DataDefinition>
{blocks}</Layer></Optical></WindowElement>
"""
_BLOCK = """<WavelengthData><Wavelength unit="Integral">{wavelength}</Wavelength><WavelengthDataBlock>
<WavelengthDataDirection>{side}</WavelengthDataDirection>{basis}
<ScatteringDataType>BTDF</ScatteringDataType><ScatteringData>
{data}
</ScatteringData></WavelengthDataBlock></WavelengthData>
"""
_KLEMS = "<ColumnAngleBasis>LBNL/Klems {0}</ColumnAngleBasis><RowAngleBasis>LBNL/Klems {0}</RowAngleBasis>"


def write_klems(
    path: Path, source: BrdfSource, side: str = "Reflection Back", structure: str = "Columns", basis: str = "Full"
) -> Path:
    """A Klems matrix of what is seen above the horizon, whatever the block is called."""
    return klems_file(path, {side: (source.evaluate, 1.0, 1.0)}, structure, basis)


# Values of (wi, wo), and the signs of the heights of both.
Block = tuple[Callable[[Array, Array], Array], float, float]


def klems_file(path: Path, blocks: Mapping[str, Block], structure: str, basis: str = "Full") -> Path:
    """Matrices of these blocks: rows are outgoing, and incident bins are named by where the light travels to."""
    bins, texts = klems_centres(basis), []
    for side, (evaluate, lit, seen) in blocks.items():
        values = np.asarray(evaluate((bins * [-1.0, -1.0, lit])[None], (bins * [1.0, 1.0, seen])[:, None]))[..., 1]
        if structure == "Rows":
            values = values.T
        data = ",\n".join(_text(row).replace(" ", ", ") for row in values)
        texts.append(_BLOCK.format(wavelength="Visible", side=side, basis=_KLEMS.format(basis), data=data + ","))
    path.write_text("a line that a program logged\n" + _XML.format(structure=structure, blocks="".join(texts)))
    return path


def write_tree(path: Path, source: BrdfSource, depth: int = 3, side: str = "Reflection Back") -> Path:
    """A tensor tree of rank 4: one branch at the top, its children grids of values at the centres of their cells."""
    n = 1 << depth
    centre = (np.arange(n) + 0.5) / n
    square = np.stack(np.meshgrid(centre, centre, indexing="ij"), -1).reshape(-1, 2)
    disk = square_to_disk(square)
    up = np.sqrt(np.maximum(1 - (disk**2).sum(-1), 0))
    out = np.column_stack([disk, up])
    wi = out * np.array([-1.0, -1.0, 1.0])
    values = above(source, wi[:, None], out[None])[..., 1].reshape(n, n, n, n)
    half = n // 2
    children = []
    for child in range(16):
        # The first coordinate is the lowest bit of a branch, and the slowest of a leaf's values.
        at = tuple(slice((child >> d & 1) * half, ((child >> d & 1) + 1) * half) for d in range(4))
        children.append("{ " + _text(values[at]) + " }")
    data = "{\n" + "\n".join(children) + "\n}"
    block = _BLOCK.format(
        wavelength="Visible", side=side, basis="<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>", data=data
    )
    path.write_text(_XML.format(structure="TensorTree4", blocks=block))
    return path


def square_to_disk(square: Array) -> Array:
    """Shirley & Chiu's concentric map (1997), (n, 2) in [0, 1] to the unit disk."""
    a, b = 2 * square[:, 0] - 1, 2 * square[:, 1] - 1
    wide = np.abs(a) > np.abs(b)
    radius = np.where(wide, a, b)
    ratio = np.where(wide, b / np.where(a == 0, 1, a), a / np.where(b == 0, 1, b))
    phi = np.where(wide, np.pi / 4 * ratio, np.pi / 2 - np.pi / 4 * ratio)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi)], -1)


def write_npy(path: Path, source: BrdfSource) -> Path:
    """Our own order of axes: four of them for an isotropic BRDF, else five."""
    if source.isotropic:
        theta, phi = np.linspace(0, np.pi / 2, 46), np.linspace(0, np.pi, 46)
        values = above(source, spherical(theta[None, :, None], phi), spherical(theta[:, None, None], 0.0))
    else:
        theta, phi = np.linspace(0, np.pi / 2, 16), np.arange(32) * (2 * np.pi / 32)
        out = spherical(theta[:, None], phi)
        values = above(source, out, out[:, :, None, None])
    np.save(path, values)
    return path


def network_weights(seed: int = 3) -> list[tuple[Array, Array]]:
    """Layers of a small network whose values are those of no real material."""
    rng = np.random.default_rng(seed)
    sizes = (6, 21, 21, 3)
    return [
        (rng.normal(0, 0.4, (a, b)).astype(np.float32), rng.normal(0, 0.1, b).astype(np.float32))
        for a, b in itertools.pairwise(sizes)
    ]


def write_network(path: Path, source: BrdfSource | None = None) -> Path:
    """Six .npy of Neural-BRDF, NAMEfc1.npy to NAMEb3.npy; the first one's path. The BRDF is the network's own."""
    for number, (kernel, bias) in enumerate(network_weights(), 1):
        np.save(path.with_name(f"{path.stem}_fc{number}.npy"), kernel)
        np.save(path.with_name(f"{path.stem}_b{number}.npy"), bias)
    return path.with_name(f"{path.stem}_fc1.npy")


ABC_SET: dict[str, Any] = {"kD": [0.1, 0.2, 0.3], "A": [30.0, 20.0, 10.0], "B": 900.0, "C": 0.9, "ior": 1.6}
# Steep in the shadowing, as published ones are.
SGD_SET: dict[str, Any] = {
    "rhoD": [0.05, 0.1, 0.2],
    "rhoS": [0.3, 0.4, 0.2],
    "alpha": [0.02, 0.04, 0.03],
    "p": [0.5, 0.4, 0.6],
    "f0": [0.9, 0.5, 2.0],
    "f1": [0.2, -0.1, 1.2],
    "kap": [40.0, 20.0, 15.0],
    "lambda": [2.6, 3.0, 2.8],
    "c": [1e-6, 2e-6, 1e-6],
    "k": [40.0, 35.0, 30.0],
    "theta0": [0.2, 0.07, -0.07],
}


def write_published(path: Path, source: BrdfSource | None = None, entries: dict[str, Any] = ABC_SET) -> Path:
    """One published set of parameters. The BRDF is the formula's own."""
    path.write_text(json.dumps({"source": "a test", "materials": {"a material": entries}}))
    return path


assert neural_brdf.LAYERS == len(network_weights())

# Grey-green-blue, so that channels cannot be exchanged unseen; a lobe wide enough for 10-degree steps.
GLOSSY = by_name("ggx", alpha=0.35, f0=(0.9, 0.5, 0.2))
BRUSHED = by_name("ggx", alpha=0.3, alpha_y=0.6, f0=(0.9, 0.5, 0.2))
# Their files hold one channel here, the green one.
GREY = ("Zemax BSDF", "LightTools", "FRED", "ALTA", "pab-opto", "WINDOW or Radiance XML")


def pairs(count: int = 4000, largest: float = 70.0) -> tuple[Array, Array]:
    """Directions within the written elevations."""
    rng = np.random.default_rng(1)
    theta = np.arccos(1 - rng.random((2, count)) * (1 - np.cos(np.radians(largest))))
    phi = rng.random((2, count)) * 2 * np.pi
    return spherical(theta[0], phi[0]), spherical(theta[1], phi[1])


def error(source: BrdfSource, truth: BrdfSource, grey: bool = False) -> float:
    """RMS of the difference over RMS of the signal, both times both cosines."""
    wi, wo = pairs()
    weight = (wi[:, 2] * wo[:, 2])[:, None]
    wanted = np.asarray(truth.evaluate(wi, wo)) * weight
    if grey:
        wanted = np.repeat(wanted[:, 1:2], 3, -1)
    found = source.evaluate(wi, wo) * weight
    return float(np.sqrt(np.mean((found - wanted) ** 2) / np.mean(wanted**2)))


Writer = Callable[[Path, BrdfSource], Path]
WRITERS: dict[str, tuple[str, Writer]] = {
    "NVIDIA MBSDF": (".mbsdf", write_mbsdf),
    "Zemax BSDF": (".bsdf", write_zemax),
    "Integra DDR": (".ddr", write_integra),
    "LightTools": (".txt", write_lighttools),
    "FRED": (".txt", write_fred),
    "ASTM E2387": (".astm", write_astm),
    "ALTA": (".dat", write_alta),
    "table of samples": (".csv", write_table),
    "pab-opto": (".txt", write_pab_opto),
    "UTIA": (".bin", write_utia),
    "WINDOW or Radiance XML": (".xml", write_klems),
    "numpy array": (".npy", write_npy),
    "Neural-BRDF": (".npy", write_network),
    "published SGD or ABC fit": (".json", write_published),
}
