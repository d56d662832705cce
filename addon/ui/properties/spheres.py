"""Mirror spheres in photographs as one line of text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ....bake.errors import BakeError
from ....bake.photographs.light_files.spheres import Sphere


def spheres_of(text: str) -> Any:
    """What `text_of_spheres` writes; blanks may follow commas. Raises BakeError."""
    found = [one.split(",") for one in re.sub(r"\s*,\s*", ",", text).split()]
    if any(len(one) != 3 for one in found):
        raise BakeError(
            "photograph settings", f"Mirror Spheres is {text!r}", "give x, y and radius, such as 812,340,95"
        )
    return tuple(map(tuple, found))


def text_of_spheres(spheres: Sequence[Sphere]) -> str:
    """As an artist types them."""
    return " ".join(",".join(f"{number:.10g}" for number in sphere) for sphere in spheres)
