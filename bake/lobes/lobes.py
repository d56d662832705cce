"""The reflectance f_r of a shading map: grey BRDFs that Cycles has closures for, and modified Phong.

Formulas take `xp`, numpy's or the shader nodes' namespace, wi and wo in any azimuth, and up to two parameters p1 and
p2 (`PARAMETERS`). They work on s = wi + wo and its parts, never on an angle: |s_xy| / |s| keeps all digits where
1 - cos theta_h has none left. Measured against Cycles 4.5 and 5.0 in `tests/test_native_closures.py`.

lambert     1 / pi: Diffuse BSDF of roughness 0.
oren_nayar  Fujii's rewriting of Oren & Nayar 1994 and a term for light scattered several times (OpenPBR 1.1, rough
            diffuse), for a white surface: Diffuse BSDF from Blender 4.3 on. That term holds the square of the closure's
            colour: only `nodes.lobe_group.oren_nayar_closure` makes it linear in a texture. Before 4.3 it is absent.
ggx         D G2 / (4 cos_i cos_o), height-correlated Smith, no Fresnel (Walter et al. 2007; Heitz 2014, equation 99):
            Glossy BSDF, distribution GGX, node roughness sqrt(alpha). Cycles takes 1 - cos^2 theta_h in float32: its
            own D is uncertain by up to 5e-7 / alpha^2 in parts, this one is not.
sheen       Inverse Gaussian D with the V-cavity G (Ashikhmin, Premoze & Shirley 2000): Sheen BSDF, distribution
            Ashikhmin, node roughness sigma.
phong       kd / pi + (1 - kd) (n + 2) / (2 pi) cos^n of the angle between wo and the mirrored wi (Lewis 1994, as in
            Kautz et al. 2004). Diffuse BSDF times kd is its native part, a lower bound.
phong_*     The same with another curve for cos^n, of unit albedo at normal incidence as that is: "schlick", "lyon",
            "cosine" and "cubic" of `bake.lobes.cosine_lobes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .. import xp_numpy
from ..errors import BakeError
from ..source import Array, Facts
from .cosine_lobes import COSINE_LOBES, cosine_lobe, half_chord_square, lobe_norm, steepest


class Parameter(NamedTuple):
    """Name, inclusive bounds and default of a lobe's parameter."""

    name: str
    low: float
    high: float
    default: float


_PHONG = (Parameter("exponent", 1.0, 1e4, 30.0), Parameter("diffuse", 0.0, 1.0, 0.2))
# Phong's model by the curve of its highlight.
PHONG: dict[str, str] = {"phong": "power"} | {f"phong_{name}": name for name in COSINE_LOBES if name != "power"}
PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    "lambert": (),
    "oren_nayar": (Parameter("roughness", 0.0, 1.0, 0.5),),
    # Cycles takes a GGX of alpha below 7e-4 for a perfect mirror; float32 directions end at about the same place.
    "ggx": (Parameter("alpha", 1e-3, 1.0, 0.3),),
    "sheen": (Parameter("sigma", 0.05, 1.0, 0.5),),
    **dict.fromkeys(PHONG, _PHONG),
}
LOBES: tuple[str, ...] = tuple(PARAMETERS)

# Cosines are held above this, so that the value at the horizon stays finite.
_GRAZING = 1e-6
# Below this square sine of theta_h the sheen is 0 in float64 for every sigma allowed.
_SHEEN_POLE = 1e-6


