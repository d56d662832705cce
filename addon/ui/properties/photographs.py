"""What the artist can set for the bake of a shading map, as Blender properties."""

# No postponed annotations here: Blender reads the properties from them.
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ....bake.images.storage import IMAGE_STORAGES, Storage
from ....bake.photographs.radiometry.response import parse_rule
from ....bake.photographs.settings import ALIGNMENTS, SIDES, StackSettings
from ....bake.shading_maps.against_light import ThroughSettings
from ....bake.shading_maps.azimuth.azimuth_basis import MAX_RANK
from ....bake.shading_maps.bake import AZIMUTHS, TILEABLES, ArcSettings
from ....bake.shading_maps.shading_map import MAX_SLICES, MIN_SLICES
from ....bake.shading_maps.store import COMPRESSIONS
from ...material.lighting import MEASURED, lighting_of, number
from ...summary.bake_stages import USUAL_SIZE
from ...summary.quality_levels import MAP_LEVELS
from .enum_items import enum
from .quality_choice import advanced, draw_part, draw_quality_choice, part_choice, quality_choice
from .registration import registration
from .rights import AUTHOR, LICENSE, SOURCE_URL, draw_rights, rights_of, show_rights
from .spheres import spheres_of, text_of_spheres

_USUAL, _STACK = ArcSettings(), StackSettings()
_DIFFUSER = ThroughSettings(Path()).diffuser_transmittance
_MAP = ("slices", "storage", "compression", "rank", "tileable", "azimuths")
_PARTS = {
    "swatch": "Swatch",
    "brightness": "Brightness",
    "lights": "Lights",
    "through": "Through",
    "rendering": "Rendering",
    "files": "Files",
    "rights": "License",
}
_CORNERS = ("corner_top_left", "corner_top_right", "corner_bottom_right", "corner_bottom_left")
# Numbers that are drawn two in a row, and what each is.
_PAIRS = {**dict.fromkeys(_CORNERS, "XY"), **dict.fromkeys(("crop", "white_card", "diffuser"), "XYWH")}
_THROUGH_BY = "none", "transmittance", "diffuser"
_TITLES = {"crop": "Crop (px)", "white_card": "Card (px)", "diffuser": "Diffuser (px)"}

# What a choice is called and does; choices themselves are those of the settings, in their order.
_WORDS = {
    "half": ("Half", "OpenEXR, 16 bits per channel"),
    "float32": ("Float", "OpenEXR, 32 bits per channel"),
    "rgbe": ("RGBE", "Radiance, 4 bytes per texel; takes as much as Float while rendering"),
    "byte": ("Byte", "PNG, 8 bits per channel, the smallest"),
    "none": ("None", "None of these"),
    "power": ("Power Law", "Two numbers per texel and channel (Kautz et al. 2004)"),
    "basis": ("Basis", "A few numbers per texel and channel, on curves fitted to this swatch"),
    "off": ("Off", "As photographed"),
    "auto": ("Automatic", "Whichever measures best"),
    "quilt": ("Quilt", "Patches from all over the swatch"),
    "offset": ("Offset", "One cut in either direction; nearly all of the swatch stays as it is"),
    "warn": ("Warn", "Warn only; nothing is corrected"),
    "arc": ("One Arc", "Shadows stay where they are when the light turns"),
    "all": ("Every Side", "Shadows turn with the light"),
    "one": ("One", "That of the azimuth alone"),
    "both": ("Both", "The far side of the swatch too"),
    "srgb": ("sRGB", "As most cameras and programs write them"),
    "linear": ("Linear", "As developed from RAW without a curve"),
    "gamma": ("Gamma", "By a power function"),
    "whole": ("Whole", "The photographs show nothing but the swatch"),
    "crop": ("Crop", "A rectangle of the photograph"),
    "corners": ("Corners", "Four corners, which makes an oblique view square-on"),
    "albedo": ("Albedo", "By the share of light that the swatch reflects, as you state it"),
    "card": ("White Card", "By a diffuse card that lies beside the swatch"),
    "transmittance": ("Transmittance", "By the share of light that the swatch lets through, as you state it"),
    "diffuser": ("Diffuser", "By a diffuser that lies beside the swatch, lit from behind too"),
}


