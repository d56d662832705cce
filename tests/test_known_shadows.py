"""The fit that is told the shadows, which `bench normals` holds `bake maps` against."""

from __future__ import annotations

import numpy as np
from measured_materials.bake.maps.normals import photometric_stereo
from support.known_shadows import normals_of
from support.relief import bumps, lights, photographs

LIGHTS = lights((25, 50, 75), 8, zenith=False)


def test_normals_are_found_where_shadows_are_known() -> None:
    heights = bumps(24)
    images, unhidden = (photographs(heights, LIGHTS, shadows) for shadows in (True, False))
    right, up = ((np.roll(heights, -s, k) - np.roll(heights, s, k)) / 2 for s, k in ((1, 1), (-1, 0)))
    truth = np.stack([-right, -up, np.ones_like(right)], -1)
    truth /= np.linalg.norm(truth, axis=-1, keepdims=True)
    visibility = np.divide(images.sum(-1), unhidden.sum(-1), out=np.zeros(images.shape[:3]), where=unhidden.sum(-1) > 0)

    def off(normals: np.ndarray) -> np.ndarray:
        return np.degrees(np.arccos(np.clip((normals * truth).sum(-1), -1, 1)))

    told, plain = (
        off(normals_of(images, visibility, LIGHTS)),
        off(photometric_stereo(images, LIGHTS, robust=False).normals),
    )
    assert told.max() < 0.1 < 1 < plain.mean()
