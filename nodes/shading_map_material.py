"""A shading map's bundle as a material."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..bake import xp_numpy
from ..bake.bundle.bundle import Bundle
from ..bake.directions import spherical
from ..bake.errors import BakeError
from ..bake.images.storage import HALF_LARGEST
from ..bake.lobes.lobes import lobe_peak
from ..bake.shading_maps.albedo import resolved_scale
from ..bake.shading_maps.azimuth.azimuth_basis import AzimuthBasis, mean_curves
from ..bake.shading_maps.azimuth.mean_coefficients import light_coefficients
from ..bake.shading_maps.record import ShadingMapRecord
from ..bake.shading_maps.record_parts import StoredMap
from ..bake.shading_maps.reduced_map import detail_layout, mean_tiles, pack_levels, reduced_size, reduced_slices
from ..bake.shading_maps.render_settings import RenderSettings
from ..bake.shading_maps.slice_atlas import SliceLayout
from ..bake.source import luminance
from .azimuth_group import AzimuthImages, azimuth_group, mean_group
from .checked_pixels import check_image
from .data_image import Images, bundle_images, made_image, new_data_image, of_part
from .lamp_light_groups import LightTables
from .map_lighting import Lighting, MapGroups, MeasuredLobe
from .map_models import basis_group, power_group
from .material_tree import build_from, lit_by_emission, measured_nodes
from .osl_script import require_osl
from .parallax_group import follow_tiling, is_parallax
from .shading_map_group import Transmitted, shading_map_group
from .slices_group import Detail, SliceImages, SliceOptions, slices_group
from .surface_inputs import source_of
from .table_groups import table_groups
from .world_picture import Surroundings


def build_shading_map(
    source: Bundle | ShadingMapRecord,
    material: bpy.types.Material | None = None,
    *,
    settings: RenderSettings | None = None,
    images: Images | None = None,
    pack: bool = False,
    lamps: bpy.types.Image | None = None,
    reduce: int = 1,
    features: bool = False,
    normals: bool = False,
    texels: float = 0.0,
    lights: bpy.types.Image | None = None,
    surroundings: Surroundings | None = None,
    scripted: bool = False,
) -> bpy.types.Material:
    """Build or rebuild a material from a bundle of kind "shading_map". No texture is baked for that.

    Parameters
    ----------
    source : the bundle's record, or the bundle, which is then read
    material : to rebuild in place, so that objects keep it; a new one by default
    settings : how it is lit; by default as the bundle says
    images : the textures; by default those of the bundle, loaded
    pack : store the textures that are loaded inside the .blend
    lamps : table of the scene's lamps to aim at, see `bake.sampling.lamps`
    reduce : texels across that Cycles sees as their mean, for a swatch far away; for model "slices" only
    texels : that a pixel is across at a distance of 1, by which rays read means of texels; 0 for none. Not of models
        "power", and not where the border goes on beyond the swatch
    features, normals : as in `nodes.material.build_material`
    lights : table of what the lamps emit, see `bake.sampling.lamp_light`: modes "exact" and "balanced" then sample
        lamps themselves, which takes `lamps`, and Blender 5.1 or `scripted` rays
    surroundings : the world's picture, to be sampled too; used with `lights` only
    scripted : a script of OSL asks what rays meet. All else is nodes, whose textures have to be packed where Open
        Shading Language is on; where it is off no light is sampled

    Raises
    ------
    BakeError : the bundle does not describe a shading map this version knows, or this Blender has no OSL for a script
    """
    record = ShadingMapRecord.of(source)
    settings = settings or record.render
    if settings.lobe is None:
        record.measured_lobe()
    behind = record.transmitted()
    for part in [record] if behind is None else [record, behind]:
        for name in {part.map.image, "envelope", "curves"} & set(part.images):
            check_image(part.files(), name)
    if scripted:
        require_osl()

    tables = None
    if lamps is not None and lights is not None:
        tables = LightTables(lamps, lights, surroundings, scripted, sheet=behind is not None)
    lighting = lighting_of(record, settings)
    lighting = replace(lighting, lamps=lamps, lights=tables, features=features, normals=normals)

    def make(name: str) -> bpy.types.ShaderNodeTree:
        textures = images or bundle_images(record.files(), name, pack=pack)
        return _group(record, lighting, name, textures, reduce, texels, behind)

    built = build_from(record, material, make)
    lit_by_emission(built, lighting.sampled)
    for _, node in measured_nodes(built.node_tree):
        moves = source_of(node.inputs["UV"]) if "UV" in node.inputs else None
        if moves is not None and is_parallax(moves.node):
            follow_tiling(moves.node, settings.tiling)
    return built


def lighting_of(record: ShadingMapRecord, settings: RenderSettings) -> Lighting:
    """Lighting of the map by a lobe; a measured f_r is added by the caller."""
    measured = None
    if settings.lobe is None:
        measured = record.baked_lobe().load()
    sigma, a_max = resolved_scale(settings, record.map.a_max, measured)
    return Lighting(settings, sigma, a_max, _reaches_beyond(settings, sigma, a_max), record.map.level_by_cosine)


def _reaches_beyond(settings: RenderSettings, sigma: float, a_max: float) -> bool:
    if settings.lobe is None:
        return False  # of no matter to a mirror alone
    viewers = spherical(np.linspace(0, np.pi / 2 - 1e-3, 256), np.zeros(256))
    peaks = lobe_peak(xp_numpy, settings.lobe.name, viewers, settings.lobe.p1, settings.lobe.p2)
    return bool(np.max(peaks) * sigma > a_max * (1 + 1e-6))


def _group(
    record: ShadingMapRecord,
    lighting: Lighting,
    name: str,
    textures: Images,
    reduce: int,
    texels: float,
    behind: ShadingMapRecord | None,
) -> bpy.types.ShaderNodeTree:
    settings = lighting.settings
    if settings.lobe is None:
        # Not stochastic: S is not linear in f_r, so a single random tap of the table would be biased.
        table = table_groups(record.baked_lobe(), name, textures, None, False, aimed=lighting.lamps is not None)
        measured = MeasuredLobe(table, _f_r_albedo(record))
        lighting = replace(lighting, measured=measured)
    if behind is not None and lighting.lights is None:
        # Two mirrors that aim at four lamps leave no room on Cycles' stack for asking how wide these are.
        lighting = _not_concentrated(lighting)
    front = _map_groups(record, lighting, name, textures, reduce, texels)
    transmitted = None
    if behind is not None:
        lit = lighting_of(behind, settings.of_transmission(behind.map.a_max is not None))
        lit = replace(lit, lamps=lighting.lamps, lights=lighting.lights, through=True)
        lit = replace(lit, concentrated=lighting.concentrated)
        groups = _map_groups(behind, lit, f"{name} through", of_part(textures, "through"), reduce, texels)
        skies = [float(luminance(np.array(part.albedo.white_sky))) for part in (record, behind)]
        transmitted = Transmitted(groups, lit, skies[0] / max(sum(skies), 1e-9))
    return shading_map_group(f"Shading Map {name}", front, lighting, transmitted)


def _not_concentrated(lighting: Lighting) -> Lighting:
    measured = lighting.measured
    if measured is not None:
        measured = replace(measured, table=replace(measured.table, concentration=0.0))
    return replace(lighting, measured=measured, concentrated=False)


def _map_groups(
    record: ShadingMapRecord, lighting: Lighting, name: str, textures: Images, reduce: int, texels: float
) -> MapGroups:
    facts = record.map
    images = slice_images(record, textures)
    far = _reduced(record, images, name, reduce) if reduce > 1 and facts.model == "slices" else images
    if texels > 0 and has_detail(facts.model, lighting.settings):
        far = _detailed(record, far, name, texels * far.layout.width / facts.layout.width)
    # Where lamps are sampled, a slice chosen at random would be most of the noise that is left.
    traced = map_group(f"MM Slices {name}", facts, far, lighting.options(stochastic=not lighting.sampled))
    # Light in a viewport has no upper end: clamped there, everything beyond the Light Level would go flat and dark.
    viewport = SliceOptions("scale", tiling=lighting.settings.tiling, interpolation="Fetched")
    shown = map_group(f"MM Slices Viewport {name}", facts, images, viewport)
    if facts.model != "azimuth":
        return MapGroups(traced, shown, traced)
    curves = record.load_curves()
    around = mean_group(f"MM Slices Around {name}", far, mean_curves(curves), lighting.options(stochastic=False))
    return MapGroups(traced, shown, around, turned=True)


def _f_r_albedo(record: ShadingMapRecord) -> float:
    """Of the measured f_r at the normal, a grey; what EEVEE's closure stands in for. Raises BakeError."""
    albedo = record.measured_lobe().albedo
    if albedo is None:
        raise BakeError(record.where, "does not say the albedo of its measured BRDF", "bake it again")
    return albedo


