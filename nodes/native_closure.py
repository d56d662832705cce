"""Cycles' own closures that equal an f_r of a shading map, or lie under it (addon/docs/method.md, section 12)."""

from __future__ import annotations

import math
from typing import Any

from ..bake.envelope.anisotropic_lobes import AnisotropicLobe
from ..bake.lobes.lobes import PHONG, Lobe
from . import expr
from .gloss_group import glossy_roughness
from .lobe_group import oren_nayar_closure


def native_closure(
    lobe: Lobe | AnisotropicLobe, weight: Any, normal: Any, tangent: Any = None, gloss: Any = None
) -> Any:
    """Closure of the lobe's native part times a colour; a lobe of two widths takes a tangent in world space.

    A gloss divides the widths of GGX; what is matt stays as it is.
    """
    if isinstance(lobe, AnisotropicLobe):
        kind, properties, inputs = _anisotropic(lobe, tangent)
    elif lobe.name == "oren_nayar":
        return oren_nayar_closure(weight, normal, lobe.p1)
    else:
        kind, properties, inputs = _NATIVE[lobe.name](lobe)
    if gloss is not None and lobe.name == "ggx":
        inputs["Roughness"] = glossy_roughness(inputs["Roughness"], gloss)
    made = expr.node(kind, properties, {"Color": weight, "Normal": normal, **inputs})
    return expr.Scalar(made.outputs[0])


def translucent_closure(weight: Any, normal: Any) -> Any:
    """Closure of Lambertian transmission times a colour."""
    made = expr.node("ShaderNodeBsdfTranslucent", {}, {"Color": weight, "Normal": normal})
    return expr.Scalar(made.outputs[0])


def has_native(lobe: Lobe) -> bool:
    """Whether a closure of Cycles carries the lobe or a part of it."""
    return lobe.native_share > 0


def viewport_closures(lobe: Lobe, normal: Any, colour: Any) -> list[Any]:
    """Closures that look like the whole lobe times a colour, for EEVEE and mode Preview."""
    if lobe.name not in PHONG:
        return [native_closure(lobe, colour, normal)]
    glossy = expr.node(
        "ShaderNodeBsdfAnisotropic",
        {"distribution": "GGX"},
        {
            "Color": expr.scale(colour, 1 - lobe.native_share),
            "Roughness": highlight_roughness(lobe),
            "Normal": normal,
        },
    )
    diffuse = native_closure(lobe, expr.scale(colour, lobe.native_share), normal)
    return [diffuse, expr.Scalar(glossy.outputs[0])]


def highlight_roughness(lobe: Lobe) -> float:
    """Of the GGX lobe whose peak has the curvature of Phong's cos^n about the mirror direction."""
    return float((8 / (lobe.p1 + 2)) ** 0.25)


def add_closures(closures: list[Any]) -> Any:
    """Closure that is the sum of several; black where there are none."""
    if not closures:
        return expr.Scalar(expr.node("ShaderNodeBsdfDiffuse", {}, {"Color": expr.vec(0.0, 0.0, 0.0)}).outputs[0])
    total = closures[0]
    for closure in closures[1:]:
        total = expr.Scalar(expr.node("ShaderNodeAddShader", {}, {0: total, 1: closure}).outputs[0])
    return total


def choose_closure(condition: Any, otherwise: Any, chosen: Any) -> Any:
    """One of two closures; Cycles skips the nodes of the one that a factor of 0 or 1 leaves out."""
    return expr.Scalar(expr.node("ShaderNodeMixShader", {}, {0: condition, 1: otherwise, 2: chosen}).outputs[0])


_Closure = tuple[str, dict[str, Any], dict[str, Any]]


def _diffuse(lobe: Lobe) -> _Closure:
    return "ShaderNodeBsdfDiffuse", {}, {"Roughness": 0.0}


def _glossy(lobe: Lobe) -> _Closure:
    return "ShaderNodeBsdfAnisotropic", {"distribution": "GGX"}, {"Roughness": math.sqrt(lobe.p1)}


def _sheen(lobe: Lobe) -> _Closure:
    return "ShaderNodeBsdfSheen", {"distribution": "ASHIKHMIN"}, {"Roughness": lobe.p1}


def _anisotropic(lobe: AnisotropicLobe, tangent: Any) -> _Closure:
    if lobe.name == "lambert":
        return "ShaderNodeBsdfDiffuse", {}, {"Roughness": 0.0}
    widths = {"Roughness": lobe.roughness, "Anisotropy": lobe.anisotropy, "Rotation": 0.0, "Tangent": tangent}
    return "ShaderNodeBsdfAnisotropic", {"distribution": "GGX"}, widths


_NATIVE = {"lambert": _diffuse, "ggx": _glossy, "sheen": _sheen, **dict.fromkeys(PHONG, _diffuse)}