@dataclass(frozen=True)
class Lobe:
    """A lobe and its parameters; those left out take their defaults, those it does not have are 0.

    Raises
    ------
    BakeError : unknown name, or a parameter outside its bounds
    """

    name: str
    p1: float = None  # type: ignore[assignment]  # a number after __post_init__
    p2: float = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        known = parameters_of(self.name)
        for k, key in enumerate(("p1", "p2")):
            object.__setattr__(self, key, _checked(self.name, known[k] if k < len(known) else None, getattr(self, key)))

    @classmethod
    def of(cls, name: str, **parameters: float) -> Lobe:
        """Make a lobe by the parameters' own names: `Lobe.of("phong", exponent=60, diffuse=0.3)`. Raises BakeError."""
        names = [p.name for p in parameters_of(name)]
        if unknown := sorted(set(parameters) - set(names)):
            choices = f"choose from {', '.join(names)}" if names else "leave it out"
            raise BakeError(f"lobe {name}", f"has no parameter {', '.join(unknown)}", choices)
        return cls(name, *(parameters.get(n) for n in names))  # type: ignore[arg-type]

    @property
    def native_share(self) -> float:
        """Part of the lobe that its closure carries; of Phong's, Lambert's."""
        return self.p2 if self.name in PHONG else 1.0

    def facts(self) -> Facts:
        """JSON-ready: name and parameters; `bake.brdf.closures` reads it back."""
        values = (self.p1, self.p2)
        return {"name": self.name, **{p.name: values[k] for k, p in enumerate(PARAMETERS[self.name])}}

    def value(self, wi: Array, wo: Array) -> Array:
        """BRDF (...) in 1/sr of unit directions (..., 3)."""
        return np.asarray(lobe_value(xp_numpy, self.name, wi, wo, self.p1, self.p2))

    def peak(self, wo: Array) -> Array:
        """Upper bound (...) of f cos(theta_i) over all wi, seen from wo (..., 3)."""
        peak = lobe_peak(xp_numpy, self.name, wo, self.p1, self.p2)
        return np.broadcast_to(peak, np.shape(wo)[:-1])


def parameters_of(name: str) -> tuple[Parameter, ...]:
    """Parameters of a lobe. Raises BakeError for an unknown name."""
    if not isinstance(name, str) or name not in PARAMETERS:
        raise BakeError("lobe", f"there is none called {str(name)[:40]!r}", f"choose one of {', '.join(LOBES)}")
    return PARAMETERS[name]


def _checked(name: str, parameter: Parameter | None, value: Any) -> float:
    if parameter is None:
        if value is None or value == 0:
            return 0.0
        raise BakeError(f"lobe {name}", f"takes {len(PARAMETERS[name])} parameter(s)", f"leave {value!r} out")
    if value is None:
        return parameter.default
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number or not parameter.low <= value <= parameter.high:
        remedy = f"give a number from {parameter.low:g} to {parameter.high:g}"
        raise BakeError(f"lobe {name}", f"{parameter.name} = {value!r}", remedy)
    return float(value)


def lobe_value(xp: Any, name: str, wi: Any, wo: Any, p1: Any, p2: Any) -> Any:
    """BRDF f_r in 1/sr without the cosine: finite, >= 0, and 0 for wi on or below the horizon.

    Parameters
    ----------
    name : one of LOBES
    wi, wo : unit vectors of the namespace `xp`; wo above the horizon
    p1, p2 : parameters, numbers or scalars of `xp`; ignored where the lobe has none
    """
    cos_i = xp.components(wi)[2]
    return _VALUES[name](xp, wi, wo, p1, p2) * (cos_i > 0)


def lobe_peak(xp: Any, name: str, wo: Any, p1: Any, p2: Any) -> Any:
    """Upper bound over wi of f_r cos(theta_i), in 1/sr, seen from wo.

    Exact or nearly so at the normal. Elsewhere too high by at most a factor of 1.01 (oren_nayar), 1.25 (ggx),
    2 (sheen), 1.15 (phong) and 2 (phong_*), see `tests/test_shading_lobes.py`.
    """
    return _PEAKS[name](xp, wo, p1, p2)


def mirror_distance(xp: Any, wi: Any, wo: Any) -> Any:
    """u = 1 - cos of the angle between wo and the mirrored wi."""
    return half_chord_square(xp, wi * xp.vec(-1.0, -1.0, 1.0), wo)


def ggx_ndf(xp: Any, wi: Any, wo: Any, alpha: Any) -> Any:
    """GGX distribution D in 1/sr at the half vector of wi and wo."""
    s = wi + wo
    stretched = s * xp.vec(1.0, 1.0, alpha)
    ratio = xp.divide(xp.dot(s, s) * alpha, xp.dot(stretched, stretched))
    return ratio * ratio * (1 / math.pi)


def ggx_stretched(xp: Any, w: Any, alpha: Any) -> Any:
    """sqrt(alpha^2 (x^2 + y^2) + z^2), the length of w in the space where GGX is a hemisphere."""
    return xp.length(w * xp.vec(alpha, alpha, 1.0))


