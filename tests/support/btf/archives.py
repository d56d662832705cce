"""Figure 4 of Kautz et al. 2004 on a measured BTF: its compression beside maps of its own pictures from above."""

from __future__ import annotations

import numpy as np
from measured_materials.addon.gantry.techniques import direction, frame_uv
from measured_materials.bake.lobes.lobe_fit import fit_lobe
from measured_materials.bake.photographs.stack import PhotoStack
from measured_materials.bake.shading_maps.render_settings import RenderSettings

from .btf import Btf
from .figure_4 import ARC_MAP, AROUND_MAP, Rival, of_stack, rivals_of
from .rings import Array

GROUPS = (
    "from above, light along the arc",
    "from above, light from elsewhere",
    "obliquely, light along the arc",
    "obliquely, light from elsewhere",
)


def rivals_of_archive(btf: Btf) -> tuple[Rival, ...]:
    """Both compressions, and maps of the pictures seen from above: under lights of one arc, and under all."""
    _, whole_view, per_view = rivals_of(btf)
    along = [k for k, light in enumerate(btf.lights.angles) if _is_along(light)]
    arc, around = _stack(btf, along), _stack(btf, list(range(len(btf.lights.angles))))
    return (
        whole_view,
        per_view,
        of_stack(ARC_MAP, arc, "arc", _fitted(arc)),
        of_stack(AROUND_MAP, around, "all", _fitted(around)),
    )


def errors_of(rival: Rival, btf: Btf) -> dict[str, float]:
    """RMS of the difference from the pictures of a group, in parts of their RMS; every picture counts alike."""
    uv = frame_uv(btf.pictures.shape[2])
    found: dict[str, list[float]] = {group: [] for group in GROUPS}
    for view, row in zip(btf.views.angles, btf.pictures):
        for light, picture in zip(btf.lights.angles, row):
            shown = rival.radiance(uv, _towards(light), _towards(view))
            error = np.square(shown - picture).mean() / max(float(np.square(picture).mean()), 1e-30)
            found[GROUPS[2 * (view[0] > 0) + (not _is_along(light))]].append(float(error))
    return {group: float(np.sqrt(np.mean(each))) for group, each in found.items() if each}


def _stack(btf: Btf, lights: list[int]) -> PhotoStack:
    directions = np.array([_towards(btf.lights.angles[k]) for k in lights])
    names = tuple(str(btf.lights.angles[k]) for k in lights)
    return PhotoStack(btf.pictures[0, lights], names, directions, True, ())


def _fitted(stack: PhotoStack) -> RenderSettings:
    assert stack.directions is not None
    fit = fit_lobe(np.arcsin(stack.directions[:, 2]), stack.images.mean((1, 2, 3), dtype=np.float64))
    return RenderSettings(fit.lobe, fit.scale)


def _is_along(light: tuple[float, float]) -> bool:
    """On the arc of azimuth 0, up to the normal: of the other side shadows fall the other way."""
    return light[0] == 0 or light[1] == 0


def _towards(angles: tuple[float, float]) -> Array:
    return np.array(direction(90 - angles[0], angles[1]))