def _enum(name: str, description: str, choices: tuple[str, ...], usual: object) -> Any:
    return enum(name, description, choices, _WORDS, usual)


def _whole(name: str, description: str, usual: int, low: int, high: int, soft: int | None = None) -> Any:
    return bpy.props.IntProperty(
        name=name, description=description, default=usual, min=low, max=high, soft_max=soft or high
    )


def _float(name: str, description: str, usual: float, low: float, high: float) -> Any:
    return bpy.props.FloatProperty(
        name=name, description=description, default=usual, min=low, max=high, precision=2 if high <= 10 else 1
    )


def _rectangle(name: str, description: str) -> Any:
    words = f"{description}: x and y from the upper left, width and height, in pixels"
    return bpy.props.IntVectorProperty(name=name, description=words, size=4, min=0, default=(0, 0, 0, 0))


def _corner(name: str) -> Any:
    words = "Pixels from the upper left of the photograph"
    return bpy.props.FloatVectorProperty(name=name, description=words, size=2, min=-1, max=1 << 24, precision=1)


def _corner_title(name: str) -> str:
    return name.removeprefix("corner_").replace("_", " ").title()


def _path(name: str, description: str, subtype: str = "FILE_PATH") -> Any:
    return bpy.props.StringProperty(name=name, description=description, subtype=subtype)


def _flag(name: str, description: str, usual: bool = False) -> Any:
    return bpy.props.BoolProperty(name=name, description=description, default=usual)