def _cosines(xp: Any, wi: Any, wo: Any) -> tuple[Any, Any]:
    return xp.maximum(xp.components(wi)[2], _GRAZING), xp.maximum(xp.components(wo)[2], _GRAZING)


def _lambert(xp: Any, wi: Any, wo: Any, p1: Any, p2: Any) -> Any:
    return 1 / math.pi


# (1 - E(theta)) / (a sigma) = _G0 - G(theta), E the albedo of light scattered once; its mean over the hemisphere.
_G0 = math.pi / 2 - 2 / 3
_MEAN_LOSS = _G0 - (2 * math.pi - 5.6) / 3


def _oren_nayar_loss(xp: Any, cosine: Any) -> Any:
    """_G0 - G(theta), where nothing is divided by the cosine: tan (1 - sin^3) = s c (1 + s + s^2) / (1 + s)."""
    sine = xp.sqrt((1 - cosine) * (1 + cosine))
    theta = math.pi / 2 - xp.arcsin(cosine)
    last = cosine * (2 / 3) * (1 + sine * (1 + sine)) / (1 + sine)
    return _G0 - sine * (theta - 2 / 3 - sine * cosine + last)


def _oren_nayar(xp: Any, wi: Any, wo: Any, roughness: Any, p2: Any) -> Any:
    cos_i, cos_o = _cosines(xp, wi, wo)
    a = 1 / (roughness * _G0 + math.pi)
    t = xp.dot(wi, wo) - cos_i * cos_o
    t = xp.where(t > 0, xp.divide(t, xp.maximum(cos_i, cos_o)), t)
    lost = _oren_nayar_loss(xp, cos_i) * _oren_nayar_loss(xp, cos_o)
    return a * (1 + roughness * (t + lost * (1 / (math.pi * _MEAN_LOSS))))


def _ggx(xp: Any, wi: Any, wo: Any, alpha: Any, p2: Any) -> Any:
    cos_i, cos_o = _cosines(xp, wi, wo)
    masked = cos_o * ggx_stretched(xp, wi, alpha) + cos_i * ggx_stretched(xp, wo, alpha)
    return ggx_ndf(xp, wi, wo, alpha) * 0.5 / masked


def _sheen(xp: Any, wi: Any, wo: Any, sigma: Any, p2: Any) -> Any:
    cos_i, cos_o = _cosines(xp, wi, wo)
    s = wi + wo
    across = s * xp.vec(1.0, 1.0, 0.0)
    square = xp.dot(s, s)
    x = xp.maximum(xp.divide(xp.dot(across, across), square), _SHEEN_POLE)
    # cos theta_h / cos theta_d, of which G is twice the smaller cosine's share
    ratio = xp.divide(2 * (cos_i + cos_o), square)
    masked = xp.minimum(2 * ratio * xp.minimum(cos_i, cos_o), 1.0)
    return _sheen_ndf(xp, x, sigma) * 0.25 * masked / (cos_i * cos_o)


def _sheen_ndf(xp: Any, x: Any, sigma: Any) -> Any:
    """D at sin^2 theta_h = x."""
    square = sigma * sigma
    return xp.exp((1 - 1 / x) / square) / (math.pi * square * (x * x))


def _phong(xp: Any, wi: Any, wo: Any, exponent: Any, diffuse: Any, curve: str = "power") -> Any:
    highlight = cosine_lobe(xp, curve, mirror_distance(xp, wi, wo), exponent) * lobe_norm(xp, curve, exponent)
    return diffuse * (1 / math.pi) + highlight * (1 - diffuse)


def _lambert_peak(xp: Any, wo: Any, p1: Any, p2: Any) -> Any:
    return 1 / math.pi


def _oren_nayar_peak(xp: Any, wo: Any, roughness: Any, p2: Any) -> Any:
    """A cos + B sin of theta_i never exceeds sqrt(A^2 + B^2): t cos_i <= sin_o sin_i, and the loss is largest at n."""
    cos_o = xp.minimum(xp.maximum(xp.components(wo)[2], 0.0), 1.0)
    upright = 1 + roughness * _oren_nayar_loss(xp, cos_o) * (_G0 / (math.pi * _MEAN_LOSS))
    along = roughness * roughness * ((1 - cos_o) * (1 + cos_o))
    return xp.sqrt(upright * upright + along) / (roughness * _G0 + math.pi)


