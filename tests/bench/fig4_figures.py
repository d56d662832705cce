"""Sentences and rows of pages that bench fig4 fills: the text of each, as of `readme_figures.Stated`."""

_GROUPS = (
    "directions of the BTF",
    "from above, light along the arc",
    "from above, light from elsewhere",
    "obliquely, light along the arc",
    "obliquely, light from elsewhere",
)


def _row(label: str, rival: str) -> str:
    photographs = f"{{photographs, wool, {rival}|0}} | {{KB, wool, {rival}|0}}, {{KB, cloth, {rival}|0}}"
    errors = (f"{{RMS, wool, {rival}, {group}|0%}}, {{RMS, cloth, {rival}, {group}|0%}} %" for group in _GROUPS)
    return f"| {label} | {photographs} | " + " | ".join(errors) + " |"


ROWS = (
    _row("BTF, all of it", "BTF"),
    _row("BTF, 16 components", "BTF, PCA"),
    _row("BTF, 16 components of each view", "BTF, PCA per view"),
    _row("shading map of one arc", "map of one arc"),
    _row("shading map over azimuth", "map over azimuth"),
)
