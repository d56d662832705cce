"""How a material shows the relief of its maps, and how wide it lies on an object."""

from __future__ import annotations

from typing import Literal, get_args

from ..errors import BakeError

Relief = Literal["normal", "bump", "displacement"]
"""What shows the relief: the normals, the height as bump, or the height as displacement."""
RELIEFS: tuple[str, ...] = get_args(Relief)
_TOO_WIDE = 1e6


def check_width(width: float) -> None:
    """Raise BakeError where no picture is so wide, in Blender's units."""
    if not 0 < width < _TOO_WIDE:
        raise BakeError("width", f"is {width:g}", f"choose a number above 0 and below {_TOO_WIDE:g}")