def _ggx_peak(xp: Any, wo: Any, alpha: Any, p2: Any) -> Any:
    """D <= 1 / (pi alpha^2) and |wi|_alpha >= cos_i."""
    cos_o = xp.maximum(xp.components(wo)[2], _GRAZING)
    return 1 / (2 * math.pi * (alpha * alpha) * (cos_o + ggx_stretched(xp, wo, alpha)))


def _sheen_peak(xp: Any, wo: Any, sigma: Any, p2: Any) -> Any:
    """Maximum over x = sin^2 theta_h of D(x) G(x) / (4 cos_o) with G(x) <= min(1, 2 (1 - x), 4 (x_m - x)).

    The half vector leans by at most x_m = (1 + sin_o) / 2. G = 2 (1 - x) is reached where cos_i = cos_o, and beyond
    x = sin_o^2 the light meets the horizon. D times either line has its maximum at the root x_1 or x_2 of a quadratic
    equation; the lines cross at x = sin_o.
    """
    cos_o = xp.minimum(xp.maximum(xp.components(wo)[2], _GRAZING), 1.0)
    sin_o = xp.sqrt((1 - cos_o) * (1 + cos_o))
    twice = 2 * (sigma * sigma)
    y_m = 2 / (1 + sin_o)
    x_1 = 2 / (1 + twice + xp.sqrt(1 + twice * twice))
    x_2 = 2 / (y_m + twice + xp.sqrt(y_m * y_m + twice * twice))
    x_m = 0.5 + 0.5 * sin_o
    x = xp.maximum(x_2, xp.minimum(sin_o, x_1))
    # For sigma <= 1 D rises up to x = 1 / 2, and further to the left G is 1.
    x = xp.maximum(x, xp.minimum(x_m - 0.25, 0.5))
    masked = xp.minimum(xp.minimum(2 * (1 - x), 4 * (x_m - x)), 1.0)
    return _sheen_ndf(xp, x, sigma) * masked * 0.25 / cos_o


def _phong_peak(xp: Any, wo: Any, exponent: Any, diffuse: Any) -> Any:
    """Lambert's maximum plus the lobe's: cos_i cos^n is largest at the angle of tangent t from the mirror direction."""
    cos_o = xp.minimum(xp.maximum(xp.components(wo)[2], 0.0), 1.0)
    sine2 = (1 - cos_o) * (1 + cos_o)
    sin_o = xp.sqrt(sine2)
    steep = (exponent + 1) * cos_o
    t = 2 * sin_o / (steep + xp.sqrt(steep * steep + 4 * exponent * sine2))
    highest = (cos_o + sin_o * t) * xp.power(1 / (1 + t * t), 0.5 * exponent + 0.5)
    lobe = (exponent + 2) * (1 - diffuse) * (0.5 / math.pi)
    return diffuse * (1 / math.pi) + lobe * highest


def _other_phong_peak(xp: Any, wo: Any, exponent: Any, diffuse: Any, curve: str) -> Any:
    """cos_i <= cos_o cos x + sin_o sin x at the angle x from the mirror direction; either part at its largest."""
    cos_o = xp.minimum(xp.maximum(xp.components(wo)[2], 0.0), 1.0)
    sin_o = xp.sqrt((1 - cos_o) * (1 + cos_o))
    highest = xp.minimum(cos_o + sin_o * steepest(xp, curve, exponent), 1.0)
    return diffuse * (1 / math.pi) + highest * lobe_norm(xp, curve, exponent) * (1 - diffuse)


_Formula = Callable[..., Any]
_VALUES: dict[str, _Formula] = {
    "lambert": _lambert,
    "oren_nayar": _oren_nayar,
    "ggx": _ggx,
    "sheen": _sheen,
    **{name: partial(_phong, curve=curve) for name, curve in PHONG.items()},
}
_PEAKS: dict[str, _Formula] = {
    "lambert": _lambert_peak,
    "oren_nayar": _oren_nayar_peak,
    "ggx": _ggx_peak,
    "sheen": _sheen_peak,
    **{name: partial(_other_phong_peak, curve=curve) for name, curve in PHONG.items()},
    "phong": _phong_peak,
}
