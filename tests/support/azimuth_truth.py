"""What a material of a map over azimuth must show on a plane: in float64 numpy, by quadrature over a wide sun."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from measured_materials.addon.gantry.photograph_arc import gantry_scene
from measured_materials.addon.gantry.scene import Gantry
from measured_materials.addon.gantry.techniques import direction, frame_uv, pixels
from measured_materials.bake.images.bilinear import texels_around
from measured_materials.bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis
from measured_materials.bake.shading_maps.azimuth.azimuth_envelope import azimuth_envelope
from measured_materials.bake.shading_maps.render_settings import PREVIEW_LEVEL, RenderSettings

# A sun so wide that a mirror finds it by chance, off to a side of swatch and viewer.
SUN, VIEW, LIGHT = math.radians(40), (math.radians(35), math.radians(200)), (math.radians(48), math.radians(70))
SIZE, _OVER, _DIRECTIONS = 16, 4, 1000

# How texture coordinates lie on the plane: u and v by x and y.
LAYOUTS = {
    "straight": np.eye(2),
    "turned": np.array([[math.cos(2.1), -math.sin(2.1)], [math.sin(2.1), math.cos(2.1)]]),
    "mirrored": np.array([[-0.8, 0.6], [0.6, 0.8]]),
    "sheared": np.array([[1.0, 0.8], [-0.2, 0.7]]),
    "mirrored and sheared": np.array([[-1.1, 0.4], [0.3, 0.9]]),
}


def between(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Of (H, W, ...), linear between the texels."""
    total = 0.0
    for index, weight in texels_around(texels.shape[:2], uv.astype(np.float64)):
        total = total + weight.reshape(*weight.shape, *[1] * (texels.ndim - 2)) * texels[index]
    return np.asarray(total)


@dataclass(frozen=True)
class Texels:
    """A map between the texels at places (P) of the swatch: coefficients (P, 3, rank) and envelope m (P, 3)."""

    basis: AzimuthBasis
    coefficients: np.ndarray
    envelope: np.ndarray

    @classmethod
    def at(cls, basis: AzimuthBasis, uv: np.ndarray) -> Texels:
        """At uv (P, 2)."""
        return cls(basis, between(basis.coefficients, uv), between(azimuth_envelope(basis).envelope, uv))

    def looked_up(self, x: np.ndarray | float, phi: np.ndarray | float, above: str) -> np.ndarray:
        """max(sum, m x) (P, 3); x and phi one number, or (P,), or x (P, 3)."""
        x, phi = np.asarray(x, np.float64), np.asarray(phi, np.float64)
        x = x if x.ndim == 2 else x.reshape(-1, 1)
        weights = self.basis.weights(x, phi.reshape(-1, 1))
        sums = (self.coefficients * weights).sum(-1)
        return np.maximum(sums, self.envelope * np.minimum(x, 1)) * (np.maximum(x, 1) if above == "scale" else 1)

    def still(self, x: float) -> np.ndarray:
        """Lit from all around at one level: the curves' mean over azimuth, linear between even levels."""
        _, azimuths, levels = self.basis.curves.shape
        even, turns = np.linspace(0, 1, levels), np.arange(azimuths) / azimuths
        means = self.basis.weights(even[:, None], 2 * np.pi * turns).mean(1)
        mean = np.array([np.interp(x, even, one) for one in means.T])
        return np.maximum(self.coefficients @ mean, self.envelope * min(x, 1))


def sun_directions() -> tuple[np.ndarray, float]:
    """Directions (n, 3) that stand for the sun's disk, and the irradiance of each on a plane facing it, 1 in all."""
    half, turn = SUN / 2, np.arange(_DIRECTIONS) * (math.pi * (3 - math.sqrt(5)))
    cosine = 1 - (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS * (1 - math.cos(half))
    sine = np.sqrt(1 - cosine**2)
    z = np.array(direction(90 - math.degrees(LIGHT[0]), math.degrees(LIGHT[1])))
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    local = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], -1)
    return local @ np.stack([x, np.cross(z, x), z]), 2 / (1 + math.cos(half)) / _DIRECTIONS


def azimuth_in(layout: np.ndarray, wi: np.ndarray) -> float:
    """Azimuth of a direction in a swatch that lies so: from where u grows towards where v grows across that."""
    edges = np.linalg.inv(layout)  # columns: how the place changes with u and with v
    along_u = edges[:, 0] / np.linalg.norm(edges[:, 0])
    along_v = edges[:, 1] - along_u * (along_u @ edges[:, 1])
    along_v /= np.linalg.norm(along_v)
    return math.atan2(wi[:2] @ along_v, wi[:2] @ along_u)


@dataclass(frozen=True)
class LaidOut:
    """A swatch of these texels, lit as the settings say, on a plane whose texture coordinates lie so."""

    basis: AzimuthBasis
    settings: RenderSettings
    layout: np.ndarray

    def picture(self, a_max: float) -> np.ndarray:
        """(SIZE, SIZE, 3) of the gantry's camera, at the photographs' brightest level."""
        # Beside the tile lie others with coordinates of their own.
        uv = frame_uv(SIZE, VIEW, _OVER) % 1 @ self.layout.T
        texels = Texels.at(self.basis, uv.reshape(-1, 2))
        total = np.zeros(texels.envelope.shape)
        wo = np.array(direction(90 - math.degrees(VIEW[0]), math.degrees(VIEW[1])))
        directions, irradiance = sun_directions()
        settings = self.settings
        assert settings.lobe is not None and settings.sigma is not None
        for wi in directions:
            f_cos = float(settings.lobe.value(wi, wo)) * wi[2]
            lit = self._reflected(texels, f_cos, float(wi[2]), azimuth_in(self.layout, wi), a_max)
            total += irradiance * lit
        return pixels(total.reshape(*uv.shape[:2], 3), _OVER)

    def _reflected(self, texels: Texels, f_cos: float, cosine: float, phi: float, a_max: float) -> np.ndarray:
        settings = self.settings
        if settings.technique == "lit_texture":
            return texels.still(1.0) * (settings.sigma * f_cos)
        if settings.mode == "preview":
            return texels.still(PREVIEW_LEVEL) * (settings.sigma * f_cos / PREVIEW_LEVEL)
        if settings.technique == "angular":
            return texels.looked_up(cosine, phi, "clamp") * (settings.sigma * f_cos / cosine)
        return a_max * texels.looked_up(f_cos * settings.sigma / a_max, phi, settings.above)

    @contextmanager
    def gantry(self, material: bpy.types.Material, samples: int) -> Iterator[Gantry]:
        """The scene of `picture`."""
        with gantry_scene(material, size=SIZE, samples=samples, sun_angle=SUN) as made:
            mesh = made.tile_objects[0].data
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) @ self.layout.T
            mesh.uv_layers[0].data.foreach_set("uv", corners.astype(np.float32).ravel())
            made.set_view(*VIEW)
            made.set_light(*LIGHT)
            yield made
