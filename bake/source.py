"""What a BRDF source is, and how a reader of a new file format plugs in.

A reader is one module in `bake/sources` that exposes a `Reader` named `READER`; listing it in
`bake/sources/__init__.py` is all it takes for the command line, the panel and the tests to know it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from .reading import Reading

Array = NDArray[Any]
Json = bool | int | float | str | None | Sequence["Json"] | Mapping[str, "Json"]
# An account that a bundle's material.json keeps.
Facts = Mapping[str, Json]


@runtime_checkable
class BrdfSource(Protocol):
    """A BRDF that can be evaluated for any pair of directions in the upper hemisphere.

    Attributes
    ----------
    name : short name, usually the file's stem
    isotropic : the value depends on the azimuths only through phi_i - phi_o
    bilateral : f(phi_delta) = f(-phi_delta) holds exactly; a table stores phi_delta in [0, pi] only, so a
        source without it is averaged with its mirror image when baked
    facts : what the reader found (invalid entries, negative share, interpolation, ...), JSON-ready; shown
        by `inspect` and kept in the bundle
    """

    @property
    def name(self) -> str: ...

    @property
    def isotropic(self) -> bool: ...

    @property
    def bilateral(self) -> bool: ...

    @property
    def facts(self) -> Facts: ...

    def evaluate(self, wi: Array, wo: Array) -> Array:
        """BRDF in 1/sr without the cosine, linear Rec.709.

        Parameters
        ----------
        wi, wo : (..., 3) unit vectors to the light and to the viewer, z along the normal; shapes broadcast

        Returns
        -------
        (..., 3) float array, finite. Values may be negative where the measurement is; baking counts and
        treats them. Directions on or below the horizon give 0.
        """
        ...


@runtime_checkable
class SheetSource(BrdfSource, Protocol):
    """A thin sheet: a BRDF, its front's, that also lets light through, and reflects at its back.

    All directions are of the front's frame, away from the sheet: those of the back lie below the horizon.

    Attributes
    ----------
    alike : front and back are the same, seen each from its own side in the frame turned about the tangent x
    """

    @property
    def alike(self) -> bool: ...

    def transmitted(self, wi: Array, wo: Array) -> Array:
        """BTDF (..., 3) in 1/sr without the cosine, for light and viewer on opposite sides, whichever is above; else 0.

        Finite; values may be negative, as in `evaluate`.
        """
        ...

    def reflected_behind(self, wi: Array, wo: Array) -> Array:
        """BRDF (..., 3) in 1/sr of the back, for light and viewer below the horizon; else 0."""
        ...


SheetPart = Literal["through", "behind", "through_behind"]
SHEET_PARTS: tuple[SheetPart, ...] = get_args(SheetPart)
"""
What a sheet has beside its front's reflection:

through         light that comes through, seen from the front
behind          reflection of the back
through_behind  light that comes through, seen from the back
"""


@dataclass(frozen=True)
class Reader:
    """A file format: `suffixes` in lower case with the dot, `matches` sniffs the first 64 bytes.

    `read` takes what the file leaves open as the reading has it, and does not look at the rest of that. `chosen`, of
    formats that hold several materials, is the file's own name of the one that `read` takes, "" where there is but one.
    `listed` gives the names of all, none where there is but one.
    """

    name: str
    suffixes: tuple[str, ...]
    matches: Callable[[Path, bytes], bool]
    read: Callable[[Path, Reading], BrdfSource]
    chosen: Callable[[Path, Reading], str] | None = None
    listed: Callable[[Path], list[str]] | None = None


# Of linear Rec.709's channels (ITU-R BT.709, section 3.2).
LUMINANCE = 0.2126, 0.7152, 0.0722


def luminance(rgb: Array) -> Array:
    """Relative luminance of linear Rec.709, (..., 3) -> (...)."""
    return rgb @ np.array(LUMINANCE, dtype=rgb.dtype)
