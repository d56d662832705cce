"""How a shading-map material is lit: its properties as settings, and the other way round."""

from __future__ import annotations

from typing import Any

import bpy

from ...bake.lobes.lobes import PARAMETERS, Lobe, Parameter
from ...bake.shading_maps.render_settings import RenderSettings
from .choices import without_rebuilding

# The choice of a measured BRDF among the lobes.
MEASURED = "measured"
# In front of the parameters' names of the base transmission.
THROUGH = "transmission_"
# Those named as in the settings.
_PLAIN = ("above", "technique", "tiling")


def number(value: float) -> float:
    """The number as it was typed: Blender keeps 0.3 as the nearest single-precision number."""
    return float(f"{value:.7g}")


def parameter_key(lobe: str, parameter: Parameter, front: str = "") -> str:
    """Name of the property that holds a lobe's parameter; behind `THROUGH` of the base transmission."""
    return f"{front}{lobe}_{parameter.name}"


def uses_mode(technique: str) -> bool:
    """Whether a technique goes by the light that is reflected, so that the mode and what is brighter matter."""
    return technique in ("lookup", "final_radiance")


def lighting_of(properties: Any, mode: str) -> RenderSettings:
    """The properties of the light, and the material's mode, as settings. Raises BakeError."""
    return RenderSettings(
        lobe=_lobe_of(properties, "lobe"),
        sigma=_given(properties.sigma, 1e-6),
        above=properties.above,
        technique=properties.technique,
        mode=mode,
        tiling=properties.tiling,
        a_max=_given(properties.a_max, 1e-9),
        transmission=_lobe_of(properties, "transmission", THROUGH) or Lobe("lambert"),
        transmission_sigma=_given(properties.transmission_sigma, 1e-6),
    )


def _lobe_of(properties: Any, name: str, front: str = "") -> Lobe | None:
    """The lobe that is chosen, with its parameters; None for a measured one."""
    lobe = getattr(properties, name)
    values = [number(getattr(properties, parameter_key(lobe, p, front))) for p in PARAMETERS.get(lobe, ())]
    return None if lobe == MEASURED else Lobe(lobe, *values)


def _show_lobe(properties: Any, name: str, lobe: Lobe | None, front: str = "") -> None:
    chosen = MEASURED if lobe is None else lobe.name
    setattr(properties, name, chosen)
    values = () if lobe is None else (lobe.p1, lobe.p2)
    for parameter, value in zip(PARAMETERS.get(chosen, ()), values):
        setattr(properties, parameter_key(chosen, parameter, front), value)


def _given(value: float, least: float) -> float | None:
    """0 stands for what is found by default."""
    return max(number(value), least) if value > 0 else None


def show_lighting(material: bpy.types.Material, settings: RenderSettings) -> None:
    """Set the material's properties, its mode among them, to how it is lit; nothing is rebuilt."""
    properties = material.measured_lighting
    with without_rebuilding():
        material.measured_quality.mode = settings.mode
        _show_lobe(properties, "lobe", settings.lobe)
        _show_lobe(properties, "transmission", settings.transmission, THROUGH)
        for name in _PLAIN:
            setattr(properties, name, getattr(settings, name))
        properties.sigma, properties.a_max = settings.sigma or 0.0, settings.a_max or 0.0
        properties.transmission_sigma = settings.transmission_sigma or 0.0