class ArcProperties:
    """Mixed into a PropertyGroup or an Operator."""

    __annotations__ = {
        "quality": quality_choice(MAP_LEVELS),
        "advanced": advanced(),
        "part": part_choice(_PARTS),
        "full_size": bpy.props.BoolProperty(
            name="Full Size",
            description="Keep the swatch in the photographs' own size",
            get=lambda properties: properties.size == 0,
            set=lambda properties, full: setattr(properties, "size", 0 if full else USUAL_SIZE),
            options={"SKIP_SAVE"},
        ),
        "size": _whole("Size (px)", "Texels of the swatch's longer side; 0 is Full Size", USUAL_SIZE, 0, 16384, 4096),
        "slices": _whole(
            "Slices", "Levels of reflected light, black included", _USUAL.slices, MIN_SLICES, MAX_SLICES, 16
        ),
        "tileable": _enum("Tileable", "Make the swatch tile without seams", TILEABLES, _USUAL.tileable),
        "compression": _enum("Compression", "What is kept of each texel", COMPRESSIONS, _USUAL.compression),
        "rank": _whole("Rank", "Numbers per texel and channel", _USUAL.rank, 1, 3),
        "storage": _enum("Storage", "Format of the texels", tuple(map(str, IMAGE_STORAGES)), _USUAL.storage),
        "frame": _enum("Frame", "Where the swatch is in the photographs", ("whole", "crop", "corners"), "whole"),
        "crop": _rectangle(_TITLES["crop"], "The swatch"),
        **{name: _corner(_corner_title(name)) for name in _CORNERS},
        "decode": _enum(
            "Decode",
            "Curve of JPEG, PNG and TIFF files; their primaries are read from them",
            ("auto", "srgb", "linear", "gamma"),
            "auto",
        ),
        "gamma": _float("Gamma", "Its exponent", 2.2, 0.1, 10),
        "scale_by": _enum("Calibrate", "How brightness gets its unit", ("none", "albedo", "card"), "none"),
        "albedo": _float("Albedo", "Share of light that the swatch reflects", 0.5, 0.001, 1),
        "white_card": _rectangle(_TITLES["white_card"], "The white card"),
        "white_reflectance": _float("Reflectance", "Of the white card", _STACK.white_reflectance, 0.01, 1),
        "flat_field": _path("Flat Field", "Photograph of an evenly white board under the same lamp"),
        "align": _enum("Stabilise", "What is done about small movements of the camera", ALIGNMENTS, _STACK.align),
        "lights": _path("Lights", "A lights.csv or .lp file. Automatic: found in the folder, or angles in file names"),
        "spheres": bpy.props.StringProperty(
            name="Mirror Spheres",
            description="In the photographs, whose reflections tell the lights: x and y of the centre from the upper "
            "left, and radius, in pixels, such as 812,340,95; a blank, and the next",
        ),
        "azimuths": _enum("Azimuths", "Which of the photographs are used", AZIMUTHS, _USUAL.azimuths),
        "azimuth_rank": _whole(
            "Azimuth Rank", "Numbers per texel and channel of light from every side; 0 is Automatic", 0, 0, MAX_RANK
        ),
        "one_plane": _flag("Choose Plane", "Use the lights near this azimuth. Off: where most elevations are"),
        "azimuth": _float("Azimuth (°)", "Degrees: 0 right, 90 up", 0, -360, 360),
        "spread": _float("Spread (°)", "Degrees that a light may lie off the plane of the arc", _STACK.spread, 0.1, 90),
        "sides": _enum("Sides", "Of the arc that the lights may stand on", SIDES, _STACK.sides),
        "fit_lobe": _flag("Fit Base Reflection", "Choose it by the brightness of the photographs along the arc"),
        "brdf": _path("Measured", "Measured material (.mmat) to use as the base reflection", "DIR_PATH"),
        "through": _path("Against the Light", "Folder of photographs of the same frame, lit from behind", "DIR_PATH"),
        "through_lights": _path("Their Lights", "Directions of those lights. Automatic: found in their folder"),
        "through_by": _enum("Calibrate", "How the light let through gets its unit", _THROUGH_BY, "none"),
        "transmittance": _float("Transmittance", "Share of light that the swatch lets through", 0.25, 0.001, 1),
        "diffuser": _rectangle(_TITLES["diffuser"], "The diffuser"),
        "diffuser_transmittance": _float(
            "Its Transmittance", "Share of light that the diffuser lets through", _DIFFUSER, 0.01, 1
        ),
        "author": AUTHOR,
        "license": LICENSE,
        "source_url": SOURCE_URL,
        "pack": _flag("Pack into .blend", "Keep the textures inside the .blend file", True),
    }


class MEASURED_MATERIALS_PG_arc(ArcProperties, bpy.types.PropertyGroup):
    """Settings of a shading-map material's next bake."""


def arc_settings_of(properties: Any, light: Any, mode: str) -> ArcSettings:
    """The properties, those of the lighting, and the mode, as bake settings. Raises BakeError."""
    p = properties
    return ArcSettings(
        **_map_of(p),
        lobe_auto=p.fit_lobe,
        brdf=_file(p.brdf) if light.lobe == MEASURED and not p.fit_lobe else None,
        render=lighting_of(light, mode),
        rights=rights_of(p),
        through=_through_of(p),
        stack=stack_settings_of(p),
    )


def stack_settings_of(p: Any) -> StackSettings:
    """The properties on how photographs are read. Raises BakeError."""
    return StackSettings(
        size=p.size or None,
        decode=f"gamma:{number(p.gamma):g}" if p.decode == "gamma" else p.decode,
        lights=_file(p.lights),
        spheres=() if p.lights else spheres_of(p.spheres),
        **_arc_of(p),
        crop=tuple(p.crop) if p.frame == "crop" else None,
        corners=tuple(tuple(getattr(p, name)) for name in _CORNERS) if p.frame == "corners" else None,
        flat_field=_file(p.flat_field),
        white_card=tuple(p.white_card) if p.scale_by == "card" else None,
        white_reflectance=number(p.white_reflectance),
        albedo=number(p.albedo) if p.scale_by == "albedo" else None,
        align=p.align,
    )


