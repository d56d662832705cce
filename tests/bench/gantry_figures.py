"""Texts that benches fig4, parallax, normals, techniques and mitsuba fill, as of `readme_figures.Stated`."""

_GROUPS = (
    "directions of the BTF",
    "from above, light along the arc",
    "from above, light from elsewhere",
    "obliquely, light along the arc",
    "obliquely, light from elsewhere",
)


def _rival(label: str, rival: str) -> str:
    photographs = f"{{photographs, wool, {rival}|0}} | {{KB, wool, {rival}|0}}, {{KB, cloth, {rival}|0}}"
    errors = (f"{{RMS, wool, {rival}, {group}|0%}}, {{RMS, cloth, {rival}, {group}|0%}} %" for group in _GROUPS)
    return f"| {label} | {photographs} | " + " | ".join(errors) + " |"


def _swatch(name: str) -> str:
    ways = ("as it is", "moved", "moved, true heights")
    errors = (", ".join(f"{{RMS, {name}, {way}, {theta} degrees|0%}}" for way in ways) + " %" for theta in (30, 50, 70))
    return f"| {name} | " + " | ".join(errors) + " |"


FIG4 = (
    _rival("BTF, all of it", "BTF"),
    _rival("BTF, 16 components", "BTF, PCA"),
    _rival("BTF, 16 components of each view", "BTF, PCA per view"),
    _rival("shading map of one arc", "map of one arc"),
    _rival("shading map over azimuth", "map over azimuth"),
)


def _normals(name: str) -> str:
    ways = ("bake maps", "known shadows", "no shadows", "white, no shadows")
    return f"| {name} | " + " | ".join(f"{{{name}, {way}|1}}°" for way in ways) + " |"


PARALLAX = tuple(map(_swatch, ("plastic_5", "plastic_60", "suede", "cloth", "jeans", "wool", "stone")))
NORMALS = tuple(map(_normals, ("suede", "cloth", "jeans", "wool", "stone")))
MITSUBA = (
    "Exact as one script has {lamp and sky, exact, OSL, median error|1} times the mean squared error of Mitsuba 3's "
    "`measured` under a lamp and an even sky, and {HDR world, exact, OSL, median error|1} times under a picture of the "
    "world, at {lamp and sky, exact, OSL, median seconds|1} and {HDR world, exact, OSL, median seconds|1} times the "
    "time; of nodes, aimed, {lamp and sky, exact, median error|1} and {HDR world, exact, median error|1} times the "
    "error at {lamp and sky, exact, median seconds|1} and {HDR world, exact, median seconds|1} times the time. A "
    "Principled BSDF of about the look takes {lamp and sky, Principled, median seconds|1} and "
    "{HDR world, Principled, median seconds|1} times Mitsuba's time, and by error times time is "
    "{lamp and sky, Principled, median gain|1} and {HDR world, Principled, median gain|1} times better"
)
# Bench, text and page of every row.
GANTRY = (
    *(
        (bench, row, f"addon/docs/{page}.md")
        for bench, rows, page in (
            ("fig4", FIG4, "method"),
            ("parallax", PARALLAX, "maps"),
            ("normals", NORMALS, "maps"),
        )
        for row in rows
    ),
    ("mitsuba", MITSUBA),
)
EVERY_SIDE = (
    "of the map over azimuth from the geometry is {RMS, every side, aside or behind, least|0%} to "
    "{RMS, every side, aside or behind, most|0%} % of the picture's with light from the side or from behind, "
    "{RMS, every side, aside or behind, median|0%} % in the median; along the arc it is at most "
    "{every side less lookup, along the arc, most|1%} points more than that of one arc's map, and between "
    "photographed azimuths {RMS, every side, between azimuths, least|0%} to "
    "{RMS, every side, between azimuths, most|0%} %, the most on glossy plastic. It takes "
    "at most {bytes, every side over arc, most|1} times the bytes."
)
