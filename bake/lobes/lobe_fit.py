"""The lobe that fits a swatch, by the averages of its photographs along the arc (`bake photographs --lobe auto`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import BakeError
from ..source import Facts
from .lobes import PARAMETERS, Lobe

# A lobe must come this much closer, in parts of the root mean square of the averages, to be preferred to one of fewer
# parameters: what photographs of a swatch repeat at best.
WORTH = 0.01
# And this much closer to be glossy: seen from above, fibres that hide each other fall off like gloss (tried: GGX fitted
# to jeans within 0.01 is wrong by 78 % in oblique views, Oren-Nayar by 41 %).
WORTH_GLOSS = 0.05
MATTE = ("lambert", "oren_nayar")
_GRID = {
    "oren_nayar": np.linspace(0.05, 1, 39),
    "ggx": np.geomspace(0.01, 1, 81),
    "sheen": np.linspace(0.05, 1, 77),
    "phong": np.geomspace(1, 2000, 81),
}
# Names tried. Of Phong's curves cos^n alone: an arc of photographs does not distinguish them.
FITTED = ("lambert", *_GRID)
_ZOOMS, _ZOOM_POINTS = 3, 17


@dataclass(frozen=True)
class Candidate:
    """The best lobe of its name, `scale` so that averages ~ scale f_r cos(theta_i), and the relative RMS left."""

    lobe: Lobe
    scale: float
    residual: float


@dataclass(frozen=True)
class LobeFit:
    """The lobe chosen, and the best of every other.

    Attributes
    ----------
    scale : averages ~ scale f_r cos(theta_i)
    residual : root mean square of what is left, in parts of that of the averages
    candidates : best of each name in FITTED that there were photographs enough for
    """

    lobe: Lobe
    scale: float
    residual: float
    candidates: dict[str, Candidate]

    def facts(self) -> Facts:
        """JSON-ready."""
        tried = {n: {**c.lobe.facts(), "scale": c.scale, "residual": c.residual} for n, c in self.candidates.items()}
        return {"lobe": self.lobe.facts(), "scale": self.scale, "residual": self.residual, "candidates": tried}


def fit_lobe(elevations: ArrayLike, averages: ArrayLike) -> LobeFit:
    """Least squares of average radiances, seen from the normal, against f_r(wi, n) cos(theta_i).

    Parameters
    ----------
    elevations : (n,) of the light in radians above the swatch, strictly between 0 and pi
    averages : (n,) average radiance of each photograph, in any unit; any order

    Returns
    -------
    The lobe with the least residual, unless one with fewer parameters comes within WORTH of it, or a matte one within
    WORTH_GLOSS. A lobe needs at least one photograph more than it has parameters, its scale included, to be tried.

    Raises
    ------
    BakeError : no photograph, sizes that differ, values out of range, or no light in any
    """
    cosines, values = _checked(elevations, averages)
    wi = np.stack([np.sqrt((1 - cosines) * (1 + cosines)), np.zeros_like(cosines), cosines], -1)
    candidates = {}
    for name in FITTED:
        unknowns = 1 + len(PARAMETERS[name])
        if name == "lambert" or len(np.unique(cosines)) > unknowns:
            candidates[name] = _best_of(name, wi, values)
    chosen = _simplest([c for c in candidates.values() if c.lobe.name in MATTE])
    other = _simplest(list(candidates.values()))
    if other.residual < chosen.residual - WORTH_GLOSS:
        chosen = other
    return LobeFit(chosen.lobe, chosen.scale, chosen.residual, candidates)


def _simplest(candidates: list[Candidate]) -> Candidate:
    """Of those about as good as the best the one of fewest parameters; among equally many the better fit."""
    least = min(c.residual for c in candidates)
    close = [c for c in candidates if c.residual <= least + WORTH]
    return min(close, key=lambda c: (len(PARAMETERS[c.lobe.name]), c.residual))


def _checked(elevations: ArrayLike, averages: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    try:
        angle, values = np.asarray(elevations, np.float64), np.asarray(averages, np.float64)
    except (TypeError, ValueError) as error:
        raise BakeError(
            "lobe fit", "elevations or averages are no numbers", "give one of each per photograph"
        ) from error
    if angle.ndim != 1 or angle.shape != values.shape or not len(angle):
        cause = f"{angle.size} elevations and {values.size} averages"
        raise BakeError("lobe fit", cause, "give one of each per photograph")
    if not ((angle > 0) & (angle < np.pi)).all():
        raise BakeError("lobe fit", "a light stands on or below the horizon", "leave that photograph out")
    if not (np.isfinite(values) & (values >= 0)).all() or values.max() == 0:
        raise BakeError("lobe fit", "averages are negative, not finite, or all 0", "check the photographs")
    # Beyond the float32 range of photographs squares could overflow.
    if values.max() > 1e38 or values.max() < 1e-38:
        raise BakeError("lobe fit", f"averages reach {values.max():g}", "scale the photographs")
    return np.sin(angle), values


def _best_of(name: str, wi: NDArray[np.float64], values: NDArray[np.float64]) -> Candidate:
    if name == "lambert":
        return _fitted(Lobe(name), wi, values)
    grid = _GRID[name]
    best = min((_at(name, p, wi, values) for p in grid), key=lambda c: c.residual)
    step = np.max(grid[1:] / grid[:-1])
    for _ in range(_ZOOMS):
        finer = np.clip(best.lobe.p1 * step ** np.linspace(-1, 1, _ZOOM_POINTS), grid[0], grid[-1])
        best = min((best, *(_at(name, p, wi, values) for p in finer)), key=lambda c: c.residual)
        step **= 2 / (_ZOOM_POINTS - 1)
    return best


def _at(name: str, p1: float, wi: NDArray[np.float64], values: NDArray[np.float64]) -> Candidate:
    if name != "phong":
        return _fitted(Lobe(name, float(p1)), wi, values)
    lobe, base = _model(Lobe(name, float(p1), 0.0), wi), _model(Lobe("lambert"), wi)
    specular, diffuse = _two_scales(lobe, base, values)
    return _fitted(Lobe(name, float(p1), diffuse / (specular + diffuse)), wi, values)


def _two_scales(a: NDArray[np.float64], b: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float]:
    """Non-negative least squares of two curves, not both 0."""
    both = np.linalg.lstsq(np.stack([a, b], -1), values, rcond=None)[0]
    if (both >= 0).all() and both.sum() > 0:
        return float(both[0]), float(both[1])
    alone = [float(curve @ values) / float(curve @ curve) if curve @ curve > 0 else 0.0 for curve in (a, b)]
    left = [float(((values - scale * curve) ** 2).sum()) for scale, curve in zip(alone, (a, b))]
    return (alone[0], 0.0) if left[0] < left[1] else (0.0, alone[1])


def _model(lobe: Lobe, wi: NDArray[np.float64]) -> NDArray[np.float64]:
    return lobe.value(wi, np.array([0.0, 0.0, 1.0])) * wi[:, 2]


def _fitted(lobe: Lobe, wi: NDArray[np.float64], values: NDArray[np.float64]) -> Candidate:
    model = _model(lobe, wi)
    # Brought near to 1 first: a lobe may be as small as exp(-400) all along the arc.
    top, unit = float(model.max()), float(values.max())
    if top < 1e-30:
        return Candidate(lobe, 0.0, 1.0)
    model, relative = model / top, values / unit
    scale = float(model @ relative) / float(model @ model)
    residual = float(np.sqrt(((relative - scale * model) ** 2).mean() / (relative**2).mean()))
    return Candidate(lobe, scale * unit / top, residual)
