"""Maps of fewer texels, for a swatch that is seen from far away: what normals varied by becomes roughness.

A mean of normals alone turns a relief with highlights on its slopes into a smooth mirror: too narrow a highlight, and
too bright (Toksvig 2005, "Mipmapping normal maps"). The mean of a lobe over texels is again about a lobe, about the
mean slope, as wide as lobe and slopes together: of slopes that are Gaussian the covariances add (Olano & Baker 2010,
"LEAN mapping", equation 8). alpha^2 / 2 is the variance of a Beckmann lobe's slopes along either axis, which gives
alpha'^2 = alpha^2 + var p + var q. GGX, whose own variance has no bound, is not closed under this: by that rule it
keeps the peak seen from above, but its tails take two fifths of the peak from a highlight that runs to the horizon.
`_SHARE` of the variance is about as far off in both views.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BakeError
from ..shading_maps.reduced_map import area_weights
from .height import slopes
from .write import Maps

MOST = 4096
# Tried from 0 to 1 on Gaussian facets: RMS of the highlight 0.14 from above and 0.39 to the horizon at 1, 0.58 and 0.16
# at 0.4; without any, 1.6 and 0.66.
_SHARE = 2 / 3
# Of a mean normal; of less the lobe is as wide as any.
_SHORTEST = 0.05


def filtered_roughness(xp: Any, roughness: Any, length: Any) -> Any:
    """Roughness where a renderer has averaged normals, by the length that their mean has left (Toksvig 2005).

    Of unit normals of Gaussian slopes the mean is about 1 / (1 + var) long, var that of the slopes along either axis.
    It becomes roughness as that of texels does which become one.

    Parameters
    ----------
    roughness : as of Principled BSDF, in [0, 1]
    length : of the mean normal, above 0; from 1 on nothing was averaged
    """
    varied = xp.maximum(1 / xp.maximum(length, _SHORTEST) - 1, 0.0) * (2 * _SHARE)
    square = roughness * roughness
    return xp.sqrt(xp.sqrt(xp.minimum(square * square + varied, 1.0)))


def reduced_maps(maps: Maps, factor: int) -> Maps:
    """Maps in which `factor` x `factor` texels are one; at 1 those given.

    Albedo, reflectance and height are the means. The lobes that a texel holds are weighed by their reflectance.

    Raises
    ------
    BakeError : the factor makes no sense
    """
    if not 1 <= factor <= MOST:
        raise BakeError("reduce", f"is {factor}", f"choose 1 to {MOST}")
    if factor == 1:
        return maps
    height, width = maps.height.shape
    down, across = (area_weights(side, max(1, side // factor)) for side in (height, width))

    def mean(values: Any) -> NDArray[np.float64]:
        return np.einsum("ih,hw...,jw->ij...", down, np.asarray(values, np.float64), across, optimize=True)

    p, q = slopes(maps.normal)
    mean_p, mean_q = mean(p), mean(q)
    varied = np.maximum(mean(p**2) - mean_p**2, 0) + np.maximum(mean(q**2) - mean_q**2, 0)
    reflectance = mean(maps.reflectance)
    width_of = maps.roughness.astype(np.float64) ** 4
    # Where nothing reflects all lobes count alike.
    weighed = mean(maps.reflectance * width_of) / np.where(reflectance > 0, reflectance, 1)
    alpha_2 = np.where(reflectance > 0, weighed, mean(width_of)) + _SHARE * varied
    normal = np.stack([-mean_p, -mean_q, np.ones_like(mean_p)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return Maps(
        normal.astype(np.float32),
        mean(maps.albedo).astype(np.float32),
        mean(maps.height).astype(np.float32),
        np.minimum(alpha_2, 1.0).astype(np.float32) ** np.float32(0.25),
        reflectance.astype(np.float32),
    )
