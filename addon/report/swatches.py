"""The swatches of a report: built-in ones on the virtual gantry, a folder of photographs, or a baked shading map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...bake.atomic_write import replacing_file
from ...bake.bundle.bundle import is_bundle, read_bundle
from ...bake.errors import BakeError
from ...bake.photographs.settings import StackSettings
from ...bake.photographs.stack import read_stack
from ...bake.report.maps import LEAST_PHOTOGRAPHS, Images
from ...bake.shading_maps.record import ShadingMapRecord
from ...bake.source import Array
from ..gantry import techniques
from ..gantry.photograph_arc import gantry_scene
from ..gantry.swatches import SWATCHES, Swatch
from ..gantry.techniques import Case
from ..photographs.find_decoder import blender_decoder

ARC = tuple(np.linspace(5, 88, 10).round(2).tolist())
BETWEEN, ASIDE, BEHIND = "between two photographs", "light from the side", "light from behind"
# Of the lights' azimuth the photographs hold 0 alone. Light of irradiance 1 unless said otherwise, angles in degrees.
CASES = (
    Case(BETWEEN, ((28.0, 0.0, 1.0),)),
    Case(BETWEEN, ((46.5, 0.0, 1.0),)),
    Case("a light four times as bright", ((28.0, 0.0, 4.0),)),
    Case(ASIDE, ((28.0, 90.0, 1.0),)),
    Case(BEHIND, ((28.0, 180.0, 1.0),)),
    Case("light below the arc", ((3.0, 0.0, 1.0),)),
    Case("seen from 45 degrees", ((46.5, 0.0, 1.0),), (45.0, -90.0)),
)
LEFT_OUT = "photographs left out"
_MOST_LEFT_OUT = 3


@dataclass(frozen=True, eq=False)
class Subject:
    """A square swatch with what is known of it.

    Parameters
    ----------
    images : (n, S, S, 3) linear, in 1/sr or to a scale of their own
    directions : (n, 3) to the light; None where not known
    cases, frames : pictures to compare techniques by; `images` hold none of them
    swatch : its geometry, of a built-in one
    everything : (n, S, S, 3) with those that `cases` take, to measure maps by
    """

    name: str
    images: Images
    directions: Array | None
    cases: tuple[Case, ...]
    frames: techniques.Frames
    swatch: Swatch | None = None
    everything: Images | None = None

    @property
    def all_images(self) -> Images:
        """All photographs of the swatch."""
        return self.images if self.everything is None else self.everything


def built_in(name: str, file: Path, size: int, samples: int, progress: Callable[[float], None]) -> Subject:
    """A procedural swatch, photographed on the gantry; `file` keeps the frames for a later run."""
    swatch = SWATCHES[name](0)
    wanted = [Case("arc", ((elevation, 0.0, 1.0),)) for elevation in ARC]
    keys = sorted({frame for case in (*wanted, *CASES) for frame in case.frames})
    if file.is_file():
        pixels = np.load(file, allow_pickle=False)
    else:
        frames = []
        with gantry_scene(swatch, size=size, samples=samples) as gantry:
            for k, (view, light) in enumerate(keys):
                progress(k / len(keys))
                found = techniques.photograph(gantry, [Case("", ((*light, 1.0),), view)])
                frames.append(found[view, light])
        pixels = np.stack(frames)
        with replacing_file(file) as temporary, temporary.open("wb") as stream:
            np.save(stream, pixels)
    by_key = dict(zip(keys, pixels, strict=True))
    images = np.stack([by_key[case.frames[0]] for case in wanted])
    directions = np.array([techniques.direction(elevation, 0.0) for elevation in ARC])
    return Subject(name, images, directions, CASES, by_key, swatch)


def of_path(path: Path, name: str, size: int) -> Subject:
    """A folder of photographs, or the bundle of a shading map. Raises BakeError."""
    if is_bundle(path):
        images, directions = _square(ShadingMapRecord.read(read_bundle(path)).load_map().slices[1:], size), None
    else:
        stack = read_stack(path, StackSettings(size=2 * size), decoder=blender_decoder())
        images, directions = _square(stack.images, size), stack.directions
    if len(images) < LEAST_PHOTOGRAPHS:
        remedy = f"give {LEAST_PHOTOGRAPHS} or more, so that some can be predicted from the others"
        raise BakeError(path, f"holds {len(images)} photographs or slices of them", remedy)
    subject = Subject(name, images, directions, (), {})
    return subject if directions is None else _without_some(subject)


def _without_some(subject: Subject) -> Subject:
    """Some photographs between the darkest and the brightest become the pictures to compare by."""
    assert subject.directions is not None
    order = np.argsort(subject.images.mean((1, 2, 3)), kind="stable")
    inner = [int(k) for k in order[1:-1] if subject.directions[k, 2] > 0.02]
    if len(order) < 6 or not inner:
        return subject
    count = min(_MOST_LEFT_OUT, len(inner) // 2)
    chosen = sorted({inner[int((k + 0.5) * len(inner) / count)] for k in range(count)})
    cases, frames = [], {}
    for k in chosen:
        x, y, z = subject.directions[k]
        light = float(np.degrees(np.arcsin(z))), float(np.degrees(np.arctan2(y, x)))
        cases.append(Case(LEFT_OUT, ((*light, 1.0),)))
        frames[(0.0, 0.0), light] = subject.images[k]
    rest = np.delete(np.arange(len(subject.images)), chosen)
    return replace(
        subject,
        images=subject.images[rest],
        directions=subject.directions[rest],
        cases=tuple(cases),
        frames=frames,
        everything=subject.images,
    )


def _square(images: Images, size: int) -> Images:
    """The middle of the swatch, at most `size` texels across: whole photographs would take minutes."""
    height, width = images.shape[1:3]
    edge = min(height, width, size)
    top, left = (height - edge) // 2, (width - edge) // 2
    return np.ascontiguousarray(images[:, top : top + edge, left : left + edge], np.float32)


def names_of(paths: Sequence[Path]) -> list[str]:
    """A name for each, by its own."""
    return [path.resolve().stem if is_bundle(path) else path.resolve().name for path in paths]
