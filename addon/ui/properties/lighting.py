"""How a shading map is lit, as Blender properties: changed on a material they rebuild it at once, without a bake."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any

import bpy

from ....bake.lobes.lobes import LOBES, PARAMETERS, Parameter
from ....bake.shading_maps.render_settings import (
    TECHNIQUES,
    TILINGS,
    UNCALIBRATED_SIGMA,
    UNCALIBRATED_TRANSMISSION,
    RenderSettings,
)
from ....bake.shading_maps.shading_map import ABOVE
from ...material.kinds import rebuild_or_say
from ...material.lighting import MEASURED, THROUGH, parameter_key, uses_mode
from .enum_items import enum
from .quality import mode_property
from .registration import registration

_USUAL = RenderSettings()

# What a choice is called and does; choices themselves are those of the settings, in their order.
_WORDS = {
    "lambert": ("Diffuse", "The same in all directions"),
    "oren_nayar": ("Rough Diffuse", "Oren-Nayar: flatter towards the rim, as plaster or suede"),
    "ggx": ("Glossy", "GGX"),
    "sheen": ("Sheen", "Brighter towards the rim, as velvet"),
    "phong": ("Phong", "A diffuse part and a highlight (Kautz et al. 2004)"),
    "phong_schlick": ("Phong, Schlick", "With a quotient for the highlight, and its wide foot (Schlick 1994)"),
    "phong_lyon": ("Phong, Lyon", "With a highlight that ends (Lyon 1993)"),
    "phong_cosine": ("Phong, Cosine", "With the fourth power of a stretched cosine for the highlight, which ends"),
    "phong_cubic": ("Phong, Cubic", "With a cubic for the highlight and a wide foot (Romanyuk 2007)"),
    MEASURED: ("Measured BRDF", "A baked BRDF"),
    "clamp": ("Clamp", "Stay with the brightest photograph"),
    "scale": ("Scale", "Brighten the brightest photograph in proportion"),
    "lookup": ("Lookup", "The photograph that reflects as much light, the most faithful"),
    "lit_texture": ("Lit Texture", "The brightest photograph as a texture"),
    "angular": ("Angular", "The photograph taken at the light's elevation"),
    "final_radiance": ("Final Radiance", "By the light that the flat material sends out; EEVEE only, Cycles: Lookup"),
    "repeat": ("Repeat", "The swatch again and again"),
    "extend": ("Extend", "The border's colour"),
}


_PARAMETERS = {
    "roughness": ("Roughness", "0 is an even diffuse, 1 the flattest"),
    "alpha": ("Alpha", "Width of the highlight: the square of Roughness in Cycles' shaders"),
    "sigma": ("Width", "How far from the rim it is bright"),
    "exponent": ("Exponent", "Sharpness of the highlight; larger is narrower"),
    "diffuse": ("Diffuse", "Share of the light that the diffuse part reflects"),
}


def _parameter(parameter: Parameter, **options: Any) -> Any:
    return bpy.props.FloatProperty(
        name=_PARAMETERS[parameter.name][0],
        description=_PARAMETERS[parameter.name][1],
        default=parameter.default,
        min=parameter.low,
        max=parameter.high,
        soft_max=min(parameter.high, 1000.0),
        precision=3,
        **options,
    )


def _choice(name: str, description: str, choices: tuple[str, ...], usual: object, **options: Any) -> Any:
    return enum(name, description, choices, _WORDS, usual, **options)


def _annotations(**options: Any) -> dict[str, Any]:
    """Of both classes below; `options` go to every property."""
    about = "How the swatch reflects on the large scale"
    lobe = _choice("Base Reflection", about, (*LOBES, MEASURED), "lambert", **options)
    parameters = {parameter_key(name, p): _parameter(p, **options) for name, known in PARAMETERS.items() for p in known}
    sigma = bpy.props.FloatProperty(
        name="Strength",
        description="Factor of the base reflection, the albedo of a white one. 0 is Automatic: as calibrated, or else "
        f"{UNCALIBRATED_SIGMA:g}",
        default=0.0,
        min=0.0,
        max=1e6,
        soft_max=2.0,
        precision=3,
        **options,
    )
    a_max = bpy.props.FloatProperty(
        name="Brightest",
        description="Light that the brightest photograph reflects, in 1/sr. 0 is Automatic: as calibrated, or else as "
        "much as the base reflection does at most",
        default=0.0,
        min=0.0,
        max=1e9,
        soft_max=1.0,
        precision=3,
        **options,
    )
    above = "Where more light is reflected than in any photograph"
    straight = "How a swatch photographed against the light lets light through on the large scale; a highlight lies "
    transmission = _choice("Base Transmission", f"{straight}straight on", tuple(LOBES), "lambert", **options)
    further = {
        parameter_key(name, p, THROUGH): _parameter(p, **options) for name, known in PARAMETERS.items() for p in known
    }
    return {
        "transmission": transmission,
        **further,
        "transmission_sigma": bpy.props.FloatProperty(
            name="Transmitted",
            description="Factor of the base transmission, the share that a white one lets through. 0 is Automatic: as "
            f"calibrated, or else {UNCALIBRATED_TRANSMISSION:g}",
            default=0.0,
            min=0.0,
            max=1e6,
            soft_max=1.0,
            precision=3,
            **options,
        ),
        "transmission_sigma_auto": _automatic("Transmitted", "transmission_sigma", UNCALIBRATED_TRANSMISSION),
        "lobe": lobe,
        **parameters,
        "sigma": sigma,
        "sigma_auto": _automatic("Strength", "sigma", UNCALIBRATED_SIGMA),
        "a_max": a_max,
        "a_max_auto": _automatic("Brightest", "a_max", 1.0),
        "above": _choice("Above", above, ABOVE, _USUAL.above, **options),
        "technique": _choice(
            "Technique", "How the photographs are used (Kautz et al. 2004)", TECHNIQUES, _USUAL.technique, **options
        ),
        "tiling": _choice("Tiling", "Beyond the swatch's border", TILINGS, _USUAL.tiling, **options),
    }


def _automatic(title: str, name: str, usual: float) -> Any:
    """A switch between 0, which means that the number follows from what is known, and a number of one's own."""
    return bpy.props.BoolProperty(
        name=f"{title}: Automatic",
        description=f"{title} as calibrated or else as usual; off: a number of your own",
        get=lambda properties: getattr(properties, name) == 0,
        set=lambda properties, automatic: setattr(properties, name, 0.0 if automatic else usual),
        options={"SKIP_SAVE"},
    )