def _map_of(p: Any) -> dict[str, Any]:
    """Settings of what is stored; of light from every side there is one way, and one arc knows no rank of it."""
    settings = {name: getattr(p, name) for name in _MAP}
    if p.azimuths == "all":
        settings["compression"] = "none"
    return {**settings, "azimuth_rank": p.azimuth_rank or None if p.azimuths != "arc" else None}


def _arc_of(p: Any) -> dict[str, Any]:
    """Settings of the arc; light from every side has none."""
    if p.azimuths == "all":
        return {}
    return {"azimuth": number(p.azimuth) if p.one_plane else None, "spread": number(p.spread), "sides": p.sides}


def _through_of(p: Any) -> ThroughSettings | None:
    folder = _file(p.through)
    if folder is None:
        return None
    return ThroughSettings(
        folder,
        _file(p.through_lights),
        number(p.transmittance) if p.through_by == "transmittance" else None,
        tuple(p.diffuser) if p.through_by == "diffuser" else None,
        number(p.diffuser_transmittance),
    )


def _file(text: str) -> Path | None:
    return Path(bpy.path.abspath(text)) if text else None


def show_arc_settings(properties: Any, settings: ArcSettings, *, pack: bool) -> None:
    """Set the properties to what a bake was made with; for the lighting there is `show_lighting`."""
    p, stack = properties, settings.stack
    for name in _MAP:
        setattr(p, name, str(value) if isinstance(value := getattr(settings, name), Storage) else value)
    show_rights(p, settings.rights)
    p.size, p.fit_lobe, p.pack = stack.size or 0, settings.lobe_auto, pack
    p.azimuth_rank = settings.azimuth_rank or 0
    response = parse_rule(stack.decode)
    p.decode = "auto" if response is None else response.name.partition(":")[0]
    if response is not None and p.decode == "gamma":
        p.gamma = response.gamma
    p.one_plane, p.azimuth = stack.azimuth is not None, stack.azimuth or 0.0
    p.frame = "crop" if stack.crop else "corners" if stack.corners else "whole"
    p.crop, p.white_card = stack.crop or (0, 0, 0, 0), stack.white_card or (0, 0, 0, 0)
    for name, corner in zip(_CORNERS, stack.corners or ()):
        setattr(p, name, corner)
    p.scale_by = "card" if stack.white_card else "none" if stack.albedo is None else "albedo"
    p.albedo = 0.5 if stack.albedo is None else stack.albedo
    p.spread, p.sides, p.spheres = stack.spread, stack.sides, text_of_spheres(stack.spheres)
    p.white_reflectance, p.align = stack.white_reflectance, stack.align
    _show_through(p, settings.through)
    for name, path in (("lights", stack.lights), ("flat_field", stack.flat_field), ("brdf", settings.brdf)):
        setattr(p, name, "" if path is None else str(path))


def _show_through(p: Any, through: ThroughSettings | None) -> None:
    """Set the properties of photographs against the light."""
    if through is None:
        p.through, p.through_lights, p.through_by = "", "", "none"
        return
    source = through.source
    p.through = str(source[0].parent if isinstance(source, tuple) else source)
    p.through_lights = "" if through.lights is None else str(through.lights)
    p.through_by = "diffuser" if through.diffuser else "none" if through.transmittance is None else "transmittance"
    if through.transmittance is not None:
        p.transmittance = through.transmittance
    p.diffuser, p.diffuser_transmittance = through.diffuser or (0, 0, 0, 0), through.diffuser_transmittance


