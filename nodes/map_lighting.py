"""How a shading map is lit: f_r drawn and looked up, and the light that a map reflects at a level, split into parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bake.lobes.lobe_sampling import sample
from ..bake.lobes.lobes import PHONG, Lobe
from ..bake.sampling.concentration import concentration
from ..bake.shading_maps.render_settings import RenderSettings
from . import expr
from .adjustments import Adjustments
from .drawn_direction import DrawnDirection, drawn_direction
from .group import call
from .lamp_light_groups import LightTables
from .lobe_group import lobe_group, lobe_pdf_group, lobe_peak_group, sample_lobe_group
from .native_closure import has_native, native_closure, translucent_closure
from .slices_group import SliceOptions
from .table_groups import TableGroups

# Techniques to compare with, which know no modes.
TEXTURED = ("lit_texture", "angular")


@dataclass(frozen=True)
class MeasuredLobe:
    """f_r from a table, whose lookup must not choose at random, since S is not linear in it."""

    table: TableGroups
    albedo: float


@dataclass(frozen=True)
class Place:
    """Where on a swatch, and, of one whose map knows the light's azimuth, how the swatch lies there: unit, world."""

    uv: Any
    along_u: Any = None
    along_v: Any = None

    def parts_along(self, direction: Any) -> Any:
        """A direction in world space by its parts along u and v."""
        return expr.vec(expr.dot(direction, self.along_u), expr.dot(direction, self.along_v), 0.0)


@dataclass(frozen=True)
class MapGroups:
    """Groups of a map.

    Parameters
    ----------
    traced : for path tracing
    viewport : the same with scalar x and without random choice, for EEVEE
    still : where nothing is known of where light comes from: of a map over azimuth, lit from all around; else `traced`
    turned : they take the light's azimuth too, but `still`
    """

    traced: bpy.types.ShaderNodeTree
    viewport: bpy.types.ShaderNodeTree
    still: bpy.types.ShaderNodeTree
    turned: bool = False

    def look_up(self, place: Place, x: Any, peak: Any, random: Any, wi_world: Any) -> Any:
        """(Reflected, Residual, Envelope, Share) of light from one direction."""
        light = (place.parts_along(wi_world),) if self.turned else ()
        return call(self.traced, place.uv, x, peak, random, *light)


