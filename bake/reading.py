"""How to read what a measurement's file leaves open."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, get_args

from .errors import check_choice, check_setting

Illuminant = Literal["D65", "E", "A", "LED-B3"]
MerlEntries = Literal["auto", "bins", "nodes"]
Reciprocity = Literal["measured", "exchanged", "mean"]
Side = Literal["auto", "front", "back"]
UtiaValues = Literal["auto", "linear", "sRGB", "scaled"]


@dataclass(frozen=True)
class Reading:
    """Choices of reading; each matters to some formats only.

    Parameters
    ----------
    illuminant : that spectra become colours under; its white is (1, 1, 1)
    merl : whether an entry of a MERL file stands for the cell above its index, or for the point at it; "auto": as the
        file's own mirror symmetry has it
    reciprocity : which of a pair of directions is the light: the file's incident one ("measured"), its other one
        ("exchanged", as Mitsuba and pbrt read RGL files), or the mean of both, which is reciprocal
    side : of a window layer; "auto": the front where there is one
    material : name of one of several materials in a file of published parameters
    utia : what UTIA's numbers are; "auto": linear, unless the albedo would exceed 1
    """

    illuminant: Illuminant = "D65"
    merl: MerlEntries = "auto"
    reciprocity: Reciprocity = "measured"
    side: Side = "auto"
    utia: UtiaValues = "auto"
    material: str = ""

    def __post_init__(self) -> None:
        for name, choices in READING_CHOICES.items():
            check_choice(name, getattr(self, name), choices)
        named = isinstance(self.material, str) and len(self.material) <= _LONGEST_NAME
        check_setting("material", named, f"a name of at most {_LONGEST_NAME} letters", self.material)

    def told(self) -> dict[str, Any]:
        """What differs from the usual, JSON-ready."""
        usual = asdict(Reading())
        return {name: value for name, value in asdict(self).items() if value != usual[name]}


_LONGEST_NAME = 100
READING_CHOICES: dict[str, tuple[str, ...]] = {
    "illuminant": get_args(Illuminant),
    "merl": get_args(MerlEntries),
    "reciprocity": get_args(Reciprocity),
    "side": get_args(Side),
    "utia": get_args(UtiaValues),
}
READING_NAMES = (*READING_CHOICES, "material")
assert set(READING_NAMES) == {field.name for field in fields(Reading)}