def draw_arc_settings(
    layout: bpy.types.UILayout,
    properties: Any,
    light: Any,
    draw_in_dialogue: Callable[[bpy.types.UILayout], None] | None = None,
) -> None:
    """Draw the quality of a bake of photographs and, where they are asked for, the settings that have an effect.

    Parameters
    ----------
    draw_in_dialogue : draws what only the wide dialogue has in a part: what can be changed without a bake
    """
    p = properties
    inner = draw_quality_choice(layout, p, MAP_LEVELS, None if _maps_alone(p) else _settings_to_weigh)
    if inner is None:
        return
    if _maps_alone(p):
        column = draw_part(inner, p, tuple(_shown(p, light)))
    elif draw_in_dialogue is None:
        column = draw_part(inner, p, [part for part in _PARTS if part != "rendering"])
    else:
        column = draw_part(inner, p, tuple(_PARTS), len(_PARTS))
    if p.part == "rights" and not _maps_alone(p):
        draw_rights(column, p)
    for name in _shown(p, light).get(p.part, ()):
        if name in _PAIRS:
            _draw_pairs(column, p, name)
        elif name in _WHERE_EMPTY:
            column.prop(p, name, placeholder=_WHERE_EMPTY[name])
        else:
            column.prop(p, name)
    if draw_in_dialogue is not None and not _maps_alone(p):
        draw_in_dialogue(column)


def _draw_pairs(layout: bpy.types.UILayout, p: Any, name: str) -> None:
    """Two numbers in a row."""
    split = layout.split(factor=0.4)
    left = split.row()
    right = split.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
    left.alignment = "RIGHT"  # as the names of the other settings
    left.label(text=_TITLES.get(name) or _corner_title(name))
    right.use_property_split = False
    for index, axis in enumerate(_PAIRS[name]):
        right.prop(p, name, index=index, text=axis)


# What an empty text means.
_WHERE_EMPTY = {
    "lights": "Automatic",
    "spheres": "None",
    "flat_field": "None",
    "through": "None",
    "through_lights": "Automatic",
}


def _maps_alone(p: Any) -> bool:
    """Whether the photographs become no shading map; only the import asks for that."""
    return getattr(p, "make", "shading") == "maps"


def _shown(p: Any, light: Any) -> dict[str, tuple[str, ...]]:
    """Parts, and the names of the settings in them that have an effect."""
    size = ("full_size",) if p.full_size else ("full_size", "size")
    rank = ("rank",) if p.compression == "basis" else ()
    frame = {"crop": ("crop",), "corners": _CORNERS}.get(p.frame, ())
    gamma = ("gamma",) if p.decode == "gamma" else ()
    scale = {"albedo": ("albedo",), "card": ("white_card", "white_reflectance")}.get(p.scale_by, ())
    plane = ("one_plane", *(("azimuth",) if p.one_plane else ()), "spread", "sides")
    arc = plane if p.azimuths == "arc" else ("azimuth_rank",) if p.azimuths == "all" else (*plane, "azimuth_rank")
    slices, compression = (("slices",), ("compression", *rank)) if p.azimuths != "all" else ((), ())
    stated = {"transmittance": ("transmittance",), "diffuser": ("diffuser", "diffuser_transmittance")}
    behind = ("through_lights", "through_by", *stated.get(p.through_by, ())) if p.through else ()
    brdf = ("brdf",) if light.lobe == MEASURED and not p.fit_lobe else ()
    lights = ("lights",) if p.lights else ("lights", "spheres")
    brightness = ("decode", *gamma, "scale_by", *scale, "flat_field", "align")
    if _maps_alone(p):
        swatch = (*size, "frame", *frame)
        return {"swatch": swatch, "brightness": brightness, "lights": lights, "files": ("pack",)}
    return {
        "swatch": (*size, *slices, "tileable", "frame", *frame),
        "brightness": brightness,
        "through": ("through", *behind),
        "lights": (*lights, "azimuths", *arc, "fit_lobe", *brdf),
        "files": (*compression, "storage", "pack"),
    }


def _settings_to_weigh(p: Any) -> ArcSettings:
    """What time and size depend on. Raises BakeError."""
    return ArcSettings(**_map_of(p), stack=StackSettings(size=p.size or None, align=p.align))


register, unregister = registration(MEASURED_MATERIALS_PG_arc, "measured_arc")
