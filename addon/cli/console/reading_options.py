"""Options of how to read what a measurement's file leaves open."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from ....bake.errors import BakeError
from ....bake.reading import READING_CHOICES, READING_NAMES, Reading

_HELP = {
    "illuminant": "that spectra become colours under: daylight, equal energy, lamplight, or a white LED",
    "merl": "what an entry of a MERL file stands for: the cell above its index, the point at it, or what the file's "
    "own symmetry says",
    "reciprocity": "which direction of a pair is the light: the file's incident one, its other one (as Mitsuba and "
    "pbrt read RGL files), or the mean of both",
    "side": "of a window layer; auto: the front where there is one",
    "utia": "what the numbers of a UTIA file are; auto: linear, unless that would reflect more light than arrives",
}


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add an option for each choice."""
    usual = asdict(Reading())
    group = parser.add_argument_group("what a file leaves open")
    for name, choices in READING_CHOICES.items():
        group.add_argument(f"--{name}", choices=choices, default=usual[name], help=f"{_HELP[name]} (%(default)s)")
    group.add_argument(
        "--material",
        default=usual["material"],
        metavar="NAME",
        help="of a file that holds several, such as published parameters of all MERL materials",
    )


def reading_of(options: argparse.Namespace) -> Reading:
    """The reading that was asked for."""
    try:
        return Reading(**{name: getattr(options, name) for name in READING_NAMES})
    except BakeError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
