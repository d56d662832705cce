"""How a shading map is lit: f_r, its scale, what happens beyond the photographs, and which technique."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from ..brdf.modes import MODES, Mode
from ..errors import check_choice, check_setting
from ..lobes.lobes import Lobe
from ..source import Facts, Json
from .shading_map import ABOVE, Above

Technique = Literal["lookup", "lit_texture", "angular", "final_radiance"]
Tiling = Literal["repeat", "extend"]
TECHNIQUES: tuple[str, ...] = get_args(Technique)
TILINGS: tuple[str, ...] = get_args(Tiling)
# Of all levels, where a photograph taken for them all is nearest to them, about: the brightest is flattest.
PREVIEW_LEVEL = 0.75
# Of photographs without a scale: the swatch reflects half of the light, as a middling cloth or paper does.
UNCALIBRATED_SIGMA = 0.5
# And lets through as much as a shade of cloth does, less than what it reflects leaves.
UNCALIBRATED_TRANSMISSION = 0.25
# Swatches along a unit of texture coordinates in the studio, whose ball has three around it.
USUAL_REPEAT = 3.0


@dataclass(frozen=True)
class RenderSettings:
    """Render settings of a shading map, changed without baking again.

    Parameters
    ----------
    lobe : f_r; None for the measured BRDF that the bundle holds
    sigma : r = sigma f_r cos(theta_i), so that it is the albedo of a white f_r. None lets the peak of r meet the
        brightest photograph, whose a_max is then known by calibration, or else takes `UNCALIBRATED_SIGMA`
    above : beyond the brightest photograph stay with it, or scale it
    technique : of Kautz et al. 2004, figure 6. "lookup" S(r); "lit_texture" the brightest photograph times r; "angular"
        the photograph taken at the light's elevation, relative to its mean, times r; "final_radiance" S of the radiance
        that the flat material would send out, which needs EEVEE's Shader to RGB: Cycles keeps "lookup"
    mode : of `bake.brdf.modes`: "exact" envelope as a native closure and residual by mirror; "reference" all of it by
        mirror; "preview" f_r as native closures, times the photograph at `PREVIEW_LEVEL` relative to its mean;
        "balanced" that after a diffuse bounce only
    tiling : "repeat", or "extend" the border beyond the swatch
    a_max : r at the brightest photograph, in 1/sr; by default as calibrated, or else where the peak of r is
    transmission : of a swatch that was photographed against the light too, f_t: a lobe of the light's direction as it
        is mirrored in the swatch, so that a highlight lies straight on
    transmission_sigma : of r = sigma f_t cos(theta_i); by default as calibrated, or else `UNCALIBRATED_TRANSMISSION`
    """

    lobe: Lobe | None = field(default_factory=lambda: Lobe("lambert"))
    sigma: float | None = None
    above: Above = "clamp"
    technique: Technique = "lookup"
    mode: Mode = "exact"
    tiling: Tiling = "repeat"
    a_max: float | None = None
    transmission: Lobe = field(default_factory=lambda: Lobe("lambert"))
    transmission_sigma: float | None = None

    def __post_init__(self) -> None:
        check_setting("sigma", self.sigma is None or 1e-6 <= self.sigma <= 1e6, "a number above 0", self.sigma)
        sigma = self.transmission_sigma
        check_setting("transmission_sigma", sigma is None or 1e-6 <= sigma <= 1e6, "a number above 0", sigma)
        check_setting("a_max", self.a_max is None or 1e-9 <= self.a_max <= 1e9, "a number above 0", self.a_max)
        for name, choices in (("above", ABOVE), ("technique", TECHNIQUES), ("mode", MODES), ("tiling", TILINGS)):
            check_choice(name, getattr(self, name), choices)

    def facts(self) -> Facts:
        """JSON-ready; `record_parts.render_settings_of` reads it back."""
        names = ("sigma", "above", "technique", "mode", "tiling", "a_max")
        lobe = None if self.lobe is None else self.lobe.facts()
        facts: dict[str, Json] = {"lobe": lobe, **{name: getattr(self, name) for name in names}}
        # Of what is not photographed against the light nothing is said, as before there was such a thing.
        if self.transmission != Lobe("lambert") or self.transmission_sigma is not None:
            facts |= {"transmission": self.transmission.facts(), "transmission_sigma": self.transmission_sigma}
        return facts

    def of_transmission(self, calibrated: bool) -> RenderSettings:
        """Settings of the map of transmitted light, as if it were one of reflected light: f_t in the place of f_r."""
        usual = None if calibrated else UNCALIBRATED_TRANSMISSION
        sigma = usual if self.transmission_sigma is None else self.transmission_sigma
        return replace(self, lobe=self.transmission, sigma=sigma, a_max=None)
