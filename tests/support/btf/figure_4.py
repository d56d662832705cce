"""Figure 4 of Kautz et al. 2004 on the gantry: a swatch as geometry, as a compressed BTF, as shading maps."""

from __future__ import annotations

import hashlib
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from measured_materials.addon.demo.roll import CAMERA_TILT, PICTURE, RADIUS, TILES_AROUND, roll, sun_from
from measured_materials.addon.gantry import techniques
from measured_materials.addon.gantry.photograph_arc import SUN_ANGLE, gantry_scene
from measured_materials.addon.gantry.swatches import SWATCHES
from measured_materials.addon.gantry.techniques import Case, Frames, MappedSwatch
from measured_materials.bake.atomic_write import replacing_file
from measured_materials.bake.bundle.bundle import read_bundle
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.bake import ArcSettings, Azimuths, bake_stack
from measured_materials.bake.shading_maps.render_settings import RenderSettings
from numpy.typing import NDArray

from ..gantry_maps import ARC_CASES, AROUND_CASES, bytes_of, renders_of, stack_of
from .btf import Btf, compressed, whole
from .photograph import photograph_btf
from .rings import Array, Rings

COMPONENTS = 16
ARC_MAP, AROUND_MAP = "map of one arc", "map over azimuth"
# 21 views and as many lights, 30 to 43 degrees apart along a ring and 22 to 25 between rings.
DIRECTIONS = Rings(((0.0, 1), (25.0, 5), (50.0, 7), (72.0, 8)))
# (elevation, azimuth) of lights and (theta, phi) of views that are none of the BTF's, degrees.
_ALONG = tuple((e, 0.0) for e in (30.0, 52.5, 77.0))
_ELSEWHERE = ((30.0, 67.5), (52.5, 202.5), (77.0, 130.0))
_OBLIQUE = ((37.0, 82.0), (37.0, 230.0), (61.0, 22.0), (61.0, 160.0))
# Pairs of the BTF's own directions, by their numbers: views from above, of each ring; lights from all sides.
_OWN = ((0, 6), (0, 11), (2, 7), (4, 14), (8, 3), (11, 9), (14, 6), (19, 12))
# Points along a pixel's edge where it covers parts of several texels.
_OVER = 4

Radiance = Callable[[Array, Array, Array], Array]


def _case(group: str, view: tuple[float, float], light: tuple[float, float]) -> Case:
    return Case(group, ((*light, 1.0),), view)


def _own_cases() -> tuple[Case, ...]:
    angles = DIRECTIONS.angles
    lights = [(90 - theta, phi) for theta, phi in angles]
    return tuple(_case("directions of the BTF", angles[view], lights[light]) for view, light in _OWN)


CASES = (
    *_own_cases(),
    *(_case("from above, light along the arc", (0.0, 0.0), light) for light in _ALONG),
    *(_case("from above, light from elsewhere", (0.0, 0.0), light) for light in _ELSEWHERE),
    *(_case("obliquely, light along the arc", view, light) for view in _OBLIQUE for light in _ALONG[:2]),
    *(_case("obliquely, light from elsewhere", view, light) for view in _OBLIQUE for light in _ELSEWHERE[:2]),
)
GROUPS = tuple(dict.fromkeys(case.group for case in CASES))
# Direction to the sun of the picture: over the roll, whose axis is y, towards larger u and along the axis.
SUN = (0.6, 0.35, math.sqrt(1 - 0.6**2 - 0.35**2))


@dataclass(frozen=True, eq=False)
class Rival:
    """What shows a swatch: `radiance` (..., 3) at uv (..., 2) of unit directions wi, wo (..., 3), a sun's irradiance 1.

    photographs, bytes : that it is made of, and that it takes
    """

    name: str
    photographs: int
    bytes: int
    radiance: Radiance

    def picture(self, case: Case, size: int) -> Array:
        """In the gantry's frame (size, size, 3)."""
        over = 1 if case.view[0] == 0 else _OVER
        uv = techniques.frame_uv(size, case.view_radians, over)
        (light,), (theta, phi) = case.lights, case.view
        wi, wo = np.array(techniques.direction(*light[:2])), np.array(techniques.direction(90 - theta, phi))
        return techniques.pixels(self.radiance(uv, wi, wo), over)

    def rolled(self, size: int) -> Array:
        """Around the roll under the sun, as `roll` shows the geometry, black beside it: (size, size, 3)."""
        offset = ((np.arange(size * _OVER) + 0.5) / (size * _OVER) - 0.5) * PICTURE
        across, along = np.meshgrid(offset, offset, indexing="ij")
        seen = np.abs(across) < RADIUS
        angle = np.arcsin(np.clip(across / RADIUS, -1, 1)) + CAMERA_TILT
        uv = np.stack([angle / (2 * np.pi) * TILES_AROUND, along], -1)[seen]
        sine, cosine = np.sin(angle[seen]), np.cos(angle[seen])
        zero = np.zeros_like(sine)
        frame = np.stack([[cosine, zero, -sine], [zero, zero + 1, zero], [sine, zero, cosine]])
        wi = np.einsum("ijn,j->ni", frame, SUN)
        wo = np.einsum("ijn,j->ni", frame, (math.sin(CAMERA_TILT), 0.0, math.cos(CAMERA_TILT)))
        total = np.zeros((*across.shape, 3))
        lit = wi[:, 2] > 0
        total[seen] = np.where(lit[:, None], self.radiance(uv, np.where(lit[:, None], wi, (0.0, 0.0, 1.0)), wo), 0)
        return techniques.pixels(total, _OVER)


