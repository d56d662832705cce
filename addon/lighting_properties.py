"""How a shading map is lit, as Blender properties: changed on a material they rebuild it at once, without a bake."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from ..bake.modes import MODES
from ..bake.shading.lobes import LOBES, PARAMETERS, Lobe, Parameter
from ..bake.shading.render_settings import TECHNIQUES, TILINGS, UNCALIBRATED_SIGMA, RenderSettings
from ..bake.shading.shading_map import ABOVE
from .quality_properties import MODE_WORDS

MEASURED = "measured"
_USUAL = RenderSettings()
# Those named as in the settings.
_PLAIN = ("above", "technique", "mode", "tiling")

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
} | MODE_WORDS


def enum(name: str, description: str, choices: tuple[str, ...], words: Any, usual: object, **options: Any) -> Any:
    """A choice with what `words` say of each item."""
    items = [(choice, *words[choice]) for choice in choices]
    return bpy.props.EnumProperty(name=name, description=description, items=items, default=str(usual), **options)


def number(value: float) -> float:
    """What was typed: Blender keeps 0.3 as the nearest single-precision number."""
    return float(f"{value:.7g}")


def _key(lobe: str, parameter: Parameter) -> str:
    return f"{lobe}_{parameter.name}"


def _parameter(parameter: Parameter, **options: Any) -> Any:
    return bpy.props.FloatProperty(
        name=parameter.name.capitalize(),
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
    lobe = _choice("f_r", "How the flat material reflects", (*LOBES, MEASURED), "lambert", **options)
    parameters = {_key(name, p): _parameter(p, **options) for name, known in PARAMETERS.items() for p in known}
    sigma = bpy.props.FloatProperty(
        name="Sigma",
        description=f"Factor of f_r, the albedo of a white one. 0: as calibrated, or else {UNCALIBRATED_SIGMA:g}",
        default=0.0,
        min=0.0,
        max=1e6,
        soft_max=2.0,
        precision=3,
        **options,
    )
    a_max = bpy.props.FloatProperty(
        name="Brightest",
        description="Light that the brightest photograph reflects, in 1/sr. 0: as calibrated, or else as much as f_r "
        "does at most",
        default=0.0,
        min=0.0,
        max=1e9,
        soft_max=1.0,
        precision=3,
        **options,
    )
    above = "Where more light is reflected than in any photograph"
    return {
        "lobe": lobe,
        **parameters,
        "sigma": sigma,
        "a_max": a_max,
        "above": _choice("Above", above, ABOVE, _USUAL.above, **options),
        "technique": _choice("Technique", "Of Kautz et al. 2004", TECHNIQUES, _USUAL.technique, **options),
        "mode": _choice("Mode", "How Cycles computes it", MODES, _USUAL.mode, **options),
        "tiling": _choice("Tiling", "Beyond the swatch's border", TILINGS, _USUAL.tiling, **options),
    }


class LightingProperties:
    """Mixed into the import operator."""

    __annotations__ = _annotations()


_quiet = False


@contextmanager
def _without_rebuilding() -> Iterator[None]:
    global _quiet
    before, _quiet = _quiet, True
    try:
        yield
    finally:
        _quiet = before


def _changed(properties: Any, _context: bpy.types.Context) -> None:
    if not _quiet:
        # Imported here: it needs what is defined in this module.
        from .arc_relight import relight_or_say

        with _without_rebuilding():
            relight_or_say(properties.id_data)


class MEASURED_MATERIALS_PG_lighting(bpy.types.PropertyGroup):
    """How a shading-map material is lit."""

    __annotations__ = {
        # Not animatable: an animation would change the values without rebuilding the material.
        **_annotations(update=_changed, options=set()),
        "problem": bpy.props.StringProperty(
            description="Why the last change had no effect", options={"HIDDEN", "SKIP_SAVE"}
        ),
    }


def lighting_of(properties: Any) -> RenderSettings:
    """The properties as settings. Raises BakeError."""
    values = [number(getattr(properties, _key(properties.lobe, p))) for p in PARAMETERS.get(properties.lobe, ())]
    return RenderSettings(
        lobe=None if properties.lobe == MEASURED else Lobe(properties.lobe, *values),
        sigma=_given(properties.sigma, 1e-6),
        above=properties.above,
        technique=properties.technique,
        mode=properties.mode,
        tiling=properties.tiling,
        a_max=_given(properties.a_max, 1e-9),
    )


def _given(value: float, least: float) -> float | None:
    """0 stands for what is found by default."""
    return max(number(value), least) if value > 0 else None


def show_lighting(properties: Any, settings: RenderSettings) -> None:
    """Set the properties to how a material is lit; nothing is rebuilt."""
    with _without_rebuilding():
        lobe = settings.lobe
        properties.lobe = MEASURED if lobe is None else lobe.name
        values = () if lobe is None else (lobe.p1, lobe.p2)
        for parameter, value in zip(PARAMETERS.get(properties.lobe, ()), values):
            setattr(properties, _key(properties.lobe, parameter), value)
        for name in _PLAIN:
            setattr(properties, name, getattr(settings, name))
        properties.sigma, properties.a_max = settings.sigma or 0.0, settings.a_max or 0.0


def draw_lighting(layout: bpy.types.UILayout, properties: Any, *, fitted: bool = False) -> None:
    """Those that have an effect, without the lobe where it will be fitted."""
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    if not fitted:
        column.prop(properties, "lobe")
        for parameter in PARAMETERS.get(properties.lobe, ()):
            column.prop(properties, _key(properties.lobe, parameter), slider=parameter.high <= 1)
    column.prop(properties, "sigma")
    column.prop(properties, "a_max")
    column.prop(properties, "technique")
    if properties.technique in ("lookup", "final_radiance"):
        column.prop(properties, "above")
        column.prop(properties, "mode")
    column.prop(properties, "tiling")


classes = (MEASURED_MATERIALS_PG_lighting,)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(classes)


def register() -> None:
    """Called by `addon.register`."""
    _register_classes()
    bpy.types.Material.measured_lighting = bpy.props.PointerProperty(type=MEASURED_MATERIALS_PG_lighting)


def unregister() -> None:
    """Called by `addon.unregister`."""
    del bpy.types.Material.measured_lighting
    _unregister_classes()