def slice_images(record: ShadingMapRecord, textures: Images) -> SliceImages:
    """The map's textures, and how they are laid out. Raises BakeError."""
    facts = record.map
    main = textures(facts.image)
    envelope = textures("envelope") if facts.model != "power" else main
    stored = (main, envelope, facts.layout, 1 / facts.scale, 1 / facts.envelope_scale)
    if facts.model == "azimuth":
        return AzimuthImages(*stored, curves=textures("curves"), curve_layout=facts.curve_layout)
    return SliceImages(*stored)


def _reduced(record: ShadingMapRecord, images: SliceImages, name: str, factor: int) -> SliceImages:
    """The same map in fewer texels, kept in the .blend: they are a small part of the textures they were made of."""
    bundle, facts = record.files(), record.map
    layout = SliceLayout(facts.layout.tiles, *reduced_size(facts.layout, factor))
    sources = {facts.image: images.residual.use_half_precision, "envelope": images.envelope.use_half_precision}
    told = {part: f"{record.images[part].sha256} in {facts.layout} / {factor}" for part in sources}
    made = {part: made_image(told[part], half=half) for part, half in sources.items()}
    if None in made.values():
        *pixels, _ = reduced_slices(bundle.load(facts.image), bundle.load("envelope"), facts.layout, factor)
        for (part, half), values in zip(sources.items(), pixels):
            made[part] = made[part] or new_data_image(
                f"{name} {part} / {factor}", values, half=half, made_of=told[part]
            )
    return replace(images, residual=made[facts.image], envelope=made["envelope"], layout=layout)