def photographed(
    name: str,
    size: int,
    samples: int,
    folder: Path,
    progress: Callable[[float], None] = lambda share: None,
    *,
    anew: bool = False,
) -> tuple[Rival, ...]:
    """A swatch's rivals of photographs from everywhere, on the arc and all around, all with so many samples of a pixel.

    `folder` keeps the photographs as fig4_NAME.npz. Unless `anew`, those that are there are taken, if they are of this
    size and effort, of the same directions and by the same gantry.
    """
    file, told = folder / f"fig4_{name}.npz", _told(size, samples)
    kept = None if anew else _kept(file, told)
    if kept is None:
        with gantry_scene(SWATCHES[name](0), size=size, samples=samples) as gantry:
            frames = techniques.photograph(gantry, AROUND_CASES)
            btf = photograph_btf(gantry, DIRECTIONS, DIRECTIONS, progress)
        kept = btf.pictures, np.stack([frames[key] for key in sorted(frames)])
        with replacing_file(file) as temporary:
            np.savez(temporary, btf=kept[0], around=kept[1], told=told)
    keys = sorted({frame for case in AROUND_CASES for frame in case.frames})
    frames = dict(zip(keys, kept[1], strict=True))
    return *rivals_of(whole(kept[0], DIRECTIONS, DIRECTIONS)), *maps_of(name, frames)


def _kept(file: Path, told: str) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """The BTF's pictures and the frames of `AROUND_CASES`, if they are of this."""
    if not file.is_file():
        return None
    with np.load(file) as there:
        return (there["btf"], there["around"]) if "told" in there and str(there["told"]) == told else None


def _told(size: int, samples: int) -> str:
    """All that photographs follow from: effort, directions, and the sources of the gantry and its swatches."""
    folder = Path(techniques.__file__).parent
    sources = b"".join(path.read_bytes() for path in sorted(folder.rglob("*.py")))
    lights = [case.lights for case in AROUND_CASES]
    return f"{size} {samples} {DIRECTIONS.rings} {lights} {hashlib.sha256(sources).hexdigest()}"


def geometry(name: str, size: int, samples: int) -> tuple[Frames, float]:
    """Frames of the swatch itself for `CASES`, and the noise of one in parts of its RMS."""
    with gantry_scene(SWATCHES[name](0), size=size, samples=samples) as gantry:
        frames = techniques.photograph(gantry, CASES)
        ((key, other),) = techniques.photograph(gantry, CASES[-1:], seed=1).items()
    return frames, float(np.sqrt(np.square(frames[key] - other).mean() / 2 / np.square(other).mean()))


def rivals_of(btf: Btf) -> tuple[Rival, ...]:
    """The BTF as it is, and compressed in both ways."""
    photographs = btf.pictures.shape[0] * btf.pictures.shape[1]
    kinds = {
        "BTF": btf,
        "BTF, PCA": compressed(btf, COMPONENTS),
        "BTF, PCA per view": compressed(btf, COMPONENTS, per_view=True),
    }
    return tuple(Rival(name, photographs, kind.bytes, kind.at) for name, kind in kinds.items())


def maps_of(name: str, frames: Frames) -> tuple[Rival, ...]:
    """The shading map of one arc, and the one over azimuth, each lit by the lobe that an artist would name."""
    found = []
    kinds: tuple[tuple[str, tuple[Case, ...], Azimuths], ...] = (
        (ARC_MAP, ARC_CASES, "arc"),
        (AROUND_MAP, AROUND_CASES, "all"),
    )
    for label, cases, azimuths in kinds:
        stack = stack_of(cases, frames)
        found.append(of_stack(label, stack, azimuths, renders_of(SWATCHES[name](0), stack)["family"]))
    return tuple(found)


def of_stack(label: str, stack: PhotoStack, azimuths: Azimuths, render: RenderSettings) -> Rival:
    """A shading map of these photographs."""
    with tempfile.TemporaryDirectory() as folder:
        bundle = read_bundle(bake_stack(stack, Path(folder) / "swatch.mmat", ArcSettings(azimuths=azimuths)).path)
        radiance = _radiance_of(techniques.mapped_swatch(bundle, render))
        return Rival(label, len(stack.images), bytes_of(bundle), radiance)


def _radiance_of(swatch: MappedSwatch) -> Radiance:
    """The lookup by r, one light."""

    def radiance(uv: Array, wi: Array, wo: Array) -> Array:
        r = swatch.lobe.value(wi, wo) * np.maximum(wi[..., 2], 0)
        x = np.broadcast_to(r * swatch.gain, uv.shape[:-1])
        if swatch.around is None:
            return swatch.a_max * swatch.map.evaluate(uv, x, swatch.above)
        phi = np.broadcast_to(np.arctan2(wi[..., 1], wi[..., 0]), uv.shape[:-1])
        return swatch.a_max * swatch.around.at(uv, x, phi, swatch.above)

    return radiance


def rolled_geometry(name: str, size: int, samples: int) -> Array:
    """The swatch itself, wrapped around the roll."""
    return roll(SWATCHES[name](0), size, samples, sun_from(SUN, SUN_ANGLE))
