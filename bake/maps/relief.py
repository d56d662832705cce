"""How a material shows the relief of its maps, and how wide it lies on an object."""

from __future__ import annotations

from typing import Literal, get_args

from ..errors import BakeError

Relief = Literal["normal", "bump", "displacement", "filtered"]
"""What shows the relief: the normals, the height as bump, the height as displacement, or the normals with roughness for
what they vary by where a renderer averages them."""
RELIEFS: tuple[str, ...] = get_args(Relief)
BY_NORMALS = ("normal", "filtered")
_TOO_WIDE = 1e6


def check_width(width: float) -> None:
    """Raise BakeError where no picture is so wide, in Blender's units."""
    if not 0 < width < _TOO_WIDE:
        raise BakeError("width", f"is {width:g}", f"choose a number above 0 and below {_TOO_WIDE:g}")
