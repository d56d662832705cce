"""What the artist can set for a bake, as Blender properties: the same on the import operator and on a material."""

# No postponed annotations here: Blender reads the properties from them.
from typing import Any, get_args

import bpy

from ....bake.brdf.samplers import KINDS, isotropic_layout, kind_of_layout
from ....bake.brdf.settings import FILTER_CHOICES, AlphaChoice, BakeSettings, SplineFit, tries_spline
from ....bake.images.storage import TABLE_STORAGES, Storage
from ....bake.tables.grids.normal_vector_grid import MAX_RESOLUTION
from ....bake.tables.grids.parameterization import Parameterization
from ....bake.tables.search.byte_limit import LEAST_BYTES, MOST_BYTES
from ....bake.tables.search.grid_search import BASES
from ...summary.quality_levels import BRDF_LEVELS
from .enum_items import enum
from .quality_choice import advanced, draw_part, draw_quality_choice, part_choice, quality_choice
from .reading import ReadingProperties, draw_reading, reading_of, show_reading
from .registration import registration
from .rights import AUTHOR, LICENSE, SOURCE_URL, draw_rights, rights_of, show_rights

_USUAL = BakeSettings()

# What a choice is called and does; choices themselves are those of the settings, in their order.
_WORDS = {
    "bezier": ("Bezier", "Gathered at one end of each angle (Mallett & Yuksel 2016)"),
    "uniform": ("Uniform", "Evenly in angle"),
    "identity": ("Cosine", "Evenly in the cosine of the angle"),
    "squared": ("Squared", "Gathered at the normal or the half vector, as MERL's measurements are"),
    "normal": ("Normal", "Elevations of light and viewer and the angle between their azimuths"),
    "error": ("Least Error", "By the error measured at directions that are not in the table"),
    "intensity": ("Intensity", "By the largest total intensity of the table (Mallett & Yuksel 2016)"),
    "given": ("Given", "By hand"),
    "half": ("Half", "OpenEXR, 16 bits per channel"),
    "float32": ("Float", "OpenEXR, 32 bits per channel"),
    "rgbe": ("RGBE", "Radiance, 4 bytes per texel; takes as much as Float while rendering"),
    "log": ("Log", "PNG, 8 bits of each channel's logarithm: the smallest, for tables of low resolution"),
    "nearest": ("Nearest", "No interpolation, the fastest"),
    "trilinear": ("Linear", "Between the nearest samples"),
    "bspline": ("B-Spline", "Smooth cubic spline"),
    "auto": ("Automatic", "Whichever has the smaller measured error"),
    "fitted": ("Fitted", "Where this material needs it, by measured error"),
    "plain": ("Plain", "The samples themselves, which blurs them (Mallett & Yuksel 2016)"),
}


# Names that mean another thing in another list.
_SPLINE_WORDS = {"fitted": ("Fitted", "Passing as near to the samples as it can without turning negative")}
_BASIS_WORDS = {"half": ("Half Vector", "Angles to the half vector, along which a highlight runs: best for gloss")}


def _enum(
    name: str,
    description: str,
    choices: tuple[str, ...],
    usual: object,
    words: dict[str, tuple[str, str]] | None = None,
) -> Any:
    return enum(name, description, choices, _WORDS | (words or {}), usual)


_QUALITY = quality_choice(BRDF_LEVELS)
_ADVANCED = advanced()
_PARTS = {"table": "Table", "rendering": "Rendering", "files": "Files", "reading": "Reading", "rights": "License"}
_PART = part_choice(_PARTS)
_RESOLUTION = bpy.props.IntProperty(
    name="Resolution",
    description="N of an N x N x 2N table, or of one of as many bytes. Time and memory grow with its cube",
    default=_USUAL.resolution,
    min=4,
    soft_min=16,
    soft_max=128,
    max=MAX_RESOLUTION,
)
_PARAMETERIZATION = _enum(
    "Spacing",
    "How the table's samples are spread over the angles",
    ("auto", *get_args(Parameterization)),
    _USUAL.parameterization,
)
_BASIS = _enum("Basis", "The angles that the table is stored over", ("auto", *BASES), _USUAL.basis, _BASIS_WORDS)
_ALPHA = _enum(
    "Alpha", "How the shape of the Bezier spacing is chosen", (*get_args(AlphaChoice), "given"), _USUAL.alpha
)
_ALPHA_THETA = bpy.props.FloatProperty(
    name="Elevation", description="0 gathers samples at the normal, 1 at grazing angles", default=0.5, min=0, max=1
)
_ALPHA_PHI = bpy.props.FloatProperty(
    name="Azimuth",
    description="0 gathers samples towards the mirror direction and the light, 1 at right angles to them",
    default=0.5,
    min=0,
    max=1,
)
_STORAGE = _enum("Storage", "Format of the table's texels", TABLE_STORAGES, _USUAL.storage)


def _no_fewer_bytes(properties: Any, context: bpy.types.Context) -> None:
    """A property has one range, and this one a gap: below the least there is only 0."""
    if 0 < properties.table_bytes < LEAST_BYTES:
        properties.table_bytes = LEAST_BYTES