@dataclass(frozen=True)
class Lighting:
    """Lighting of a shading map.

    Parameters
    ----------
    settings : of the material
    sigma : r = sigma f_r cos(theta_i)
    a_max : r at the last slice, in 1/sr
    peak : f_r reaches beyond a_max from some viewer
    level_by_cosine : for technique "angular"
    measured : in place of the settings' lobe
    lamps : table of lamps to aim at, see `bake.sampling.lamps`
    features : also write the passes of `feature_passes`, for the denoiser
    normals : a view layer shows the Normal pass, which mirrors would spoil
    lights : tables of lamps and of what they emit, where the shader is to sample them; used with `lamps` only
    through : of light from the far side, whose direction is mirrored in the swatch
    concentrated : how often lamps are aimed at may follow how wide they are
    """

    settings: RenderSettings
    sigma: float
    a_max: float
    peak: bool
    level_by_cosine: tuple[float, ...]
    measured: MeasuredLobe | None = None
    lamps: bpy.types.Image | None = None
    features: bool = False
    normals: bool = False
    lights: LightTables | None = None
    through: bool = False
    concentrated: bool = True

    @property
    def gain(self) -> float:
        """x per f_r cos(theta_i)."""
        return self.sigma / self.a_max

    @property
    def exact(self) -> bool:
        """Whether a native closure carries the envelope."""
        return self.settings.mode in ("exact", "balanced") and self.native

    @property
    def preview(self) -> bool:
        """Whether it is native closures alone."""
        return self.settings.mode == "preview" and self.settings.technique not in TEXTURED

    @property
    def sampled(self) -> bool:
        """Whether the shader samples lamps itself."""
        mode, technique = self.settings.mode, self.settings.technique
        return self.lights is not None and mode in ("exact", "balanced") and technique not in TEXTURED

    @property
    def native(self) -> bool:
        """Whether Cycles has a closure for f_r or a part of it: of what lets light through, Translucent BSDF."""
        matte = not self.through or self.lobe.name == "lambert" or self.lobe.name in PHONG
        return self.measured is None and matte and has_native(self.lobe)

    @property
    def lobe(self) -> Lobe:
        """f_r as a formula."""
        assert self.settings.lobe is not None
        return self.settings.lobe

    @property
    def concentration(self) -> float:
        """Of what `sample` draws by, `bake.sampling.concentration`; 0 where nothing follows it."""
        if self.lamps is None or not self.concentrated:
            return 0.0
        if self.measured is not None:
            return self.measured.table.concentration
        return concentration(lambda wo, numbers: sample(self.lobe, wo, numbers[..., :3]))

    def options(self, *, stochastic: bool) -> SliceOptions:
        """Options of the slices' group."""
        above, tiling = self.settings.above, self.settings.tiling
        return SliceOptions(above, self.peak and self.exact, self.measured is not None, stochastic, tiling)

    def sample(self, wo: Any, *numbers: Any) -> tuple[Any, Any]:
        """A local direction by four random numbers, and its density."""
        if self.measured is not None:
            wi, pdf = call(self.measured.table.sampler, wo, *numbers)
        else:
            wi, pdf, _ = call(sample_lobe_group(self.lobe.name), wo, *numbers[:3], self.lobe.p1, self.lobe.p2)
        return wi, pdf

    def density(self, wi: Any, wo: Any) -> Any:
        """With which `sample` gives wi, which must lie above the horizon."""
        if self.measured is not None:
            return call(self.measured.table.density, wi, wo)
        return call(lobe_pdf_group(self.lobe.name), wi, wo, self.lobe.p1, self.lobe.p2)

    def f_cos(self, wi: Any, wo: Any, cosine: Any) -> Any:
        """f_r cos(theta_i) in 1/sr: a scalar, or a colour where f_r is measured."""
        if self.measured is not None:
            return expr.scale(call(self.measured.table.lookup, wi, wo, 0.5), cosine)
        return call(lobe_group(self.lobe.name), wi, wo, self.lobe.p1, self.lobe.p2) * cosine

    def draw(self, normal: Any) -> tuple[DrawnDirection, Any]:
        """A direction, maybe towards a lamp, and `f_cos` there."""
        if self.measured is not None:
            drawn = self.measured.table.draw(normal, self.lamps)
        else:
            drawn = drawn_direction(
                normal, self.sample, self.density, self.lamps, None, None, self.through, self.concentration
            )
        return drawn, self.f_cos(drawn.wi, drawn.wo, drawn.cosine)

    def split(
        self, groups: MapGroups, place: Place, wo: Any, wi_world: Any, f_cos: Any, cosine: Any, random: Any
    ) -> Parts:
        """What the map reflects at a level, and the part of it that no closure carries.

        Parameters
        ----------
        wi_world : to the light, of whose azimuth a map may know
        random : number that chooses a slice
        """
        x = times(f_cos, self.gain)
        if not self.exact:
            reflected, _, envelope, share = groups.look_up(place, x, 1.0, random, wi_world)
            return Parts(reflected, reflected, envelope, share)
        lobe = self.lobe
        peak: Any = 1.0
        if self.peak:
            peak = call(lobe_peak_group(lobe.name), wo, lobe.p1, lobe.p2) * self.gain
        reflected, residual, envelope, share = groups.look_up(place, x, peak, random, wi_world)
        if lobe.native_share < 1:
            # The closure carries only the diffuse part of Phong; the envelope's rest joins the residual.
            native = cosine * (lobe.native_share / expr.pi * self.gain)
            residual = residual + expr.scale(envelope, x - native)
            share = 1 - (1 - share) * lobe.native_share
        return Parts(reflected, residual, envelope, share)

    @property
    def native_sigma(self) -> float:
        """Sigma of what the native closure carries."""
        return self.sigma * self.lobe.native_share

    def closure(self, parts: Parts, normal: Any, adjustments: Adjustments, part: Any) -> Any:
        """The native closure that carries the envelope, times `native_sigma` over how often it is followed."""
        colour = expr.scale(adjustments.apply(parts.envelope), part)
        return translucent_closure(colour, normal) if self.through else native_closure(self.lobe, colour, normal)


@dataclass(frozen=True)
class Parts:
    """Light that a map reflects at a level, relative to a_max.

    Parameters
    ----------
    reflected : all of it
    traced : what a mirror is to bring: all of it too, or the residual where a native closure carries the envelope
    envelope : what reflected light per level is at least; the same at every level
    share : of the light, over all levels, that is the residual's
    """

    reflected: Any
    traced: Any
    envelope: Any
    share: Any


def times(value: Any, factor: Any) -> Any:
    """A scalar or a colour times a scalar."""
    return expr.scale(value, factor) if isinstance(value, expr.Vector) else value * factor