def has_detail(model: str, settings: RenderSettings) -> bool:
    """Whether means of the texels are means of the light: not of a power law, nor where the border goes on."""
    return model != "power" and settings.tiling == "repeat"


def _detailed(record: ShadingMapRecord, images: SliceImages, name: str, texels: float) -> SliceImages:
    """The same map with means of its texels in the images; they are kept in the .blend. `images` where it is too small.

    Parameters
    ----------
    texels : of these images, that a pixel is across at a distance of 1
    """
    facts, size = record.map, images.layout
    layout, one = detail_layout(size), detail_layout(SliceLayout(1, size.height, size.width))
    if layout is None or one is None:
        return images
    sources = {facts.image: (images.residual, layout), "envelope": (images.envelope, one)}
    told = {part: f"{record.images[part].sha256} as {found}" for part, (_, found) in sources.items()}
    halves = {part: image.use_half_precision for part, (image, _) in sources.items()}
    made = {part: made_image(told[part], half=half) for part, half in halves.items()}
    if None in made.values():
        # A bundle's colours may have an alpha, which nothing reads.
        tiles = record.load_tiles()
        parts = {
            facts.image: (tiles, _to_be_averaged(record, tiles)),
            "envelope": (texel := record.files().load("envelope")[None], texel),
        }
        for part, (_, found) in sources.items():
            near, whole = parts[part]
            near = near if near.shape[1:3] == (size.height, size.width) else mean_tiles(near, size.height, size.width)
            made[part] = made[part] or new_data_image(
                f"{name} {part} detail", pack_levels(near, whole, found), half=halves[part], made_of=told[part]
            )
    return replace(images, residual=made[facts.image], envelope=made["envelope"], detail=Detail(layout, one, texels))


def _to_be_averaged(record: ShadingMapRecord, tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    """Tiles whose means are means of light."""
    if record.map.model != "azimuth":
        return tiles
    found = light_coefficients(AzimuthBasis(np.moveaxis(tiles, 0, -1), record.load_curves()))
    return np.clip(np.moveaxis(found, -1, 0), -HALF_LARGEST, HALF_LARGEST)


def map_group(name: str, facts: StoredMap, images: SliceImages, options: SliceOptions) -> bpy.types.ShaderNodeTree:
    """The lookup of whichever model the bundle holds."""
    if facts.model == "power":
        return power_group(name, images, options)
    if isinstance(images, AzimuthImages):
        return azimuth_group(name, images, options)
    if facts.model == "basis":
        return basis_group(name, images, facts.curves, options)
    return slices_group(name, images, options)
