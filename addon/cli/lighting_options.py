"""Options of `bake photographs` and `render` that say how a shading map is lit."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from ...bake.brdf.modes import MODES
from ...bake.errors import BakeError
from ...bake.lobes.lobes import LOBES, PARAMETERS, Lobe, parameters_of
from ...bake.shading_maps.render_settings import (
    TECHNIQUES,
    TILINGS,
    UNCALIBRATED_SIGMA,
    UNCALIBRATED_TRANSMISSION,
    RenderSettings,
)
from ...bake.shading_maps.shading_map import ABOVE
from .bake_jobs import usage_error

# Option's attribute, which is the setting's name too.
_NAMES = ("sigma", "above", "technique", "mode", "tiling", "a_max", "transmission_sigma")


def add_lighting(parser: Any, lobe_help: str, lobe_words: str = "NAME") -> None:
    """Add the options. None of them has a default: what is not given stays as it was."""
    usual = RenderSettings()
    parser.add_argument("--lobe", nargs="+", metavar=(lobe_words, "KEY=VALUE"), help=lobe_help)
    parser.add_argument(
        "--sigma",
        type=float,
        metavar="FACTOR",
        help="r = sigma f_r cos of the light's angle, so it is the albedo of a white f_r (as calibrated, or else "
        f"{UNCALIBRATED_SIGMA:g})",
    )
    parser.add_argument(
        "--above",
        choices=ABOVE,
        help=f"where r exceeds the brightest photograph: stay with it, or scale it ({usual.above})",
    )
    parser.add_argument(
        "--technique",
        choices=TECHNIQUES,
        help="of Kautz et al. 2004, figure 6: look r up; the brightest photograph as a texture; the photograph taken "
        f"at the light's elevation; or look the final radiance up, in EEVEE only ({usual.technique})",
    )
    parser.add_argument(
        "--mode",
        choices=MODES,
        help="preview: Cycles' own shaders alone; exact: as far as they go, the rest by a mirror; balanced: "
        "exact until a diffuse bounce, then preview; reference: all by the mirror (exact)",
    )
    parser.add_argument("--tiling", choices=TILINGS, help=f"beyond the swatch's border ({usual.tiling})")
    parser.add_argument(
        "--a-max",
        type=float,
        metavar="R",
        help="r of the brightest photograph in 1/sr (as calibrated, or else the largest r)",
    )
    parser.add_argument(
        "--transmission",
        nargs="+",
        metavar=("NAME", "KEY=VALUE"),
        help=f"base transmission (f_t) of photographs against the light: {known_lobes()}, a highlight straight on "
        "(lambert)",
    )
    parser.add_argument(
        "--transmission-sigma",
        type=float,
        metavar="FACTOR",
        help=f"of f_t, as --sigma of f_r (as calibrated, or else {UNCALIBRATED_TRANSMISSION:g})",
    )


def known_lobes() -> str:
    """The lobes with their parameters, as one phrase for help."""
    words = []
    for name in LOBES:
        pairs = ", ".join(f"{p.name}={p.default:g}" for p in PARAMETERS[name])
        words.append(f"{name} ({pairs})" if pairs else name)
    return ", ".join(words)


def given_lighting(options: argparse.Namespace) -> list[str]:
    """Lighting options that were given on the command line."""
    return [name for name in ("lobe", "transmission", *_NAMES) if getattr(options, name) is not None]


def lighting(options: argparse.Namespace, base: RenderSettings, lobe: Lobe | None) -> RenderSettings:
    """`base` with the given options in place of its own; raises `argparse.ArgumentTypeError`."""
    given = {name: getattr(options, name) for name in _NAMES if getattr(options, name) is not None}
    if options.transmission is not None:
        given["transmission"] = parsed_lobe(options.transmission, options, option="--transmission")
    try:
        return replace(base, lobe=lobe, **given)
    except BakeError as error:
        raise usage_error(error, options) from None


def parsed_lobe(words: list[str], options: argparse.Namespace, others: str = "", option: str = "--lobe") -> Lobe:
    """NAME KEY=VALUE ... as a lobe; raises `argparse.ArgumentTypeError`. `others` are further choices to mention."""
    name, *pairs = words
    try:
        parameters_of(name)
    except BakeError:
        choices = ", ".join(LOBES) + others
        raise argparse.ArgumentTypeError(f"{option} {name}: there is none of that name; choose {choices}") from None
    try:
        return Lobe.of(name, **dict(_parameter(pair, option) for pair in pairs))
    except BakeError as error:
        raise usage_error(error, options) from None


def _parameter(pair: str, option: str) -> tuple[str, float]:
    key, equals, text = pair.partition("=")
    try:
        if equals and key:
            return key, float(text)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{option} takes KEY=VALUE after the name, not {pair!r}; paths go before it")