class LightingProperties:
    """Mixed into the import operator."""

    __annotations__ = {**_annotations(), "mode": mode_property()}


class MEASURED_MATERIALS_PG_lighting(bpy.types.PropertyGroup):
    """Lighting settings of a shading-map material."""

    __annotations__ = {
        # Not animatable: an animation would change the values without rebuilding the material.
        **_annotations(update=rebuild_or_say, options=set()),
        "problem": bpy.props.StringProperty(
            description="Why the last change had no effect", options={"HIDDEN", "SKIP_SAVE"}
        ),
    }


def draw_lighting(
    layout: bpy.types.UILayout,
    properties: Any,
    *,
    fitted: bool = False,
    with_mode: bool = False,
    through: bool = False,
) -> None:
    """Those that have an effect, without the lobe where it will be fitted; the operator's also with its mode.

    Parameters
    ----------
    through : of a swatch that is photographed against the light too
    """
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    if not fitted:
        _draw_lobe(column, properties, "lobe")
    _draw_number(column, properties, "sigma")
    if through:
        draw_transmission(column, properties)
    _draw_number(column, properties, "a_max", text="Brightest (1/sr)")
    column.prop(properties, "technique")
    if uses_mode(properties.technique):
        column.prop(properties, "above")
        if with_mode:
            column.prop(properties, "mode")
    column.prop(properties, "tiling")


def draw_transmission(layout: bpy.types.UILayout, properties: Any) -> None:
    """What a swatch that was photographed against the light lets through, by itself where there is a part for it."""
    _draw_lobe(layout, properties, "transmission", THROUGH)
    _draw_number(layout, properties, "transmission_sigma")


def _draw_number(layout: bpy.types.UILayout, properties: Any, name: str, **words: str) -> None:
    layout.prop(properties, f"{name}_auto")
    if getattr(properties, name) != 0:
        layout.prop(properties, name, **words)


def _draw_lobe(column: bpy.types.UILayout, properties: Any, name: str, front: str = "") -> None:
    column.prop(properties, name)
    lobe = getattr(properties, name)
    for parameter in PARAMETERS.get(lobe, ()):
        column.prop(properties, parameter_key(lobe, parameter, front), slider=parameter.high <= 1)


register, unregister = registration(MEASURED_MATERIALS_PG_lighting, "measured_lighting")
