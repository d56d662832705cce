"""Rows of the page on maps that `bench detail` measures, as `readme_figures` has them."""

from __future__ import annotations

_KINDS = ("Principled, to the sun", "filtered, to the sun")
_VIEWS = {"looking down by 45°": "tilted", "towards the horizon": "horizon"}
_MAPS = {"map of one arc": "arc", "map over azimuth": "over azimuth", "map of one arc, *Preview*": "arc, Preview"}


def _eevee(kind: str, view: str) -> str:
    fields = (f"{{{kind}, {_VIEWS[view]}, {texels}, EEVEE by Cycles|2}}" for texels in (1, 4, 16))
    relief = "normal" if kind == _KINDS[0] else "filtered"
    return f"| {view}, `{relief}` | " + " | ".join(fields) + " |"


def _noise(label: str, kind: str) -> str:
    names = ("noise at 16", "noise at 16, levels", "shimmer", "shimmer, levels")
    return f"| {label} | " + " | ".join(f"{{{kind}, horizon, 16, {name}|2s%}} %" for name in names) + " |"


ROWS = (
    *(_eevee(kind, view) for view in _VIEWS for kind in _KINDS),
    *(_noise(label, kind) for label, kind in _MAPS.items()),
)

# What "the same light" means.
SAME = "the same light with less noise, and less shimmer"
SAME_CLAIMS = tuple(
    claim
    for kind in _MAPS.values()
    for claim in (f"{kind}, horizon, 16, mean, levels < 1.005", f"0.995 < {kind}, horizon, 16, mean, levels")
)
