"""Node groups: value, peak and sampling of an f_r of a shading map; and Oren-Nayar's closure under any weight."""

from __future__ import annotations

from typing import Any

import bpy

from ..bake.lobes.lobe_sampling import lobe_pdf, sample_lobe
from ..bake.lobes.lobes import lobe_peak, lobe_value, parameters_of
from . import expr
from .group import node_group

# A weight times this is a colour above 1, where Cycles' Oren-Nayar takes the surface for white.
_BRIGHTENED = 1e4

_PARAMETERS = {"P1": "float", "P2": "float"}
_RANDOM = {"Random Azimuth": "float", "Random Polar": "float", "Random Choice": "float"}


def lobe_group(name: str) -> bpy.types.ShaderNodeTree:
    """(wi, wo, P1, P2) to f_r in 1/sr, without the cosine; one of `bake.lobes.lobes.LOBES`."""

    def value(wi: Any, wo: Any, p1: Any, p2: Any) -> Any:
        return lobe_value(expr, name, wi, wo, p1, p2)

    return node_group(
        f"MM Lobe {_title(name)}",
        {"wi": "vector", "wo": "vector", **_PARAMETERS},
        {"BRDF": "float"},
        value,
        _defaults(name),
    )


def lobe_peak_group(name: str) -> bpy.types.ShaderNodeTree:
    """(wo, P1, P2) to an upper bound of f_r cos(theta_i) over all wi."""

    def peak(wo: Any, p1: Any, p2: Any) -> Any:
        return lobe_peak(expr, name, wo, p1, p2)

    return node_group(
        f"MM Lobe Peak {_title(name)}", {"wo": "vector", **_PARAMETERS}, {"Peak": "float"}, peak, _defaults(name)
    )


def sample_lobe_group(name: str) -> bpy.types.ShaderNodeTree:
    """(wo, three random numbers, P1, P2) to (wi, pdf, BRDF); the value comes along, since it shares most nodes."""

    def sample(wo: Any, u1: Any, u2: Any, u_choice: Any, p1: Any, p2: Any) -> tuple[Any, Any, Any]:
        wi, pdf = sample_lobe(expr, name, wo, u1, u2, u_choice, p1, p2)
        return wi, pdf, lobe_value(expr, name, wi, wo, p1, p2)

    outputs = {"wi": "vector", "pdf": "float", "BRDF": "float"}
    return node_group(
        f"MM Lobe Sample {_title(name)}", {"wo": "vector", **_RANDOM, **_PARAMETERS}, outputs, sample, _defaults(name)
    )


def lobe_pdf_group(name: str) -> bpy.types.ShaderNodeTree:
    """(wi, wo, P1, P2) to the density with which `sample_lobe_group` draws wi, which must lie above the horizon."""

    def density(wi: Any, wo: Any, p1: Any, p2: Any) -> Any:
        return lobe_pdf(expr, name, wi, wo, p1, p2)

    return node_group(
        f"MM Lobe Density {_title(name)}",
        {"wi": "vector", "wo": "vector", **_PARAMETERS},
        {"pdf": "float"},
        density,
        _defaults(name),
    )


def oren_nayar_closure(weight: Any, normal: Any, roughness: Any) -> Any:
    """Diffuse BSDF of this roughness whose light is the "oren_nayar" lobe times a coloured weight, channel by channel.

    From Blender 4.3 on the closure adds light scattered several times, in proportion to the square of its colour held
    to 1: as a colour, a weight of 0.5 gives 0.44 of what white gives (roughness 0.5, light and viewer at the normal). A
    factor of Mix Shader scales the finished closure instead. So the colour is the weight times 10000, beyond 1 and so
    white to that term, and the factor 1 / 10000. Weights below 1 / 10000 fall short of the lobe by at most that term.
    """
    made = expr.node(
        "ShaderNodeBsdfDiffuse",
        {},
        {"Color": expr.scale(weight, _BRIGHTENED), "Roughness": roughness, "Normal": normal},
    )
    mixed = expr.node("ShaderNodeMixShader", {}, {0: 1 / _BRIGHTENED, 2: expr.Scalar(made.outputs[0])})
    return expr.Scalar(mixed.outputs[0])


def _title(name: str) -> str:
    return name.replace("_", " ").title()


def _defaults(name: str) -> dict[str, float]:
    return {f"P{k + 1}": parameter.default for k, parameter in enumerate(parameters_of(name))}