_TABLE_BYTES = bpy.props.IntProperty(
    name="Table Bytes",
    description="As many samples as the file of each table holds within so many bytes, whatever the resolution. With "
    f"Cycles' own shaders there are two tables. With 0 the resolution counts; otherwise at least {LEAST_BYTES}",
    default=0,
    min=0,
    max=MOST_BYTES,
    soft_min=LEAST_BYTES,
    soft_max=1 << 17,
    update=_no_fewer_bytes,
)
_FILTER = _enum(
    "Filter",
    "How the material reconstructs between samples. Automatic weighs a B-spline only without Cycles' own shaders",
    FILTER_CHOICES,
    _USUAL.filter,
)
_SPLINE = _enum("Spline", "Coefficients of the spline", get_args(SplineFit), _USUAL.spline, _SPLINE_WORDS)
_SAMPLER_WORDS = {
    "alias": ("Tables", "Four random numbers: less noise, and a little quicker to render"),
    "warp": ("Warp", "Two random numbers, which may be of low discrepancy: a ninth of the sampler's bytes"),
}
_SAMPLER = _enum(
    "Light Directions",
    "How directions of the light are drawn",
    KINDS,
    kind_of_layout(_USUAL.sampler),
    _SAMPLER_WORDS,
)
_ENVELOPE = bpy.props.BoolProperty(
    name="Cycles' Own Shaders",
    description="Let Cycles' own shaders carry what they can of the measurement, and the mirror only the rest: less "
    "noise, at a bias of at most 0.1 % of the light",
    default=_USUAL.envelope,
)
_PACK = bpy.props.BoolProperty(
    name="Pack into .blend",
    description="Keep the textures inside the .blend file. While rendering they then take 16 bytes per texel",
    default=True,
)


class BakeProperties(ReadingProperties):
    """Mixed into a PropertyGroup or an Operator."""

    author: AUTHOR
    license: LICENSE
    source_url: SOURCE_URL
    quality: _QUALITY
    advanced: _ADVANCED
    part: _PART
    resolution: _RESOLUTION
    basis: _BASIS
    parameterization: _PARAMETERIZATION
    alpha: _ALPHA
    alpha_theta: _ALPHA_THETA
    alpha_phi: _ALPHA_PHI
    storage: _STORAGE
    table_bytes: _TABLE_BYTES
    filter: _FILTER
    spline: _SPLINE
    sampler: _SAMPLER
    envelope: _ENVELOPE
    pack: _PACK


class MEASURED_MATERIALS_PG_bake(BakeProperties, bpy.types.PropertyGroup):
    """Settings of a material's next bake."""


def settings_of(properties: Any) -> BakeSettings:
    """The properties as bake settings; of what is not shown, nothing counts. Raises BakeError."""
    alpha: Any = "error"
    if _has_alpha(properties):
        given = properties.alpha == "given"
        alpha = (properties.alpha_theta, properties.alpha_phi) if given else properties.alpha
    return BakeSettings(
        resolution=properties.resolution,
        basis=properties.basis,
        parameterization=properties.parameterization,
        alpha=alpha,
        storage=Storage(properties.storage),
        filter=properties.filter,
        spline=properties.spline,
        table_bytes=_table_bytes(properties),
        sampler=isotropic_layout(properties.sampler),
        envelope=properties.envelope,
        reading=reading_of(properties),
        rights=rights_of(properties),
    )


def _has_alpha(properties: Any) -> bool:
    """The shape of a Bezier table in the normal-vector basis can be had in other ways than by error."""
    return properties.parameterization == "bezier" and properties.basis == "normal"


def _table_bytes(properties: Any) -> int | None:
    """Bytes that each table is to keep within; None where the resolution counts."""
    return properties.table_bytes or None if properties.storage == Storage.LOG else None


def show_settings(properties: Any, settings: BakeSettings) -> None:
    """Set the properties to what a bake was made with."""
    for name in ("resolution", "filter", "spline", "envelope"):
        setattr(properties, name, getattr(settings, name))
    show_reading(properties, settings.reading)
    show_rights(properties, settings.rights)
    properties.table_bytes = settings.table_bytes or 0
    # As the settings mean them: a given alpha is one of a Bezier table in the normal-vector basis.
    properties.parameterization = settings.spacing
    properties.basis = settings.bases[0] if len(settings.bases) == 1 else "auto"
    properties.storage, properties.sampler = str(settings.storage), kind_of_layout(settings.sampler)
    if isinstance(settings.alpha, str):
        properties.alpha = settings.alpha
    else:
        properties.alpha = "given"
        properties.alpha_theta, properties.alpha_phi = settings.alpha


def draw_settings(layout: bpy.types.UILayout, properties: Any) -> None:
    """Draw the quality of a BRDF's bake and, where they are asked for, the settings that have an effect."""
    inner = draw_quality_choice(layout, properties, BRDF_LEVELS, settings_of)
    if inner is not None:
        _DRAWN[properties.part](draw_part(inner, properties, tuple(_PARTS)), properties)


def _draw_table(column: bpy.types.UILayout, properties: Any) -> None:
    row = column.row()
    row.enabled = _table_bytes(properties) is None
    row.prop(properties, "resolution")
    column.prop(properties, "basis")
    column.prop(properties, "parameterization")
    if _has_alpha(properties):
        column.prop(properties, "alpha")
        if properties.alpha == "given":
            shape = column.column(align=True)
            shape.prop(properties, "alpha_theta", slider=True)
            shape.prop(properties, "alpha_phi", slider=True)
    column.prop(properties, "filter")
    if tries_spline(properties.filter, properties.envelope):
        column.prop(properties, "spline")


def _draw_rendering(column: bpy.types.UILayout, properties: Any) -> None:
    column.prop(properties, "sampler")
    column.prop(properties, "envelope")


def _draw_files(column: bpy.types.UILayout, properties: Any) -> None:
    column.prop(properties, "storage")
    if properties.storage == Storage.LOG:
        column.prop(properties, "table_bytes")
    column.prop(properties, "pack")


# By the names of the parts.
_DRAWN = {
    "table": _draw_table,
    "rendering": _draw_rendering,
    "files": _draw_files,
    "reading": draw_reading,
    "rights": draw_rights,
}


register, unregister = registration(MEASURED_MATERIALS_PG_bake, "measured_materials")
